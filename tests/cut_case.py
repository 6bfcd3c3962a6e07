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

STRUCTURES_CASE = SHIPPED_CASE.parent / "structures_case"

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


def write_cut_structures(folder: Path, start_s: float, seconds: float) -> Path:
    """Write ``seconds`` of the case with three structures, with the breaches that they contain."""
    write_cut_case(folder, start_s, seconds)
    for mesh in STRUCTURES_CASE.glob("*.stl"):
        shutil.copy(mesh, folder)
    values, expected = (
        yaml.safe_load((STRUCTURES_CASE / name).read_text())
        for name in ("case.yaml", "expected.yaml")
    )
    values["recording"] = {"path": "tracking.mcap"}
    values["robots"][0]["registration"] = {"method": "given", "matrix": BASE}
    (folder / "case.yaml").write_text(yaml.safe_dump(values, sort_keys=False))
    first = recorded_frames(start_s, seconds)[0]
    before_s = (first.stamp.ns - _recorded()[0].stamp.ns) / NS_PER_S
    for block in (expected["breaches"], *(each["breaches"] for each in expected["structures"])):
        block["intervals"] = [
            {**each, **{key: each[key] - before_s for key in ("start_s", "end_s")}}
            for each in block["intervals"]
            if start_s <= each["start_s"] < start_s + seconds
        ]
    kept = {key: expected[key] for key in ("breaches", "structures")}
    (folder / "expected.yaml").write_text(yaml.safe_dump(kept))
    return folder
