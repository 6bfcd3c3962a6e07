"""Volumes of four formats, written by other libraries, against the function that made them."""

from collections.abc import Callable
from pathlib import Path

import nibabel
import nrrd
import numpy as np
import pydicom
import pytest
from pydicom.dataset import FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid
from scipy.spatial.transform import Rotation

from app.files.volume_file import read_volume
from app.geometry import FloatArray, InputError
from tests.refusals import refused

SHAPE = (12, 10, 8)
RAS_FROM_INDEX = np.eye(4)
RAS_FROM_INDEX[:3, :3] = Rotation.from_euler("xyz", [10, -20, 30], True).as_matrix() @ np.diag(
    [0.9, 1.1, 2.5]
)
RAS_FROM_INDEX[:3, 3] = [-4.0, 12.5, 30.0]
LPS_FROM_INDEX = np.diag([-1.0, -1.0, 1.0, 1.0]) @ RAS_FROM_INDEX


def values_at(ras_mm: FloatArray) -> FloatArray:
    """A value for each place (n, 3): linear in each coordinate."""
    return np.asarray(ras_mm @ [3.0, 5.0, 7.0] + 200.0)


def indices(shape: tuple[int, ...] = SHAPE) -> FloatArray:
    """All indices (n, 3), the last one fastest."""
    return np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3)


def voxels() -> FloatArray:
    """The values (i, j, k)."""
    ras = indices() @ RAS_FROM_INDEX[:3, :3].T + RAS_FROM_INDEX[:3, 3]
    return values_at(ras).reshape(SHAPE)


def write_nifti(folder: Path) -> Path:
    """By nibabel, whose matrices are RAS."""
    path = folder / "scan.nii.gz"
    nibabel.save(nibabel.Nifti1Image(voxels().astype(np.float32), RAS_FROM_INDEX), path)
    return path


def write_nrrd(folder: Path) -> Path:
    """By pynrrd, in LPS."""
    path = folder / "scan.nrrd"
    header = {
        "space": "left-posterior-superior",
        "space directions": LPS_FROM_INDEX[:3, :3].T,
        "space origin": LPS_FROM_INDEX[:3, 3],
        "kinds": ["domain"] * 3,
    }
    nrrd.write(str(path), voxels().astype(np.float32), header)
    return path


def write_series(folder: Path) -> Path:
    """By pydicom: a file for each slice, rescaled, in the reverse order of their names."""
    series, study, frame = generate_uid(), generate_uid(), generate_uid()
    (folder / "series").mkdir()
    for k in range(SHAPE[2]):
        meta = FileMetaDataset()
        meta.MediaStorageSOPClassUID = CTImageStorage
        meta.MediaStorageSOPInstanceUID = generate_uid()
        meta.TransferSyntaxUID = ExplicitVRLittleEndian
        slice_ = pydicom.Dataset()
        slice_.file_meta = meta
        slice_.SOPClassUID, slice_.SOPInstanceUID = CTImageStorage, meta.MediaStorageSOPInstanceUID
        slice_.SeriesInstanceUID, slice_.StudyInstanceUID = series, study
        slice_.FrameOfReferenceUID, slice_.Modality = frame, "CT"
        slice_.Rows, slice_.Columns = SHAPE[1], SHAPE[0]
        slice_.PixelSpacing = [1.1, 0.9]
        across = LPS_FROM_INDEX[:3, :2] / [0.9, 1.1]
        slice_.ImageOrientationPatient = [f"{each:.12f}" for each in across.T.ravel()]
        place = LPS_FROM_INDEX[:3, 3] + k * LPS_FROM_INDEX[:3, 2]
        slice_.ImagePositionPatient = [f"{each:.10f}" for each in place]
        slice_.InstanceNumber = k + 1
        slice_.SamplesPerPixel, slice_.PhotometricInterpretation = 1, "MONOCHROME2"
        slice_.BitsAllocated = slice_.BitsStored = 16
        slice_.HighBit, slice_.PixelRepresentation = 15, 1
        slice_.RescaleSlope, slice_.RescaleIntercept = "0.02", "100"
        stored = np.round((voxels()[:, :, k].T - 100.0) / 0.02).astype("<i2")
        slice_.PixelData = stored.tobytes()
        slice_.save_as(folder / "series" / f"{100 - k}.dcm", enforce_file_format=True)
    return folder / "series"


@pytest.mark.parametrize(
    ("write", "error"), [(write_nifti, 1e-3), (write_nrrd, 1e-3), (write_series, 0.011)]
)
def test_value_of_each_voxel_is_that_of_its_place(tmp_path, write, error):
    volume = read_volume(write(tmp_path))
    assert sorted(volume.values.shape) == sorted(SHAPE)
    found = indices(volume.values.shape)
    ras = found @ volume.ras_from_index[:3, :3].T + volume.ras_from_index[:3, 3]
    np.testing.assert_allclose(volume.values.ravel(), values_at(ras), atol=error)
    assert not volume.values.flags.writeable


HUGE = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4096 4096 4096\nencoding: raw\n\n"
KINDS = {"kinds": ["RGB-color"] + ["space"] * 3}


def nifti(values: FloatArray) -> Callable[[Path], object]:
    return lambda path: nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), path)


def cut(path: Path) -> None:
    path.write_bytes(write_nrrd(path.parent).read_bytes()[:-40])


@pytest.mark.parametrize(
    ("name", "write", "message"),
    [
        ("colours.nrrd", lambda path: nrrd.write(str(path), np.zeros((3, 4, 4, 4), "u1"), KINDS),
         "expected 3 with one"),
        ("flat.nii", nifti(np.zeros((8, 8), np.float32)), "expected 3 with one"),
        ("nan.nrrd", lambda path: nrrd.write(str(path), np.full((3, 3, 3), np.nan, np.float32)),
         "not finite"),
        ("cut.nrrd", cut, "expected a volume"),
        ("huge.nrrd", lambda path: path.write_text(HUGE), "4096 x 4096 x 4096 voxels"),
        ("notes.txt", lambda path: path.write_text("a note"), "not the name of a volume"),
        (".", lambda path: None, "0 DICOM series; expected a folder with one"),
        ("none.nrrd", lambda path: None, "no such file"),
    ],
)  # fmt: skip
def test_other_content_is_refused_in_one_line(tmp_path, name, write, message):
    write(tmp_path / name)
    with refused(message):
        read_volume(tmp_path / name)


def test_two_series_in_one_folder_are_refused(tmp_path):
    series = write_series(tmp_path)
    (tmp_path / "other").mkdir()
    for path in write_series(tmp_path / "other").iterdir():
        path.rename(series / f"other{path.name}")
    with pytest.raises(InputError, match="2 DICOM series"):
        read_volume(series)
