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
    from app.files.paths import sha256_of
    from app.report.pdf import report_pdf

    files = (prepared.case.folder / "case.yaml", prepared.case.recording_path)
    digests = {path.name: sha256_of(path) for path in files if path is not None and path.is_file()}
    return report_pdf(record, summary, scene, version=__version__, inputs_sha256=digests)
