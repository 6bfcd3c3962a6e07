"""``docs/report.md`` names all files, columns, keys and reasons of a report."""

from app.fixture import Reason
from app.report import summarise
from app.report.margin_csv import COLUMNS
from app.report.write import ANALYSIS_FILES, REPORT_FILES


def test_every_file_column_key_and_reason_is_explained(project_root, record_of):
    page = (project_root / "docs/report.md").read_text(encoding="utf-8")
    names = {
        *REPORT_FILES,
        *ANALYSIS_FILES,
        *COLUMNS,
        *map(str, Reason),
        *summarise(record_of([8.0, -1.0])),
    }
    assert {name for name in names if f"`{name}`" not in page} == set()
