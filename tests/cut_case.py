"""Seconds of the shipped case, as a case: for tests that do not need all of it."""

import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from app.case import TrackingFrame, open_case, write_recording
from app.geometry import NS_PER_MS, NS_PER_S
from tests.shipped_case import BASE, CLOCK_OFFSET_MS, SHIPPED_CASE

Frames = list[TrackingFrame]


@cache
def _recorded() -> tuple[TrackingFrame, ...]:
    return tuple(open_case(SHIPPED_CASE).recorded_frames())


def recorded_frames(start_s: float, seconds: float) -> Frames:
    """Frames of the shipped case from ``start_s`` on; stamps are those of the recording."""
    first_ns = _recorded()[0].stamp.ns
    ages_s = ((frame.stamp.ns - first_ns) / NS_PER_S - start_s for frame in _recorded())
    return [frame for frame, age in zip(_recorded(), ages_s, strict=True) if 0 <= age < seconds]


def write_cut_case(
    folder: Path,
    start_s: float,
    seconds: float,
    change: Callable[[Frames], Frames] = lambda frames: frames,
    **manifest: Any,
) -> Path:
    """Write ``seconds`` of the shipped case to ``folder``, registered by its truth.

    ``change`` may alter the frames. ``manifest`` replaces blocks of case.yaml; None removes one.
    """
    shutil.copytree(SHIPPED_CASE, folder, ignore=shutil.ignore_patterns("*.mcap", "expected.yaml"))
    values = yaml.safe_load((SHIPPED_CASE / "case.yaml").read_text())
    given = {"method": "given", "matrix": BASE}
    values |= {"recording": {"path": "tracking.mcap"}, "registration": given, "expected": None}
    values = {key: block for key, block in (values | manifest).items() if block is not None}
    (folder / "case.yaml").write_text(yaml.safe_dump(values, sort_keys=False))
    write_recording(
        folder / "tracking.mcap",
        change(recorded_frames(start_s, seconds)),
        robot_to_tracker_offset_ns=round(CLOCK_OFFSET_MS * NS_PER_MS),
        joint_states_topic="/joint_states",
    )
    return folder
