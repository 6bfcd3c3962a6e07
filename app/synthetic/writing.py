"""Writes a simulated case: recording, meshes, manifest, ground truth, README."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from app.case.frame_streams import TrackingFrame, with_watchdog
from app.case.frames_recorder import Recorder, frames_as_read
from app.case.manifest.expected import (
    Expected,
    ExpectedBreach,
    ExpectedBreaches,
    ExpectedRegistration,
    ExpectedStructure,
    write_expected,
)
from app.case.messages.ros_messages import JOINT_STATES_TOPIC
from app.case.new_case import placed_mesh
from app.files.atomic_io import new_folder
from app.files.paths import sha256_of
from app.geometry import NS_PER_MS, NS_PER_S, Transform
from app.synthetic.case_options import (
    USUAL_PATIENT,
    USUAL_SURGEON,
    CaseErrors,
    CaseOptions,
    Encoders,
    offset_ns,
    wrong_pose,
)
from app.synthetic.error_budget import tolerances
from app.synthetic.motion import TouchArm
from app.synthetic.recording import Recording
from app.synthetic.simulated_tracker import SimulatedTracker
from app.synthetic.simulation import (
    FIRST_STAMP_NS,
    ROBOT_TO_TRACKER_OFFSET_NS,
    SENSOR_FROM_TUMOR,
    TOOL_FROM_TIP,
    Simulation,
    simulate,
)
from app.synthetic.structures import SimulatedStructure, further_structures, with_structures
from app.synthetic.tracker_model import WHITE
from app.synthetic.truth import TrueBreach, find_breaches
from app.synthetic.tumour_and_tool import (
    BASE_FRAME,
    TOOL_FILE,
    TOOL_LINK,
    TOOL_SENSOR,
    TUMOR_SENSOR,
    tool_mesh,
    write_stl,
)

LICENCE = "Apache-2.0"
TOUCH_URDF = "package://marginguard/robots/touch/touch.urdf"
RECORDING = "tracking.mcap"
MARGINS = {"stop_mm": 1.0, "warn_mm": 5.0, "k_tre": 2.0, "v_max_mm_s": 50.0}


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedCase:
    """A simulation, with the options and the seed it was made with."""

    simulation: Simulation
    options: CaseOptions
    seed: int

    @property
    def offset_ns(self) -> int:
        """Offset that the case adds to the robot's clock, with the tracker's latency and error."""
        return offset_ns(ROBOT_TO_TRACKER_OFFSET_NS, self.options)

    def calibrations(self) -> tuple[Transform, Transform]:
        """``tool_from_tip`` and ``sensor_from_tumor`` as they were calibrated."""
        errors, random = self.options.errors, np.random.default_rng([self.seed, 4])
        tip = wrong_pose(TOOL_FROM_TIP, errors.tip_mm, errors.tip_rad, random)
        return tip, wrong_pose(SENSOR_FROM_TUMOR, errors.needle_mm, 0.0, random)


def case_readme(
    case: SimulatedCase,
    breaches: Sequence[TrueBreach],
    recorded: Recording,
    command: str | None = None,
) -> str:
    """The text of the case's README.md; ``command`` is what it was made by, if it was a command."""
    rows = "\n".join(
        f"| {recorded.recorded_s(breach.start_s):.3f} | "
        f"{recorded.recorded_s(breach.end_s):.3f} | {breach.min_signed_distance_mm:.2f} | "
        f"{'the shaft, not the tip' if breach.shaft_only else 'the tip'} |"
        for breach in breaches
    )
    simulation, model = case.simulation, case.options.tracker
    landmarks = len(simulation.scenario.dwells_s)
    tool, sensor = TOOL_SENSOR, TUMOR_SENSOR
    return f"""\
# A simulated lumpectomy

**Simulated**, not recorded: no patient, no phantom, no tracker.
{_made_by(case, command)}
The same versions of it and of its libraries write the same bytes again, others the same numbers
but for rounding.

{simulation.duration_s:.1f} s from the first to the last frame. A robot holds a {tool}: it dwells
on {landmarks} landmarks in a breath-hold at end expiration, then goes around a
tumour that moves with the breath, and enters it {len(breaches)} times:

| from (s) | to (s) | deepest (mm) | by |
| --- | --- | --- | --- |
{rows}

- `case.yaml`: what belongs together, calibrations, margins.
- `tracking.mcap`: `reference`, `{sensor}` and `{tool}` in `tracker` at {model.rate_hz:g} Hz from
  {FIRST_STAMP_NS / NS_PER_S:g} s on; joint states at 200 Hz by the robot's own clock, which is
  {case.offset_ns / NS_PER_MS:g} ms behind the tracker's.
- `tumor.stl`, `{tool}.stl`: closed surfaces in mm; the {tool}'s tip is its origin, +z forward.
- `expected.yaml`: the truth, from the poses before the noise was added.

{_errors(case.options)}
"""


