"""Parts that ``replay --report DIR --all`` writes beside the report: PDF, tables, DICOM, bag.

The parts come from one replay and one analysis. A part that fails is left out, with its reason on
standard error; the others are written.
"""

import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar

from app.cli.dicom_folder import VOXEL_MM, resected_structures, study_of, write_study
from app.files.atomic_io import install_folder, staging_folder
from app.files.extras import check_installed
from app.geometry import NS_PER_S, MarginGuardError

if TYPE_CHECKING:
    from app.cli.bag_writing import BagProcess
    from app.dicom import DicomStudy
    from app.report import AnalysedCase, ReportPart, ReportProcess
    from app.runtime import ReplayRun, SessionContent

_Value = TypeVar("_Value")

PDF, FRAMES, DICOM, BAG = "report.pdf", "frames.parquet", "dicom", "results"
"""Names in the folder of the report; the last two are folders."""

MODULES = ("app.report.margin_plot", "app.report.pdf", "app.dicom.dicom_files")
"""Modules that the process of the parts loads while the case is replayed."""

_OWN_FILES = {
    DICOM: re.compile(r"image_\d{4,}\.dcm|segmentation\.dcm|structure_set\.dcm"),
    BAG: re.compile(rf"{BAG}_0\.mcap|metadata\.yaml"),
}


def check_parts(folder: Path) -> None:
    """Raise, before the replay, `InputError` for a missing extra, `ReportError` for a folder.

    A folder of an earlier report is replaced; one with other files is not.
    """
    from app.report import ReportError

    check_installed(
        *("rclpy", "marginguard_msgs", "highdicom", "pydicom", "pyarrow"),
        otherwise="write the report without --all",
    )
    for name, own in _OWN_FILES.items():
        place = folder / name
        if not (place.exists() or place.is_symlink()):
            continue
        known = place.is_dir() and not place.is_symlink()
        if not known or not all(own.fullmatch(path.name) for path in place.iterdir()):
            raise ReportError(
                f"report folder {folder}: {name} in it is not of a report; expected no {name}, or "
                "that of an earlier report"
            )


class CompleteReport:
    """Makes the parts beside the report of one replay, within the context `writing`.

    After the last step `begin_dicom` with the analysis, `files` and at last `install`. ``failed``
    is then true if a part is missing. ``bag`` writes the bag, ``process`` makes the other parts.
    """

    def __init__(self, folder: Path, process: "ReportProcess", bag: "BagProcess") -> None:
        self._folder = folder
        self._process = process
        self._bag = bag
        self.failed = False
        self.processor_s: dict[str, float] = {}
        """Processor time of the parts that other processes made, by name."""

    @contextmanager
    def writing(self, run: "ReplayRun") -> Iterator[Self]:
        """Write the bag of ``run`` within the context, and the folders of the parts by `install`.

        If it ends without `install`, nothing is left.
        """
        from app.report.analysis_files import FramesTable

        with staging_folder(self._folder) as self._staging:
            self._frames: FramesTable = FramesTable(
                run.prepared.content.margins.stale_after_ns / NS_PER_S
            )
            run.outputs.append(self._frames)
            self._bag.begin(run, self._staging / BAG)
            yield self

    def begin_dicom(self, content: "SessionContent", analysed: "AnalysedCase") -> None:
        """Begin to make the DICOM study of the tumour and the specimen."""
        self._analysed = analysed
        make = partial(study_of, ras_from_tumor=None, patient=content.name, voxel_mm=VOXEL_MM)
        structures = resected_structures(content.tumor, analysed.analysis)
        self._dicom: ReportPart[DicomStudy] = self._process.begin(make, lambda: (structures,))

    def files(self, pdf: "ReportPart[bytes]") -> dict[str, bytes | None]:
        """Content of the files by name, None for one that failed. Waits for ``pdf``."""
        from app.report.analysis_files import analysis_csv

        return {
            **analysis_csv(self._analysed.analysis),
            FRAMES: self._made(FRAMES, self._frames.parquet),
            PDF: self._made(PDF, pdf.wait, pdf),
        }

    def install(self) -> None:
        """Move the folders into the report's when they are complete."""
        from app.report import ReportError

        study = self._made(DICOM, self._dicom.wait, self._dicom)
        if study is not None:
            (self._staging / DICOM).mkdir()
            write_study(self._staging / DICOM, study)
        bag = self._made(BAG, self._bag.finish)
        if bag is not None:
            self.processor_s[BAG] = bag.processor_s
        try:
            install_folder(self._staging, DICOM, keep=study is not None)
            install_folder(self._staging, BAG, keep=bag is not None)
        except OSError as error:
            raise ReportError(
                f"report folder {self._folder} cannot be written: {error.strerror}"
            ) from error

    def _made(
        self, name: str, make: Callable[[], _Value], part: "ReportPart[Any] | None" = None
    ) -> _Value | None:
        """The result of ``make``; None, with the reason on standard error, if it fails."""
        try:
            made = make()
        except (MarginGuardError, RuntimeError) as error:
            print(f"no {name}: {error}", file=sys.stderr)
            self.failed = True
            return None
        if part is not None:
            self.processor_s[name] = part.processor_s
        return made
