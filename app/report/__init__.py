"""What remains of a replay: numbers, a table, pictures and a page.

The plots, which load matplotlib, are imported from their own files where they are drawn.
"""

from app.report.breaches import Breach, find_breaches
from app.report.checks import Check, check_expected
from app.report.errors import ReportError
from app.report.margin_csv import margin_csv
from app.report.record import ReplayLog, ReplayRecord
from app.report.rows import ReportRow
from app.report.summary import all_passed, summarise
from app.report.write import REPORT_FILES, check_writable, write_report

__all__ = [
    "REPORT_FILES",
    "Breach",
    "Check",
    "ReplayLog",
    "ReplayRecord",
    "ReportError",
    "ReportRow",
    "all_passed",
    "check_expected",
    "check_writable",
    "find_breaches",
    "margin_csv",
    "summarise",
    "write_report",
]