def _made_by(case: SimulatedCase, command: str | None) -> str:
    if command is not None:
        return f"Made by\n\n```sh\n{command}\n```\n"
    errors = "" if case.options == CaseOptions() else " with the errors listed below"
    return f"Made by `simulate_case` with the seed {case.seed}{errors}."


def _errors(options: CaseOptions) -> str:
    usual = options.patient == USUAL_PATIENT and options.surgeon == USUAL_SURGEON
    if usual and options.tracker == WHITE and options.errors == CaseErrors():
        return (
            "Jitter is white: 0.3 mm and 0.3 degrees, each the RMS length of a 3-D error vector. "
            "Encoders and\ncalibrations are exact, there is no field distortion, and the tumour "
            "does not deform."
        )
    model, errors = options.tracker, options.errors
    values = {
        "tracker": f"{model.name}, {model.rate_hz:g} Hz",
        "white jitter, RMS": _jitter(model.white.position_rms_mm, model.white.angle_rms_rad),
        f"jitter with a correlation time of {model.correlation_s:g} s, RMS": _jitter(
            model.slow.position_rms_mm, model.slow.angle_rms_rad
        ),
        "latency": f"{1000.0 * model.latency_s:.4g} ms, included in the offset of the clocks",
        "spread of intervals, of stamps": f"{1000.0 * model.period_sd_s:.4g} ms, "
        f"{1000.0 * model.stamp_sd_s:.4g} ms",
        "frames skipped, repeated; samples lost": f"{100.0 * model.skipped:.4g} %, "
        f"{100.0 * model.repeated:.4g} %; {100.0 * model.lost:.4g} %",
        "steps of positions": f"{model.position_quantum_mm:.5g} mm",
        "distortion at the arm": _jitter(model.distortion.shift_mm, model.distortion.turn_rad)
        + f", half of it at {model.distortion.reach_mm:g} mm",
        "contour of the tumour, RMS": f"{errors.contour_mm:g} mm",
        "calibration of the tip": _jitter(errors.tip_mm, errors.tip_rad),
        f"place of the tumour in the {TUMOR_SENSOR}": f"{errors.needle_mm:g} mm",
        "joints: step, offset": f"{np.degrees(errors.encoder_step_rad):.3g}, "
        f"{np.degrees(errors.encoder_offset_rad):.3g} degrees",
        "offset of the clocks": f"{1000.0 * errors.clock_s:g} ms",
    }
    values |= _patient(options)
    if options.tumor_mm is not None:
        values["largest diameter of the tumour"] = f"{options.tumor_mm:g} mm (no error)"
    table = "\n".join(f"| {name} | {value} |" for name, value in values.items())
    return f"""\
| error | size |
| --- | --- |
{table}

`tumor.stl` is the contour with its error; the truth is of the tumour without. The tumour does not
deform. The tolerances in `expected.yaml` follow from these sizes."""


def _patient(options: CaseOptions) -> dict[str, str]:
    """Values that differ from the usual patient and surgeon (no errors)."""
    patient, surgeon = options.patient, options.surgeon
    values = {}
    if patient != USUAL_PATIENT:
        shape = "usual" if patient.elongation is None else f"{patient.elongation:g}"
        x, y, z = patient.place_mm
        values = {
            "breathing: shift, rate": f"{patient.breath_mm:g} mm, {patient.breath_hz:g} Hz",
            "tumour: elongation, height of lobes": f"{shape}, {patient.irregularity:g}",
            "tumour: place relative to the usual one": f"{x:g}, {y:g}, {z:g} mm",
        }
    if surgeon != USUAL_SURGEON:
        skill = "usual" if surgeon.skill is None else f"{surgeon.skill:g}"
        stopped = "stops the tool" if surgeon.fixture else "none"
        values |= {"surgeon's skill": skill, "virtual fixture": stopped}
    return values


def _jitter(length_mm: float, angle_rad: float) -> str:
    return f"{length_mm:.3g} mm, {np.degrees(angle_rad):.3g} degrees"


def simulate_case(
    folder: Path,
    *,
    seed: int,
    arm: TouchArm,
    options: CaseOptions | None = None,
    command: str | None = None,
    structures: bool = False,
    on_frame: Callable[[int, int], None] = lambda done, total: None,
) -> None:
    """Write a simulated lumpectomy to ``folder``, which must be new or empty.

    The same ``seed``, ``arm`` and ``options`` give the same bytes. ``arm`` has the kinematics of
    `TOUCH_URDF`, which the manifest names. With ``structures`` the case has a second lesion and a
    chest wall, in schema 2. ``command`` is what the case's README says that it was made by. Raises
    `InputError` when the folder cannot be written, or the errors in ``options`` hide a breach; no
    folder is left after an error. ``on_frame(done, total)`` is called for each simulated frame,
    with the periods of the tracker so far and in all.
    """
    with new_folder(folder, may_be_empty=True) as partial:
        case, recorded = _made(seed, arm, options)
        recording = partial / RECORDING
        with Recorder(recording, robot_to_tracker_offset_ns=case.offset_ns) as recorder:
            count = _replayed(case, recorded, recorder.write, on_frame)
        further = further_structures(case.simulation) if structures else ()
        _write(partial, case, recorded, count, sha256_of(recording), command, further)


