"""Analysis of one case: breaches, distances, states, motion, phases, coverage, insertion."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from app.analysis.breach_probability import (
    BreachProbability,
    breach_probability,
    smoothed_distances,
)
from app.analysis.case_breaches import AnalysedBreach, analyse_breaches, sides_of
from app.analysis.coverage import WITHIN_MM, Coverage, coverage_of
from app.analysis.directions import SideResult, side_results
from app.analysis.insertion import Insertion, case_insertion
from app.analysis.jitter import Jitter, estimate_jitter
from app.analysis.motion import Motion, motion_of
from app.analysis.phases import phase_counts, phase_seconds, phases_of
from app.analysis.samples import CaseSamples
from app.analysis.specimen import Resection, resection_of
from app.fixture import MarginParameters, MarginState
from app.geometry import ANATOMICAL_WORDS, NS_PER_S, FloatArray, SurfaceMesh
from app.session import checked_axes

if TYPE_CHECKING:
    from app.session import StepResult

PERCENTILES = (0, 5, 25, 50, 75, 95, 100)
FlatValue = float | int | str | None


@dataclass(frozen=True, slots=True, eq=False)
class CaseAnalysis:
    """The analysis of one case. Lengths in mm, times in s; unknown values are None.

    ``times_s`` (n,): of the frames, from the first one; ``distances_mm`` and ``held_s`` (n,) are as
    in `CaseSamples`. ``percentiles_mm``: of the measured
    distance over the frames, by percent, empty without a distance. ``jitter``: noise of the
    distance, None where the case is too short for an estimate; the breaches then have no estimated
    depth.
    ``resection``: None where it was not asked for. ``sides``: of the tumour, right to inferior.
    ``probability``: None where no errors were given or no distance is known. ``anatomical``: the
    rotation to the patient's axes was given; else the axes of the tumour's file are taken as right,
    anterior and superior.
    """

    name: str
    times_s: FloatArray
    distances_mm: FloatArray
    held_s: FloatArray
    frames: int
    duration_s: float
    state_seconds: Mapping[str, float]
    percentiles_mm: Mapping[int, float]
    jitter: Jitter | None
    breaches: tuple[AnalysedBreach, ...]
    motion: Motion
    phase_seconds: Mapping[str, float]
    phase_counts: Mapping[str, int]
    coverage: Coverage
    insertion: Insertion
    resection: Resection | None
    sides: tuple[SideResult, ...]
    probability: BreachProbability | None
    anatomical: bool

    def as_dict(self) -> dict[str, Any]:
        """The analysis as JSON types."""
        risk = self.probability
        return {
            "case": self.name,
            "frames": self.frames,
            "duration_s": self.duration_s,
            "state_seconds": dict(self.state_seconds),
            "distance_percentiles_mm": {f"p{k}": v for k, v in self.percentiles_mm.items()},
            "jitter": None if self.jitter is None else asdict(self.jitter),
            "anatomical": self.anatomical,
            "breaches": [_breach_dict(breach) for breach in self.breaches],
            "breach_sides": sides_of(self.breaches),
            "motion": asdict(self.motion),
            "phase_seconds": dict(self.phase_seconds),
            "phase_counts": dict(self.phase_counts),
            "coverage": {f"within_{k:g}_mm": v for k, v in self.coverage.shares().items()},
            "insertion": asdict(self.insertion),
            "resection": None if self.resection is None else self.resection.as_dict(),
            "sides": [asdict(side) for side in self.sides],
            "breach_probability": None if risk is None else risk.as_dict(self.times_s),
        }

    def flat(self) -> dict[str, FlatValue]:
        """The analysis as one record of numbers and texts, with the same keys for every case."""
        depths = [b.estimate for b in self.breaches if b.estimate is not None]
        deepest = min(depths, key=lambda each: each.distance_mm, default=None)
        risk = self.probability
        first = min(self.breaches, key=lambda b: b.lowest_sample_mm, default=None)
        return {
            "case": self.name,
            "frames": self.frames,
            "duration_s": self.duration_s,
            "breaches": len(self.breaches),
            "breach_seconds": sum((b.duration_s for b in self.breaches), 0.0),
            "deepest_mm": None if deepest is None else deepest.distance_mm,
            "deepest_low_mm": None if deepest is None else deepest.low_mm,
            "deepest_high_mm": None if deepest is None else deepest.high_mm,
            "lowest_sample_mm": self.percentiles_mm.get(0),
            "deepest_direction": "" if first is None else first.direction,
            "deepest_side": "" if first is None else first.side,
            "deepest_part": "" if first is None else first.part,
            "deepest_entry_speed_mm_s": None if first is None else first.entry_speed_mm_s,
            "jitter_sigma_mm": None if self.jitter is None else self.jitter.sigma_mm,
            **{f"distance_p{k}_mm": self.percentiles_mm.get(k) for k in PERCENTILES},
            **{f"seconds_{k.lower()}": v for k, v in self.state_seconds.items()},
            **{f"seconds_{k}": v for k, v in self.phase_seconds.items() if k != "unknown"},
            "breach_probability": None if risk is None else risk.outcome.probability,
            **{f"coverage_{k:g}_mm": self.coverage.share(k) for k in WITHIN_MM},
            **_resection_record(self.resection),
            **{f"insertion_{k}": v for k, v in asdict(self.insertion).items()},
            **{f"motion_{k}": v for k, v in asdict(self.motion).items()},
        }


def analyse_case(
    steps: "Iterable[StepResult] | CaseSamples",
    *,
    name: str,
    margins: MarginParameters,
    tumor: SurfaceMesh,
    tool: SurfaceMesh | None = None,
    ras_from_tumor: ArrayLike | None = None,
    jitter: Jitter | None = None,
    bias_sigma_mm: float = 0.0,
    covariances_mm2: Mapping[str, FloatArray] | None = None,
    stops_mm: tuple[float, ...] = (),
    cutting_mm: float | None = None,
    insertion: Insertion | None = None,
) -> CaseAnalysis:
    """Analyse the ``steps`` of a session, as `ReplayRun.steps` yields them; reads them once.
    Or the ``steps`` that were read before.

    ``name``, ``margins``, ``tumor`` and ``tool`` are those of the session's content; a ``tool`` of
    None is its tip alone. ``ras_from_tumor`` (3, 3) turns the tumour's axes to the patient's right,
    anterior and superior; without it the tumour's axes are taken as these. ``jitter`` replaces the
    estimated one. ``bias_sigma_mm`` as in `estimate_depth`; ``covariances_mm2`` and ``stops_mm`` as
    in `breach_probability`. ``cutting_mm``: length of the cutting part, whose swept volume is
    computed; None leaves it out. ``insertion``: the metrics of `case_insertion`, where they are
    known already. Raises `InputError` without a step.
    """
    axes = checked_axes(ras_from_tumor)
    samples = steps if isinstance(steps, CaseSamples) else CaseSamples.from_steps(steps)
    times, held = samples.times_s, samples.held_s
    measured = samples.measured()
    if jitter is None:
        jitter = estimate_jitter(times[measured], samples.distances_mm[measured])
    stale_ns = margins.stale_after_ns
    phases = phases_of(times, samples.distances_mm, margins.warn_mm)
    breaches = analyse_breaches(
        samples,
        jitter,
        stale_after_ns=stale_ns,
        centroid_mm=tumor.centroid_mm,
        ras_from_tumor=axes,
        bias_sigma_mm=bias_sigma_mm,
    )
    coverage = coverage_of(samples, tumor, tool)
    resection = None
    if cutting_mm is not None:
        resection = resection_of(
            samples,
            tumor,
            tool,
            stale_after_ns=stale_ns,
            cutting_mm=cutting_mm,
            ras_from_tumor=axes,
        )
    specimen = None if resection is None else resection.specimen
    return CaseAnalysis(
        name=name,
        times_s=times,
        distances_mm=samples.distances_mm,
        held_s=held,
        frames=len(times),
        duration_s=float(held.sum()),
        state_seconds={
            state.name: float(held[samples.states == state.value].sum()) for state in MarginState
        },
        percentiles_mm=_percentiles(samples.distances_mm[measured]),
        jitter=jitter,
        breaches=breaches,
        motion=motion_of(times, samples.tips_mm, stale_ns / NS_PER_S),
        phase_seconds=phase_seconds(phases, held),
        phase_counts=phase_counts(phases),
        coverage=coverage,
        insertion=insertion or case_insertion(samples, tumor),
        resection=resection,
        sides=side_results(
            tumor, coverage, breaches, specimen.margins_mm if specimen else {}, axes
        ),
        probability=None
        if not covariances_mm2 or len(measured) == 0
        else breach_probability(
            smoothed_distances(times, samples.distances_mm),
            samples.normals,
            held,
            covariances_mm2,
            stops_mm=stops_mm,
        ),
        anatomical=axes is not None,
    )


def _resection_record(found: Resection | None) -> dict[str, FlatValue]:
    swept = None if found is None else found.swept
    specimen = None if found is None else found.specimen
    return {
        "swept_mm3": None if swept is None else swept.volume_mm3,
        "specimen_mm3": None if specimen is None else specimen.volume_mm3,
        "specimen_margin_mm": None if specimen is None else specimen.margins_mm[specimen.closest],
        "specimen_side": "" if specimen is None else ANATOMICAL_WORDS[specimen.closest],
    }


def _percentiles(distances: FloatArray) -> dict[int, float]:
    if len(distances) == 0:
        return {}
    return dict(zip(PERCENTILES, np.percentile(distances, PERCENTILES).tolist(), strict=True))


def _breach_dict(breach: AnalysedBreach) -> dict[str, Any]:
    return {**asdict(breach), "duration_s": breach.duration_s}
