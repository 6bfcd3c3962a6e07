"""Writes a simulated case: recording, meshes, manifest, ground truth, README."""

from collections.abc import Callable, Iterator
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
    ExpectedRegistration,
    write_expected,
)
from app.case.messages.ros_messages import JOINT_STATES_TOPIC
from app.case.recorder.recorder import Recorder
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
    options = CaseOptions() if options is None else options
    with new_folder(folder, may_be_empty=True) as partial:
        simulation = simulate(
            arm,
            np.random.default_rng([seed, 0]),
            options,
            contour_random=np.random.default_rng([seed, 2]),
        )
        case = SimulatedCase(simulation, options, seed, urdf, tool_link)
        write_stl(partial / "tumor.stl", simulation.contour.mesh())
        write_stl(partial / "cautery.stl", cautery_mesh())
        recording = partial / "tracking.mcap"
        recorded, frames = _record(recording, case, len(arm.joint_names), on_frame)
        breaches = find_breaches(
            simulation.clearance, simulation.tumor_from_tip, simulation.duration_s
        )
        expected = _expected(case, recorded, breaches, frames)
        write_expected(partial / "expected.yaml", expected)
        (partial / "case.yaml").write_text(
            yaml.safe_dump(
                _manifest(case, sha256_of(recording)),
                sort_keys=False,
                default_flow_style=None,
                width=100,
            ),
            encoding="utf-8",
        )
        (partial / "README.md").write_text(
            case_readme(case, breaches, recorded, command), encoding="utf-8"
        )


def _record(
    path: Path, case: SimulatedCase, joints: int, on_frame: Callable[[int, int], None]
) -> tuple[Recording, int]:
    """Write the recording; returns it and the number of frames of a replay."""
    seed, options = case.seed, case.options
    total = round(case.simulation.duration_s * options.tracker.rate_hz) + 1
    recorded = Recording(
        case.simulation,
        SimulatedTracker(options.tracker, [seed, 1]),
        encoders=Encoders(options.errors, joints, np.random.default_rng([seed, 3])),
        offset_ns=case.offset_ns,
    )
    with Recorder(path, robot_to_tracker_offset_ns=case.offset_ns) as recorder:

        def written() -> Iterator[TrackingFrame]:
            for frame in recorded.frames():
                recorder.write(frame)
                done = (frame.stamp.ns - FIRST_STAMP_NS) * options.tracker.rate_hz / NS_PER_S
                on_frame(min(round(done) + 1, total), total)
                yield frame

        stale_after_ns = options.stale_after_ms * NS_PER_MS
        count = sum(1 for _ in with_watchdog(written(), stale_after_ns))
    return recorded, count


def _manifest(case: SimulatedCase, sha256: str) -> dict[str, Any]:
    simulation, calibrated = case.simulation, case.calibrations()
    return {
        "schema": 1,
        "name": f"simulated lumpectomy {case.seed}",
        "provenance": {
            "kind": "simulated",
            "source": f"app.synthetic of this project, seed {case.seed}; no patient, no phantom",
            "licence": LICENCE,
        },
        "recording": {"path": "tracking.mcap", "sha256": sha256},
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
