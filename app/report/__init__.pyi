from .checks import Check, check_expected
from .errors import ReportError
from .margin_csv import margin_csv
from .record import ReplayLog, ReplayRecord, record_of
from .rows import ReportRow
from .summary import all_passed, summarise
from .write import REPORT_FILES, check_writable, write_report

__all__ = [
    "REPORT_FILES",
    "Check",
    "ReplayLog",
    "ReplayRecord",
    "ReportError",
    "ReportRow",
    "all_passed",
    "check_expected",
    "check_writable",
    "margin_csv",
    "record_of",
    "summarise",
    "write_report",
]
