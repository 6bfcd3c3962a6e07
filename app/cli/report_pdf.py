"""The report of a replay as PDF."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from app.report import ReplayRecord
    from app.runtime import PreparedCase


def pdf_of(
    prepared: "PreparedCase", record: "ReplayRecord", summary: dict[str, Any], scene: bytes | None
) -> bytes:
    """The report as PDF, with the digests of the case's files; ``scene`` is a PNG."""
    from app import __version__
    from app.report.methods import input_digests
    from app.report.pdf import report_pdf

    digests = input_digests(prepared.case)
    return report_pdf(record, summary, scene, version=__version__, inputs_sha256=digests)
