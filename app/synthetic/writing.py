"""Writes a simulated case: recording, meshes, manifest, ground truth, README."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from app.case.frame_streams import with_watchdog
from app.case.frames_recorder import Recorder, frames_as_read
from app.case.manifest.expected import (
    Expected,
    ExpectedBreach,
    ExpectedBreaches,
    ExpectedRegistration,
    write_expected,
)
from app.case.messages.ros_messages import JOINT_STATES_TOPIC
from app.case.tracking_frames import TrackingFrame
from app.files.atomic_io import new_folder
from app.files.paths import sha256_of
from app.geometry import NS_PER_MS, NS_PER_S, Transform
from app.synthetic.case_errors import Encoders
from app.synthetic.case_options import CaseOptions
from app.synthetic.cautery import cautery_mesh
from app.synthetic.error_budget import tolerances
from app.synthetic.motion import ArmKinematics
from app.synthetic.recording import Recording
from app.synthetic.simulated_case import LICENCE, SimulatedCase, case_readme
from app.synthetic.simulated_tracker import SimulatedTracker
from app.synthetic.simulation import BASE_FRAME, FIRST_STAMP_NS, simulate
from app.synthetic.stl import write_stl
from app.synthetic.truth import TrueBreach, find_breaches

TOUCH_URDF = "package://marginguard/robots/touch/touch.urdf"
TOUCH_TOOL_LINK = "stylus"
RECORDING = "tracking.mcap"
MARGINS = {"stop_mm": 1.0, "warn_mm": 5.0, "k_tre": 2.0, "v_max_mm_s": 50.0}


def simulate_case(
    folder: Path,
    *,
    seed: int,
    arm: ArmKinematics,
    options: CaseOptions | None = None,
    urdf: str = TOUCH_URDF,
    tool_link: str = TOUCH_TOOL_LINK,
    command: str | None = None,
    on_frame: Callable[[int, int], None] = lambda done, total: None,
) -> None:
    """Write a simulated lumpectomy to ``folder``, which must be new or empty.

    The same ``seed``, ``arm`` and ``options`` give the same bytes. ``urdf`` and ``tool_link`` are
    written to the manifest: they must describe ``arm``, and the link's origin must be the tool's
    tip. ``command`` is what the case's README says that it was made by. Raises `InputError` when
    the folder cannot be written, or the errors in ``options`` hide a breach; no folder is left
    after an error. ``on_frame(done, total)`` is called for each simulated frame, with the periods
    of the tracker so far and in all.
    """
    with new_folder(folder, may_be_empty=True) as partial:
        made = _made(seed, arm, options, urdf, tool_link)
        recording = partial / RECORDING
        with Recorder(recording, robot_to_tracker_offset_ns=made.case.offset_ns) as recorder:
            count = _replayed(made, recorder.write, on_frame)
        _write(partial, made, count, sha256_of(recording), command)


def simulate_unrecorded_case(
    folder: Path, *, seed: int, arm: ArmKinematics, options: CaseOptions | None = None
) -> tuple[TrackingFrame, ...]:
    """Write the case of `simulate_case` without its recording; returns the recording's frames.

    They are those that are read of the recording, for `open_case` and `prepare_case`. The manifest
    has no SHA-256 of it.
    """
    frames: list[TrackingFrame] = []
    with new_folder(folder, may_be_empty=True) as partial:
        made = _made(seed, arm, options, TOUCH_URDF, TOUCH_TOOL_LINK)
        count = _replayed(made, frames.append, lambda done, total: None)
        _write(partial, made, count, None, None)
    return frames_as_read(frames, robot_to_tracker_offset_ns=made.case.offset_ns)


@dataclass(frozen=True, slots=True, eq=False)
class _Made:
    """A simulated case and what is recorded of it."""

    case: SimulatedCase
    recorded: Recording


def _made(
    seed: int, arm: ArmKinematics, options: CaseOptions | None, urdf: str, tool_link: str
) -> _Made:
    options = CaseOptions() if options is None else options
    simulation = simulate(
        arm,
        np.random.default_rng([seed, 0]),
        options,
        contour_random=np.random.default_rng([seed, 2]),
    )
    case = SimulatedCase(simulation, options, seed, urdf, tool_link)
    encoders = Encoders(options.errors, len(arm.joint_names), np.random.default_rng([seed, 3]))
    tracker = SimulatedTracker(options.tracker, [seed, 1])
    recorded = Recording(simulation, tracker, encoders=encoders, offset_ns=case.offset_ns)
    return _Made(case, recorded)


def _write(folder: Path, made: _Made, frames: int, sha256: str | None, command: str | None) -> None:
    """Write all files but the recording, which has been made; ``frames``: of a replay."""
    case, recorded = made.case, made.recorded
    simulation = case.simulation
    write_stl(folder / "tumor.stl", simulation.contour.mesh())
    write_stl(folder / "cautery.stl", cautery_mesh())
    breaches = find_breaches(
        simulation.clearance,
        simulation.tumor_from_tip,
        simulation.duration_s,
        simulation.tumor_from_tips,
    )
    write_expected(folder / "expected.yaml", _expected(case, recorded, breaches, frames))
    (folder / "case.yaml").write_text(
        yaml.safe_dump(
            _manifest(case, sha256), sort_keys=False, default_flow_style=None, width=100
        ),
        encoding="utf-8",
    )
    (folder / "README.md").write_text(
        case_readme(case, breaches, recorded, command), encoding="utf-8"
    )


def _replayed(
    made: _Made,
    write: Callable[[TrackingFrame], object],
    on_frame: Callable[[int, int], None],
) -> int:
    """Make the frames, call ``write`` with each, and return the number of frames of a replay."""
    simulation, options = made.case.simulation, made.case.options
    total = round(simulation.duration_s * options.tracker.rate_hz) + 1

    def written() -> Iterator[TrackingFrame]:
        for frame in made.recorded.frames():
            write(frame)
            done = (frame.stamp.ns - FIRST_STAMP_NS) * options.tracker.rate_hz / NS_PER_S
            on_frame(min(round(done) + 1, total), total)
            yield frame

    return sum(1 for _ in with_watchdog(written(), options.stale_after_ms * NS_PER_MS))


def _manifest(case: SimulatedCase, sha256: str | None) -> dict[str, Any]:
    simulation, calibrated = case.simulation, case.calibrations()
    recording = {"path": RECORDING} if sha256 is None else {"path": RECORDING, "sha256": sha256}
    return {
        "schema": 1,
        "name": f"simulated lumpectomy {case.seed}",
        "provenance": {
            "kind": "simulated",
            "source": f"app.synthetic of this project, seed {case.seed}; no patient, no phantom",
            "licence": LICENCE,
        },
        "recording": recording,
        "clock": {"offset_robot_to_tracker_ms": case.offset_ns / NS_PER_MS},
        "tool": {
            "frame": "cautery",
            "mesh": {"path": "cautery.stl", "units": "mm"},
            "tip_from": {"matrix": _numbers(calibrated[0])},
        },
        "tumor": {
            "frame": "needle",
            "mesh": {"path": "tumor.stl", "units": "mm"},
            "pose": {"matrix": _numbers(calibrated[1])},
        },
        "robot": {
            "urdf": case.urdf,
            "base_frame": BASE_FRAME,
            "tool_link": case.tool_link,
            "joint_states": JOINT_STATES_TOPIC,
        },
        "registration": {
            "method": "paired_points",
            "dwells": [
                {"start_s": round(start_s, 3), "end_s": round(end_s, 3)}
                for start_s, end_s in simulation.scenario.dwells_s
            ],
        },
        "margins": {**MARGINS, "stale_after_ms": case.options.stale_after_ms},
        "expected": "expected.yaml",
    }


def _expected(
    case: SimulatedCase, recorded: Recording, breaches: tuple[TrueBreach, ...], frames: int
) -> Expected:
    simulation = case.simulation
    allowed = tolerances(
        case.options,
        simulation.margin_bound_mm,
        simulation.landmarks_in_base_mm(),
        simulation.reference_from_base,
        simulation.scenario.crossing_speed_mm_s,
    )
    return Expected(
        registration=ExpectedRegistration(
            simulation.reference_from_base, allowed.registration_mm, allowed.registration_deg
        ),
        breaches=ExpectedBreaches(
            allowed.breach_ms,
            allowed.depth_mm,
            tuple(
                ExpectedBreach(
                    round(recorded.recorded_s(breach.start_s), 4),
                    round(recorded.recorded_s(breach.end_s), 4),
                    round(breach.min_signed_distance_mm, 3),
                    breach.shaft_only,
                )
                for breach in breaches
            ),
        ),
        dropouts=recorded.dropouts(case.options.stale_after_ms / 1000.0),
        frames=frames,
    )


def _numbers(transform: Transform) -> list[float]:
    return [float(number) for number in transform.matrix.ravel()]
