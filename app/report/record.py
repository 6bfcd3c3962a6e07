"""Input of a report: the results of a replay."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING

from app.analysis.samples import Breach, CaseSamples, SampleRow, find_breaches, sample_row
from app.case import Expected
from app.fixture import MarginParameters, MarginState
from app.geometry import NS_PER_S, Freshness, FreshnessLimits, freshness_of
from app.registration import RegistrationResult
from app.report.rows import ReportError, ReportRow
from app.runtime import PassiveOutput, StepTiming
from app.session import PathDepth, PathPoint, Role, StepResult, deepest_on_path

if TYPE_CHECKING:
    from app.runtime import ReplayRun  # slow to load: with the compiled kernels
    from app.session import ProximityModel, Structure

TOLERANCE_MM = 0.02
MAX_EVALUATIONS = 1000
"""Accuracy of the depth of a breach, and the limit of the work for one breach."""


@dataclass(slots=True)
class BreachPaths:
    """The measured poses of a replay that are inside the tumour, and those before and after.

    The rows of a report are frames. A tool that moves fast is deeper between two of them than in
    any: `breach_depths` finds the deepest point on the interpolated path.
    """

    _points: dict[int, tuple[PathPoint, ...]] = field(default_factory=dict)
    _before: dict[int, int] = field(default_factory=dict)
    _after: dict[int, int] = field(default_factory=dict)
    _last: tuple[int, PathPoint] | None = None
    _last_inside: bool = False

    def add(self, index: int, step: StepResult, *, inside: bool) -> None:
        """Add the step of row ``index``; ``inside`` as in `ReportRow`."""
        pose, proximity = step.tumor_from_tip, step.decision.proximity
        if pose is None or proximity is None or not proximity.is_finite:
            return
        if step.between_frames is None:
            points: tuple[PathPoint, ...] = (PathPoint(step.frame.stamp, pose, proximity),)
        else:
            points = (step.between_frames.deepest, step.between_frames.end)
        if self._last is not None and (inside or self._last_inside):
            last_index, last_point = self._last
            self._points.setdefault(last_index, (last_point,))
            self._before[index], self._after[last_index] = last_index, index
        if inside or self._last_inside:
            self._points[index] = points
        self._last, self._last_inside = (index, points[-1]), inside

    def points_of(self, breach: Breach, stale_after_ns: int) -> Sequence[PathPoint]:
        """The path of ``breach``, from the last pose before it to the first one after it.

        A pose that is more than ``stale_after_ns`` away is left out: where the tool was meanwhile
        is unknown.
        """
        indices = [index for index in self._points if breach.first <= index <= breach.last]
        points = [point for index in sorted(indices) for point in self._points[index]]
        limits = FreshnessLimits(stale_after_ns)
        before, after = self._before.get(breach.first), self._after.get(breach.last)
        if before is not None:
            point = self._points[before][-1]
            if freshness_of(point.stamp.ns, points[0].stamp.ns, limits) is Freshness.VALID:
                points.insert(0, point)
        if after is not None:
            point = self._points[after][0]
            if freshness_of(points[-1].stamp.ns, point.stamp.ns, limits) is Freshness.VALID:
                points.append(point)
        return points


def breach_depths(
    paths: BreachPaths, breaches: Sequence[Breach], model: "ProximityModel", stale_after_ns: int
) -> Mapping[int, PathDepth]:
    """The `PathDepth` of each breach, by the index of its first row."""
    return {
        breach.first: deepest_on_path(
            points,
            model.evaluate,
            radius_mm=model.radius_mm,
            tolerance_mm=TOLERANCE_MM,
            max_evaluations=MAX_EVALUATIONS,
        )
        for breach in breaches
        if (points := paths.points_of(breach, stale_after_ns))
    }


@dataclass(slots=True)
class StructureLog:
    """Rows of one structure, and the poses of the tool around its breaches."""

    name: str
    role: Role
    rows: list[ReportRow] = field(default_factory=list)
    paths: BreachPaths = field(default_factory=BreachPaths)

    def add(self, step: StepResult) -> ReportRow:
        """Keep the row of ``step``, which is that of this structure alone."""
        row = ReportRow.from_step(step)
        self.paths.add(len(self.rows), step, inside=row.inside)
        self.rows.append(row)
        return row


@dataclass(slots=True)
class ReplayLog(PassiveOutput):
    """`Output` that keeps a `ReportRow` of every step, and the whole of the deepest step.

    ``tumor`` and ``structures``, by name, are the logs of the tumour and the further structures.
    ``tools``: distance in mm of each other tool, NaN if not known, and stamp in ns, of each step.
    """

    tumor: StructureLog = field(default_factory=lambda: StructureLog("tumor", Role.TARGET))
    structures: dict[str, StructureLog] = field(default_factory=dict)
    tools: dict[str, list[tuple[float, int]]] = field(default_factory=dict)
    durations_ns: list[int] = field(default_factory=list)
    deepest: StepResult | None = None
    _deepest_mm: float | None = None
    _samples: list[SampleRow] = field(default_factory=list)

    @property
    def rows(self) -> list[ReportRow]:
        """The rows of the tumour."""
        return self.tumor.rows

    def samples(self) -> CaseSamples:
        """The steps for an analysis; raises `InputError` without a step."""
        return CaseSamples.from_rows(self._samples)

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Keep the row of ``step`` and the time that it took to compute."""
        row = self.tumor.add(step.of_tumor)
        self._samples.append(sample_row(step))
        for each in step.structures[1:]:
            log = self.structures.setdefault(each.name, StructureLog(each.name, each.role))
            log.add(step.of(each.name))
        for tool in step.tools:
            found = tool.proximity
            distance_mm = math.nan if found is None else found.signed_distance_mm
            self.tools.setdefault(tool.name, []).append((distance_mm, row.stamp_ns))
        self.durations_ns.append(timing.duration_ns)
        distance = row.signed_distance_mm
        if distance is not None and (self._deepest_mm is None or distance < self._deepest_mm):
            self._deepest_mm, self.deepest = distance, step
        return True


