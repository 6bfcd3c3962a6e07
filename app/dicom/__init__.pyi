from .study import DicomStudy, Structure, StructureVolumes, dicom_study

__all__ = ["DicomStudy", "Structure", "StructureVolumes", "dicom_study"]
