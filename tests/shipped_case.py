"""The shipped case and its truth, for tests: moments in s from the first frame.

Read from ``case.yaml`` and ``expected.yaml`` as text, without the readers under test.
"""

from pathlib import Path
from typing import Any

import yaml

SHIPPED_CASE = Path(__file__).resolve().parents[1] / "data" / "recorded_case"

_MANIFEST: dict[str, Any] = yaml.safe_load((SHIPPED_CASE / "case.yaml").read_text())
_EXPECTED: dict[str, Any] = yaml.safe_load((SHIPPED_CASE / "expected.yaml").read_text())

NAME: str = _MANIFEST["name"]
FRAMES: int = _EXPECTED["frames"]
"""Frames of a replay: those of the recording, and one for each silence."""
CLOCK_OFFSET_MS: float = _MANIFEST["clock"]["offset_robot_to_tracker_ms"]
BASE: list[float] = _EXPECTED["registration"]["reference_from_base"]
"""The robot's base, as the recording was made: ``reference_from_base``, row by row."""
STALE_AFTER_S: float = _MANIFEST["margins"]["stale_after_ms"] / 1000.0
BREACHES: list[dict[str, Any]] = _EXPECTED["breaches"]["intervals"]
DEEP, BRIEF, SHAFT = BREACHES
DROPOUTS: list[dict[str, Any]] = _EXPECTED["dropouts"]
PLANNED_DROPOUTS = [each for each in DROPOUTS if each["end_s"] - each["start_s"] > STALE_AFTER_S]
"""Those of half a second and more; the others are single samples that the tracker lost."""


def middle_s(interval: dict[str, Any]) -> float:
    """The middle of a breach or of a dropout."""
    return float(0.5 * (interval["start_s"] + interval["end_s"]))
