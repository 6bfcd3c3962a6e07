"""A simulated case as it is written: its calibrations, and the page that describes it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.geometry import NS_PER_MS, NS_PER_S, Transform
from app.synthetic.case_errors import CaseErrors, wrong_pose
from app.synthetic.case_options import CaseOptions, offset_ns
from app.synthetic.patient import USUAL_PATIENT
from app.synthetic.presets import WHITE
from app.synthetic.recording import Recording
from app.synthetic.simulation import (
    CAUTERY_FROM_TIP,
    FIRST_STAMP_NS,
    NEEDLE_FROM_TUMOR,
    ROBOT_TO_TRACKER_OFFSET_NS,
    Simulation,
)
from app.synthetic.surgeon import USUAL_SURGEON
from app.synthetic.truth import TrueBreach

LICENCE = "Apache-2.0"


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedCase:
    """A simulation, the options and the seed it was made with, and the robot of its manifest."""

    simulation: Simulation
    options: CaseOptions
    seed: int
    urdf: str
    tool_link: str

    @property
    def offset_ns(self) -> int:
        """Offset that the case adds to the robot's clock, with the tracker's latency and error."""
        return offset_ns(ROBOT_TO_TRACKER_OFFSET_NS, self.options)

    def calibrations(self) -> tuple[Transform, Transform]:
        """``cautery_from_tip`` and ``needle_from_tumor`` as they were calibrated."""
        errors, random = self.options.errors, np.random.default_rng([self.seed, 4])
        tip = wrong_pose(CAUTERY_FROM_TIP, errors.tip_mm, errors.tip_rad, random)
        return tip, wrong_pose(NEEDLE_FROM_TUMOR, errors.needle_mm, 0.0, random)


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
    return f"""\
# A simulated lumpectomy

**Simulated**, not recorded: no patient, no phantom, no tracker.
{_made_by(case, command)}
The same versions of it and of its libraries write the same bytes again, others the same numbers
but for rounding.

{simulation.duration_s:.1f} s from the first to the last frame. A robot holds a cautery: it dwells
on {landmarks} landmarks in a breath-hold at end expiration, then goes around a
tumour that moves with the breath, and enters it {len(breaches)} times:

| from (s) | to (s) | deepest (mm) | by |
| --- | --- | --- | --- |
{rows}

- `case.yaml`: what belongs together, calibrations, margins.
- `tracking.mcap`: `reference`, `needle` and `cautery` in `tracker` at {model.rate_hz:g} Hz from
  {FIRST_STAMP_NS / NS_PER_S:g} s on; joint states at 200 Hz by the robot's own clock, which is
  {case.offset_ns / NS_PER_MS:g} ms behind the tracker's.
- `tumor.stl`, `cautery.stl`: closed surfaces in mm; the cautery's tip is its origin, +z forward.
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
        "place of the tumour in the needle": f"{errors.needle_mm:g} mm",
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
