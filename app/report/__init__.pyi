from .analysis_html import AnalysedCase, analysed_case, analysed_replay, analysis_page
from .record import ReplayLog, ReplayRecord, record_of
from .report_process import ReportPart, ReportProcess, draw_margin_plot
from .rows import ReportError, ReportRow, margin_csv
from .summary import Check, all_passed, check_expected, summarise
from .write import ANALYSIS_FILES, REPORT_FILES, check_writable, write_report

__all__ = [
    "ANALYSIS_FILES",
    "REPORT_FILES",
    "AnalysedCase",
    "Check",
    "ReplayLog",
    "ReplayRecord",
    "ReportError",
    "ReportPart",
    "ReportProcess",
    "ReportRow",
    "all_passed",
    "analysed_case",
    "analysed_replay",
    "analysis_page",
    "check_expected",
    "check_writable",
    "draw_margin_plot",
    "margin_csv",
    "record_of",
    "summarise",
    "write_report",
]
