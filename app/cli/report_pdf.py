"""The report of a replay as PDF."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from app.analysis import Insertion
    from app.report import ReplayRecord


def pdf_of(
    record: "ReplayRecord",
    summary: dict[str, Any],
    scene: bytes | None,
    digests: Mapping[str, str],
    insertion: "Insertion | None",
) -> bytes:
    """The report as PDF.

    ``scene`` is a PNG, ``digests`` are those of the case's files by `input_digests`. ``insertion``
    as of `case_insertion`, None for a replay without frames.
    """
    from app import __version__
    from app.report.pdf import report_pdf

    return report_pdf(
        record, summary, scene, version=__version__, inputs_sha256=digests, insertion=insertion
    )
