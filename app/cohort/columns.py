"""The flat row of a case: columns with a fixed type and order, the same for every cohort."""

import math
from collections.abc import Mapping
from typing import Any, Literal

from app.cohort.design import OPTION_RANGES, CohortCase

Value = str | int | float | bool | None
Row = dict[str, Value]
Kind = Literal["text", "integer", "number", "boolean"]

OK, FAILED, LOST = "ok", "failed", "lost"
"""Status of a row. ``failed``: the same input fails again. ``lost``: the worker could not finish
(it died, or its disk was full); the next run does the case again."""

_STATES = ("NEGATIVE", "WARNING", "POSITIVE", "UNKNOWN")

ANALYSIS = {
    "deepest_mm": "deepest_mm",
    "deepest_low_mm": "deepest_low_mm",
    "deepest_high_mm": "deepest_high_mm",
    "deepest_entry_speed_mm_s": "deepest_entry_speed_mm_s",
    "jitter_sigma_mm": "jitter_sigma_mm",
    "distance_p5_mm": "distance_p5_mm",
    "distance_p50_mm": "distance_p50_mm",
    "approach_s": "seconds_approach",
    "cutting_s": "seconds_cutting",
    "away_s": "seconds_away",
    "path_mm": "motion_path_mm",
    "mean_speed_mm_s": "motion_mean_speed_mm_s",
    "max_speed_mm_s": "motion_max_speed_mm_s",
    "log_dimensionless_jerk": "motion_log_dimensionless_jerk",
    "idle_s": "motion_idle_s",
}
INSERTION = {
    "tissue_s": "insertion_tissue_s",
    "tissue_path_mm": "insertion_tissue_path_mm",
    "tissue_damage_mm2": "insertion_tissue_damage_mm2",
}
"""Column -> key of the flat record of `app.analysis`, a number. Those of an insertion are known
where a distance to the tissue is."""

_DECIMALS = 6

IDENTITY: dict[str, Kind] = {
    "name": "text",
    "status": "text",
    "reason": "text",
    "source": "text",
    "input_hash": "text",
    "version": "text",
    "group": "text",
    "surgeon": "text",
    "pair": "text",
    "tip_only": "boolean",
    "seed": "integer",
    "tracker": "text",
    "fixture": "boolean",
}
OPTIONS: dict[str, Kind] = {f"option_{key}": "number" for key in OPTION_RANGES}
RESULTS: dict[str, Kind] = {
    "frames": "integer",
    "valid_frames": "integer",
    "inside_frames": "integer",
    "duration_s": "number",
    **{f"{state.lower()}_s": "number" for state in _STATES},
    "min_signed_distance_mm": "number",
    "path_min_signed_distance_mm": "number",
    "path_lower_bound_mm": "number",
    "breaches": "integer",
    "breach_s": "number",
    "longest_breach_s": "number",
    "registration_accepted": "boolean",
    "registration_fre_mm": "number",
    "checks_passed": "integer",
    "checks_failed": "integer",
    **dict.fromkeys(ANALYSIS | INSERTION, "number"),
    "deepest_direction": "text",
    "deepest_part": "text",
    "notes": "text",
}
COLUMNS: dict[str, Kind] = IDENTITY | OPTIONS | RESULTS
"""Column -> type. A value that is not known is null."""


def identity_of(case: CohortCase, input_hash: str, version: str) -> Row:
    """A row with what is known before the case is analysed; status and results are null."""
    row: Row = dict.fromkeys(COLUMNS)
    row |= {
        "name": case.name,
        "reason": "",
        "source": case.source,
        "input_hash": input_hash,
        "version": version,
        "group": case.group,
        "surgeon": case.surgeon,
        "pair": case.pair,
        "tip_only": case.tip_only,
    }
    if case.synthetic is not None:
        values = dict(case.synthetic.values)
        row |= {
            "seed": case.synthetic.seed,
            "tracker": case.synthetic.tracker,
            "fixture": case.synthetic.fixture,
        }
        row |= {f"option_{key}": values.get(option.field) for key, option in OPTION_RANGES.items()}
    return row


def failed(row: Row, status: str, reason: str) -> Row:
    """``row`` with the status ``failed`` or ``lost`` and a reason in one line."""
    return row | {"status": status, "reason": " ".join(reason.split())}


def finished(row: Row, summary: Mapping[str, Any], analysis: Mapping[str, Any]) -> Row:
    """``row`` with the results of a case.

    ``summary`` is the content of ``summary.json`` of a replay, ``analysis`` the flat record of
    `app.analysis`.
    """
    breaches = summary["breaches"]
    durations = [breach["duration_s"] for breach in breaches]
    registration = summary["registration"] or {}
    checks = [check["result"] for check in summary["expected"] or ()]
    numbers = ANALYSIS if analysis["distance_p50_mm"] is None else ANALYSIS | INSERTION
    plain = ("frames", "valid_frames", "inside_frames", "duration_s", "min_signed_distance_mm")
    paths = ("path_min_signed_distance_mm", "path_lower_bound_mm")
    return row | {
        "status": OK,
        **{key: summary[key] for key in (*plain, *paths)},
        **{f"{state.lower()}_s": summary["state_seconds"][state] for state in _STATES},
        "breaches": len(breaches),
        "breach_s": round(sum(durations), 6),
        "longest_breach_s": max(durations, default=0.0),
        "registration_accepted": registration.get("accepted"),
        "registration_fre_mm": registration.get("fre_mm"),
        "checks_passed": checks.count("pass") if checks else None,
        "checks_failed": len(checks) - checks.count("pass") if checks else None,
        **{column: _rounded(analysis[key]) for column, key in numbers.items()},
        "deepest_direction": analysis["deepest_direction"],
        "deepest_part": analysis["deepest_part"],
        "notes": "; ".join(summary["notes"]),
    }


def _rounded(value: float | None) -> float | None:
    if value is None or not math.isfinite(value):
        return None
    return round(float(value), _DECIMALS) + 0.0  # + 0.0: no negative zero
