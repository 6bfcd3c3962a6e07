"""Attributes that all files of a study share, and the bytes of a file."""

import io

from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.uid import ExplicitVRLittleEndian

from app.dicom.identity import Identity

MANUFACTURER = "MarginGuard"
UNKNOWN_DATE, UNKNOWN_TIME = "19700101", "000000"
"""Where DICOM requires a date and none is known."""


def add_common(
    file: Dataset, identity: Identity, version: str, *, sop_class: str, what: str
) -> None:
    """Set patient, study, equipment and the identity of one instance, ``what``."""
    file.SpecificCharacterSet = "ISO_IR 192"
    file.SOPClassUID = sop_class
    file.SOPInstanceUID = identity.uid(what)
    file.PatientName = identity.person_name
    file.PatientID = identity.patient_text
    file.PatientBirthDate = file.PatientSex = ""
    file.StudyInstanceUID = identity.uid("study")
    file.StudyDate, file.StudyTime = identity.date_text, ""
    file.StudyID = "1"
    file.AccessionNumber = file.ReferringPhysicianName = ""
    file.Manufacturer = file.ManufacturerModelName = MANUFACTURER
    file.DeviceSerialNumber = "none"
    file.SoftwareVersions = version
    file.FrameOfReferenceUID = identity.frame_of_reference
    file.PositionReferenceIndicator = ""


def file_bytes(file: Dataset) -> bytes:
    """``file`` as a DICOM file with explicit lengths, little endian."""
    file.file_meta = FileMetaDataset()
    file.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    file.file_meta.MediaStorageSOPClassUID = file.SOPClassUID
    file.file_meta.MediaStorageSOPInstanceUID = file.SOPInstanceUID
    stream = io.BytesIO()
    file.save_as(stream, enforce_file_format=True)
    return stream.getvalue()
