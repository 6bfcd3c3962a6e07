"""Writes structures as a folder of DICOM files, for the commands that export them."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app import __version__
from app.files.atomic_io import new_folder

if TYPE_CHECKING:
    from app.analysis import CaseAnalysis
    from app.dicom import DicomStudy, Structure
    from app.geometry import SurfaceMesh

VOXEL_MM = 0.5


def write_dicom(
    folder: Path,
    structures: Sequence["Structure"],
    *,
    ras_from_tumor: Sequence[Sequence[float]] | None,
    **options: Any,
) -> "DicomStudy":
    """Write the study of ``structures`` to the new ``folder`` and return it.

    The arguments are those of `study_of`. Raises as that does, and `InputError` for a folder that
    is not empty.
    """
    study = study_of(structures, ras_from_tumor=ras_from_tumor, **options)
    with new_folder(folder, may_be_empty=True) as partial:
        write_study(partial, study)
    return study


def study_of(
    structures: Sequence["Structure"],
    *,
    ras_from_tumor: Sequence[Sequence[float]] | None,
    **options: Any,
) -> "DicomStudy":
    """The study of ``structures``, of which the first is the tumour.

    ``ras_from_tumor`` (3, 3) turns their axes to RAS, which they are without it. ``options`` as in
    `dicom_study`. Raises as that does.
    """
    from app.dicom import Structure, dicom_study
    from app.geometry import SurfaceMesh
    from app.session import checked_axes

    axes = checked_axes(ras_from_tumor)
    if axes is not None:
        structures = [
            Structure(
                each.name,
                SurfaceMesh(
                    each.surface.frame, each.surface.vertices_mm @ axes.T, each.surface.faces
                ),
            )
            for each in structures
        ]
    return dicom_study(structures, version=__version__, **options)


def write_study(folder: Path, study: "DicomStudy") -> None:
    """Write the files of ``study`` into ``folder``."""
    for name, data in study.files.items():
        (folder / name).write_bytes(data)


def resected_structures(tumor: "SurfaceMesh", analysis: "CaseAnalysis") -> list["Structure"]:
    """The tumour, and the specimen where the analysis found one."""
    from app.dicom import Structure

    found = None if analysis.resection is None else analysis.resection.specimen
    specimen = [] if found is None else [Structure("specimen", found.surface)]
    return [Structure("tumor", tumor), *specimen]
