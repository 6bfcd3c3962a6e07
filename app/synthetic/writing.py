"""Writes a simulated case: recording, meshes, manifest, ground truth, README."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from app.case.frames.samples import TrackingFrame
from app.case.frames.watchdog import with_watchdog
from app.case.manifest.expected import (
    Expected,
    ExpectedBreach,
    ExpectedBreaches,
    ExpectedDropout,
    ExpectedRegistration,
    write_expected,
)
from app.case.messages.ros_messages import JOINT_STATES_TOPIC
from app.case.recorder.recorder import write_recording
from app.files.atomic_io import new_folder
from app.files.paths import sha256_of
from app.geometry import NS_PER_MS, NS_PER_S, Transform
from app.synthetic.cautery import cautery_mesh
from app.synthetic.motion import ArmKinematics
from app.synthetic.simulation import (
    BASE_FRAME,
    CAUTERY_FROM_TIP,
    FIRST_STAMP_NS,
    NEEDLE_FROM_TUMOR,
    ROBOT_TO_TRACKER_OFFSET_NS,
    TRACKER_PERIOD_NS,
    Simulation,
    simulate,
)
from app.synthetic.stl import write_stl
from app.synthetic.tracker import Jitter
from app.synthetic.truth import TrueBreach, find_breaches

TOUCH_URDF = "package://marginguard/robots/touch/touch.urdf"
TOUCH_TOOL_LINK = "stylus"
LICENCE = "Apache-2.0"

REGISTRATION_TOLERANCE_MM = 1.0
REGISTRATION_TOLERANCE_DEG = 0.5
BREACH_TOLERANCE_MS = 40.0
DEPTH_TOLERANCE_MM = 1.25
"""Error of the deepest of about 30 noisy samples; the jitter along the normal is 0.35 mm."""

STALE_AFTER_MS = 60
MARGINS = {
    "stop_mm": 1.0,
    "warn_mm": 5.0,
    "k_tre": 2.0,
    "v_max_mm_s": 50.0,
    "stale_after_ms": STALE_AFTER_MS,
}


def simulate_case(
    folder: Path,
    *,
    seed: int,
    arm: ArmKinematics,
    urdf: str = TOUCH_URDF,
    tool_link: str = TOUCH_TOOL_LINK,
    on_frame: Callable[[int, int], None] = lambda done, total: None,
) -> None:
    """Write a simulated lumpectomy to ``folder``, which must be new or empty.

    The same ``seed`` and ``arm`` give the same bytes. ``urdf`` and ``tool_link`` are written to the
    manifest: they must describe ``arm``, and the link's origin must be the tool's tip. Raises
    `InputError` when the folder cannot be written; no folder is left after an error.
    ``on_frame(done, total)`` is called for each simulated frame, with the periods of the tracker so
    far and in all.
    """
    with new_folder(folder, may_be_empty=True) as partial:
        simulation = simulate(arm, np.random.default_rng([seed, 0]))
        total = round(simulation.duration_s * NS_PER_S / TRACKER_PERIOD_NS) + 1
        frames = []
        for frame in simulation.frames(Jitter(), np.random.default_rng([seed, 1])):
            frames.append(frame)
            on_frame((frame.stamp.ns - FIRST_STAMP_NS) // TRACKER_PERIOD_NS + 1, total)
        _write(partial, simulation, frames, seed, urdf, tool_link)


def _write(
    folder: Path,
    simulation: Simulation,
    frames: list[TrackingFrame],
    seed: int,
    urdf: str,
    tool_link: str,
) -> None:
    write_stl(folder / "tumor.stl", simulation.tumour.mesh())
    write_stl(folder / "cautery.stl", cautery_mesh())
    recording = folder / "tracking.mcap"
    write_recording(recording, frames, robot_to_tracker_offset_ns=ROBOT_TO_TRACKER_OFFSET_NS)
    breaches = find_breaches(simulation.clearance, simulation.tumor_from_tip, simulation.duration_s)
    write_expected(folder / "expected.yaml", _expected(simulation, breaches, frames))
    manifest = _manifest(simulation, seed, sha256_of(recording), urdf, tool_link)
    (folder / "case.yaml").write_text(
        yaml.safe_dump(manifest, sort_keys=False, default_flow_style=None, width=100),
        encoding="utf-8",
    )
    (folder / "README.md").write_text(_readme(simulation, breaches, seed), encoding="utf-8")


def _manifest(
    simulation: Simulation, seed: int, sha256: str, urdf: str, tool_link: str
) -> dict[str, Any]:
    return {
        "schema": 1,
        "name": f"simulated lumpectomy {seed}",
        "provenance": {
            "kind": "simulated",
            "source": f"app.synthetic of this project, seed {seed}; no patient, no phantom",
            "licence": LICENCE,
        },
        "recording": {"path": "tracking.mcap", "sha256": sha256},
        "clock": {"offset_robot_to_tracker_ms": ROBOT_TO_TRACKER_OFFSET_NS / NS_PER_MS},
        "tool": {
            "frame": "cautery",
            "mesh": {"path": "cautery.stl", "units": "mm"},
            "tip_from": {"matrix": _numbers(CAUTERY_FROM_TIP)},
        },
        "tumor": {
            "frame": "needle",
            "mesh": {"path": "tumor.stl", "units": "mm"},
            "pose": {"matrix": _numbers(NEEDLE_FROM_TUMOR)},
        },
        "robot": {
            "urdf": urdf,
            "base_frame": BASE_FRAME,
            "tool_link": tool_link,
            "joint_states": JOINT_STATES_TOPIC,
        },
        "registration": {
            "method": "paired_points",
            "dwells": [
                {"start_s": round(start_s, 3), "end_s": round(end_s, 3)}
                for start_s, end_s in simulation.scenario.dwells_s
            ],
        },
        "margins": dict(MARGINS),
        "expected": "expected.yaml",
    }


def _expected(
    simulation: Simulation, breaches: tuple[TrueBreach, ...], frames: list[TrackingFrame]
) -> Expected:
    return Expected(
        registration=ExpectedRegistration(
            simulation.reference_from_base, REGISTRATION_TOLERANCE_MM, REGISTRATION_TOLERANCE_DEG
        ),
        breaches=ExpectedBreaches(
            BREACH_TOLERANCE_MS,
            DEPTH_TOLERANCE_MM,
            tuple(
                ExpectedBreach(
                    round(breach.start_s, 4),
                    round(breach.end_s, 4),
                    round(breach.min_signed_distance_mm, 3),
                    breach.shaft_only,
                )
                for breach in breaches
            ),
        ),
        dropouts=_dropouts(simulation),
        frames=sum(1 for _ in with_watchdog(iter(frames), STALE_AFTER_MS * NS_PER_MS)),
    )


def _dropouts(simulation: Simulation) -> tuple[ExpectedDropout, ...]:
    """The expected dropouts, one per frame, up to the last lost sample.

    Samples marked invalid are known at once, so the dropout begins with the first of them. Missing
    samples are known by the age of the last received one, so the dropout begins with that.
    """
    count = round(simulation.duration_s * NS_PER_S / TRACKER_PERIOD_NS) + 1
    times = [index * TRACKER_PERIOD_NS / NS_PER_S for index in range(count)]
    dropouts: list[ExpectedDropout] = []
    for dropout in simulation.scenario.dropouts:
        during = [i for i, time_s in enumerate(times) if dropout.covers(time_s)]
        first = during[0] if dropout.kind == "invalid" else during[0] - 1
        span_s = times[first], times[during[-1]]
        dropouts.extend(ExpectedDropout(frame, dropout.kind, *span_s) for frame in dropout.frames)
    return tuple(dropouts)


def _readme(simulation: Simulation, breaches: tuple[TrueBreach, ...], seed: int) -> str:
    rows = "\n".join(
        f"| {breach.start_s:.3f} | {breach.end_s:.3f} | {breach.min_signed_distance_mm:.2f} | "
        f"{'the shaft, not the tip' if breach.shaft_only else 'the tip'} |"
        for breach in breaches
    )
    landmarks = len(simulation.scenario.dwells_s)
    return f"""\
