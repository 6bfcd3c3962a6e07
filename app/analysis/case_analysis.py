"""Analysis of one case: breaches, distances, states, motion, phases, coverage, insertion."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.analysis.breach_probability import (
    BreachProbability,
    breach_probability,
    smoothed_distances,
)
from app.analysis.case_breaches import AnalysedBreach, analyse_breaches, sides_of
from app.analysis.coverage import WITHIN_MM, Coverage, SideResult, coverage_of, side_results
from app.analysis.insertion import Insertion, case_insertion
from app.analysis.motion import Motion, motion_of
from app.analysis.samples import CaseSamples
from app.analysis.smoothing import Jitter, estimate_jitter
from app.analysis.specimen import Resection, resection_of
from app.fixture import MarginParameters, MarginState
from app.geometry import ANATOMICAL_WORDS, NS_PER_S, FloatArray, SurfaceMesh
from app.session import checked_axes

if TYPE_CHECKING:
    from app.session import StepResult

PHASES = ("unknown", "cutting", "approach", "away")
APPROACH_MM_S = 4.0
SLOPE_WINDOW_S = 0.4
MIN_RUN_S = 0.3
PERCENTILES = (0, 5, 25, 50, 75, 95, 100)
FlatValue = float | int | str | None


def phases_of(times_s: FloatArray, distances_mm: FloatArray, warn_mm: float) -> NDArray[np.int8]:
    """The phase of each frame, (n,), as an index of `PHASES`; unknown distances are NaN.

    A frame belongs to the first phase whose condition holds:

    - *unknown*: the distance is not known.
    - *cutting*: the distance is at most the warning distance of the case, also inside the tumour.
    - *approach*: the smoothed distance falls by at least `APPROACH_MM_S`.
    - *away*: everything else.

    The distance is smoothed over `SLOPE_WINDOW_S` for its slope. A run shorter than `MIN_RUN_S` is
    added to the one before it. A jump back of the clock takes no time.
    """
    times_s = _rising(times_s)
    known = np.isfinite(distances_mm)
    phases = np.zeros(len(times_s), dtype=np.int8)
    phases[known] = 3
    phases[known & (_slopes(times_s, distances_mm) <= -APPROACH_MM_S)] = 2
    with np.errstate(invalid="ignore"):
        phases[known & (distances_mm <= warn_mm)] = 1
    return _without_short_runs(times_s, phases)


def phase_seconds(phases: NDArray[np.int8], held_s: FloatArray) -> Mapping[str, float]:
    """Time in each phase; ``held_s`` (n,) is the duration of each frame."""
    return {name: float(held_s[phases == k].sum()) for k, name in enumerate(PHASES)}


def phase_counts(phases: NDArray[np.int8]) -> Mapping[str, int]:
    """Number of runs of each phase."""
    starts = np.append(True, phases[1:] != phases[:-1])
    return {name: int((phases[starts] == k).sum()) for k, name in enumerate(PHASES)}


def _rising(times: FloatArray) -> FloatArray:
    """``times`` without the steps back: what follows one continues at the same time."""
    steps = np.diff(times)
    if not (steps < 0.0).any():
        return times
    return np.asarray(times[0] + np.append(0.0, np.cumsum(np.maximum(steps, 0.0))))


def _slopes(times: FloatArray, distances: FloatArray) -> FloatArray:
    """Slope of the straight line through the known distances within `SLOPE_WINDOW_S`, in mm/s."""
    slopes = np.zeros(len(times))
    known = np.flatnonzero(np.isfinite(distances))
    if len(known) < 3:
        return slopes
    t, d = times[known], distances[known]
    sums = [np.concatenate([[0.0], np.cumsum(x)]) for x in (np.ones(len(t)), t, d, t * t, t * d)]
    first = np.searchsorted(t, t - 0.5 * SLOPE_WINDOW_S, side="left")
    last = np.searchsorted(t, t + 0.5 * SLOPE_WINDOW_S, side="right")
    n, st, sd, stt, std = (total[last] - total[first] for total in sums)
    spread = n * stt - st * st
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (n * std - st * sd) / spread
    slopes[known] = np.where((n >= 3) & (spread > 1e-9), slope, 0.0)
    return slopes


def _without_short_runs(times: FloatArray, phases: NDArray[np.int8]) -> NDArray[np.int8]:
    joined = phases.copy()
    starts = np.flatnonzero(np.append(True, phases[1:] != phases[:-1])).tolist()
    for start, end in zip(starts, [*starts[1:], len(phases)], strict=True):
        until = times[end] if end < len(phases) else times[-1]
        if start > 0 and until - times[start] < MIN_RUN_S and phases[start] != 0:
            joined[start:end] = joined[start - 1]
    return joined


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
            "breaches": [{**asdict(each), "duration_s": each.duration_s} for each in self.breaches],
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
    anterior and superior; without it the tumour's axes are taken as these. ``bias_sigma_mm`` as in
    `estimate_depth`; ``covariances_mm2`` and ``stops_mm`` as in `breach_probability`.
    ``cutting_mm``: length of the cutting part, whose swept volume is computed; None leaves it out.
    ``insertion``: the metrics of `case_insertion`, where they are known already. Raises
    `InputError` without a step.
    """
    axes = checked_axes(ras_from_tumor)
    samples = steps if isinstance(steps, CaseSamples) else CaseSamples.from_steps(steps)
    times, held = samples.times_s, samples.held_s
    measured = samples.measured()
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