def simulate_unrecorded_case(
    folder: Path, *, seed: int, arm: TouchArm, options: CaseOptions | None = None
) -> tuple[TrackingFrame, ...]:
    """Write the case of `simulate_case` without its recording; returns the recording's frames.

    They are those that are read of the recording, for `open_case` and `prepare_case`. The manifest
    has no SHA-256 of it.
    """
    frames: list[TrackingFrame] = []
    with new_folder(folder, may_be_empty=True) as partial:
        case, recorded = _made(seed, arm, options)
        count = _replayed(case, recorded, frames.append, lambda done, total: None)
        _write(partial, case, recorded, count, None, None)
    return frames_as_read(frames, robot_to_tracker_offset_ns=case.offset_ns)


def _made(seed: int, arm: TouchArm, options: CaseOptions | None) -> tuple[SimulatedCase, Recording]:
    """A simulated case, and what is recorded of it."""
    options = CaseOptions() if options is None else options
    simulation = simulate(
        arm,
        np.random.default_rng([seed, 0]),
        options,
        contour_random=np.random.default_rng([seed, 2]),
    )
    case = SimulatedCase(simulation, options, seed)
    encoders = Encoders(options.errors, len(arm.joint_names), np.random.default_rng([seed, 3]))
    tracker = SimulatedTracker(options.tracker, [seed, 1])
    return case, Recording(simulation, tracker, encoders=encoders, offset_ns=case.offset_ns)


def _write(
    folder: Path,
    case: SimulatedCase,
    recorded: Recording,
    frames: int,
    sha256: str | None,
    command: str | None,
    structures: tuple[SimulatedStructure, ...] = (),
) -> None:
    """Write all files but the recording, which has been made; ``frames``: of a replay."""
    simulation = case.simulation
    write_stl(folder / "tumor.stl", simulation.contour.mesh())
    write_stl(folder / TOOL_FILE, tool_mesh())
    breaches = find_breaches(
        simulation.clearance,
        simulation.tumor_from_tip,
        simulation.duration_s,
        simulation.tumor_from_tips,
    )
    further = {each.name: each.breaches(simulation) for each in structures}
    write_expected(folder / "expected.yaml", _expected(case, recorded, breaches, frames, further))
    manifest = _manifest(case, sha256)
    if structures:
        manifest = with_structures(manifest, structures, folder)
    text = yaml.safe_dump(manifest, sort_keys=False, default_flow_style=None, width=100)
    (folder / "case.yaml").write_text(text, encoding="utf-8")
    readme = case_readme(case, breaches, recorded, command)
    (folder / "README.md").write_text(readme, encoding="utf-8")


def _replayed(
    case: SimulatedCase,
    recorded: Recording,
    write: Callable[[TrackingFrame], object],
    on_frame: Callable[[int, int], None],
) -> int:
    """Make the frames, call ``write`` with each, and return the number of frames of a replay."""
    simulation, options = case.simulation, case.options
    total = round(simulation.duration_s * options.tracker.rate_hz) + 1

    def written() -> Iterator[TrackingFrame]:
        for frame in recorded.frames():
            write(frame)
            done = (frame.stamp.ns - FIRST_STAMP_NS) * options.tracker.rate_hz / NS_PER_S
            on_frame(min(round(done) + 1, total), total)
            yield frame

    return sum(1 for _ in with_watchdog(written(), options.stale_after_ms * NS_PER_MS))


def _manifest(case: SimulatedCase, sha256: str | None) -> dict[str, Any]:
    simulation, (tool_from_tip, sensor_from_tumor) = case.simulation, case.calibrations()
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
        "tool": placed_mesh(TOOL_FILE, tool_from_tip, "tip_from"),
        "tumor": placed_mesh("tumor.stl", sensor_from_tumor),
        "robot": {
            "urdf": TOUCH_URDF,
            "base_frame": BASE_FRAME,
            "tool_link": TOOL_LINK,
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
    case: SimulatedCase,
    recorded: Recording,
    breaches: tuple[TrueBreach, ...],
    frames: int,
    further: Mapping[str, tuple[TrueBreach, ...]],
) -> Expected:
    simulation = case.simulation
    allowed = tolerances(
        case.options,
        simulation.margin_bound_mm,
        simulation.landmarks_in_base_mm(),
        simulation.reference_from_base,
        simulation.scenario.crossing_speed_mm_s,
    )

    def expected(breaches: tuple[TrueBreach, ...]) -> ExpectedBreaches:
        return ExpectedBreaches(
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
        )

    return Expected(
        registration=ExpectedRegistration(
            simulation.reference_from_base, allowed.registration_mm, allowed.registration_deg
        ),
        breaches=expected(breaches),
        dropouts=recorded.dropouts(case.options.stale_after_ms / 1000.0),
        frames=frames,
        structures=tuple(
            ExpectedStructure(name, expected(found)) for name, found in further.items()
        ),
    )