# A simulated lumpectomy

**Simulated**, not recorded: no patient, no phantom, no tracker. Made by `marginguard make-case DIR
--seed {seed}`. The same versions of it and of its libraries write the same bytes again, others the
same numbers but for rounding.

{simulation.duration_s:.1f} s from the first to the last frame. A robot holds a cautery: it dwells
on {landmarks} landmarks in a breath-hold at end expiration, then goes around a
tumour that moves with the breath, and enters it {len(breaches)} times:

| from (s) | to (s) | deepest (mm) | by |
| --- | --- | --- | --- |
{rows}

- `case.yaml`: what belongs together, calibrations, margins.
- `tracking.mcap`: `reference`, `needle` and `cautery` in `tracker` at 50 Hz from
  {FIRST_STAMP_NS / NS_PER_S:g} s on; joint states at 200 Hz by the robot's own clock, which is
  {ROBOT_TO_TRACKER_OFFSET_NS / NS_PER_MS:g} ms behind the tracker's.
- `tumor.stl`, `cautery.stl`: closed surfaces in mm; the cautery's tip is its origin, +z forward.
- `expected.yaml`: the truth, from the poses before the noise was added.

Jitter is white: 0.3 mm and 0.3 degrees, each the RMS length of a 3-D error vector. Encoders and
calibrations are exact, there is no field distortion, and the tumour does not deform.
"""


def _numbers(transform: Transform) -> list[float]:
    return [float(number) for number in transform.matrix.ravel()]