@dataclass(frozen=True, slots=True, eq=False)
class StructureRecord:
    """Rows, margins and depths of one further structure, as those of `ReplayRecord`."""

    name: str
    role: Role
    rows: tuple[ReportRow, ...]
    margins: MarginParameters
    depths: Mapping[int, PathDepth]


@dataclass(frozen=True, slots=True, eq=False)
class ReplayRecord:
    """All input of a report.

    ``provenance`` is the origin that the case states; ``notes`` are remarks of the reader (a
    truncated file, skipped samples). ``registration`` is None for a case without a robot,
    ``expected`` is None for a case without expected results. ``single_source``: nothing independent
    could contradict the tracker. ``depths`` are the deepest points on the interpolated path, by the
    index of the first row of a breach. All that is of the tumour; ``structures`` are the others.
    """

    case: str
    provenance: Mapping[str, str]
    rows: tuple[ReportRow, ...]
    margins: MarginParameters
    registration: RegistrationResult | None = None
    expected: Expected | None = None
    durations_ns: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()
    tip_only: bool = False
    single_source: bool = True
    depths: Mapping[int, PathDepth] = field(default_factory=dict)
    structures: tuple[StructureRecord, ...] = ()

    def require_frames(self) -> None:
        """Raise `ReportError` for a replay without frames."""
        if not self.rows:
            raise ReportError(f"case {self.case!r}: 0 frames; expected at least 1 for a report")


def record_of(run: "ReplayRun", log: ReplayLog) -> ReplayRecord:
    """The record of ``run``, whose steps ``log`` has received."""
    prepared = run.prepared
    case, setup = prepared.case, prepared.setup
    clock = prepared.clock
    stale_after_ns = setup.margins.stale_after_ns
    breaches = find_breaches(log.rows, stale_after_ns)
    estimated = () if clock is None else (f"offset of the joints' clock: {clock.reason}",)
    return ReplayRecord(
        case=case.manifest.name,
        provenance=asdict(case.manifest.provenance),
        rows=tuple(log.rows),
        margins=setup.margins,
        registration=None if setup.robot is None else setup.robot.registration,
        expected=case.expected(),
        durations_ns=tuple(log.durations_ns),
        notes=(*estimated, *case.notes(), *_notes_of(run, log)),
        tip_only=prepared.tip_only,
        single_source=run.session.single_source,
        depths=breach_depths(log.tumor.paths, breaches, setup.proximity, stale_after_ns),
        structures=tuple(
            _structure_record(structure, log.structures[structure.name], setup.margins)
            for structure in setup.structures
            if structure.name in log.structures
        ),
    )


def _structure_record(
    structure: "Structure", log: StructureLog, margins: MarginParameters
) -> StructureRecord:
    own, breaches = structure.margins(margins), find_breaches(log.rows, margins.stale_after_ns)
    depths = breach_depths(log.paths, breaches, structure.proximity, margins.stale_after_ns)
    return StructureRecord(log.name, log.role, tuple(log.rows), own, depths)


def _notes_of(run: "ReplayRun", log: ReplayLog) -> Iterator[str]:
    """Yield notes for the reader of the report that are no errors."""
    session = run.session
    if all(row.state is MarginState.UNKNOWN for row in log.rows):
        frames = ", ".join(session.known_frames) or "none"
        yield f"no frame was valid; the recording has the frames {frames}"
    for target, source in session.never_changed:
        yield f"{target} -> {source} never changed: taken for a fixed transform"
    yield from run.doubts.texts()
    for name, distances in log.tools.items():
        known = [each for each in distances if not math.isnan(each[0])]
        count, unknown = len(distances), len(distances) - len(known)
        nearest_mm, ns = min(known, default=(math.nan, 0))
        at_s = (ns - log.rows[0].stamp_ns) / NS_PER_S
        nearest = f"nearest {nearest_mm:.1f} mm at {at_s:.3f} s, " if known else ""
        yield f"tool {name!r}: {nearest}distance not known in {unknown} of {count} frames"
    robot = session.setup.robot
    if robot is None:
        if run.prepared.case.manifest.registration is not None:
            yield "registration is given, but there is no robot to register: it is not used"
        return
    yield from robot.robot.warnings
    if session.frames_problem:
        yield session.frames_problem
    for problem, count in run.robot_problems.items():
        yield f"robot not shown in {count} of {len(log.rows)} frames: {problem}"
