"""Tiers of the tests: one marker in each test file, read without importing the file.

A file without a marker belongs to the fast tier. ``slow`` needs ROS, rendering, a browser, other
processes or more than about a second and a half; ``long`` takes too long for the suite;
``exhaustive`` repeats in full what a shorter test of the suite shows. ``python -m tools.durations``
compares measured times with the tiers.
"""

import csv
import re
from functools import cache
from pathlib import Path

PROJECT_ROOT = Path(__file__).resolve().parents[1]
DURATIONS = PROJECT_ROOT / "tests" / "durations.csv"

TIERS = {
    "fast": ("fast",),
    "suite": ("fast", "slow"),
    "long": ("long",),
    "exhaustive": ("exhaustive",),
    "rest": ("long", "exhaustive"),
}
"""Value of ``--tier`` -> markers of the files that run; "fast" is a file without a marker."""

_MARKER = re.compile(r"^pytestmark = (?:\[\s*)?pytest\.mark\.(slow|long|exhaustive)\b", re.M)
"""The tier is the first of several markers."""


@cache
def tier_of(path: Path) -> str:
    """Marker of the test file ``path``: fast, slow, long or exhaustive."""
    found = _MARKER.search(path.read_text("utf-8"))
    return found[1] if found else "fast"


def seconds_by_file(record: Path = DURATIONS) -> dict[str, float]:
    """Measured seconds by test file, relative to the project; `tools.durations` writes them."""
    with record.open(newline="", encoding="utf-8") as file:
        return {row["file"]: float(row["seconds"]) for row in csv.DictReader(file)}
