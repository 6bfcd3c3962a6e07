"""Session: one pure step from a tracker frame to a decision with its constraint."""

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from app.case import TrackingFrame
from app.fixture import Reason
from app.geometry import Edge, FrameError, Stamp, Transform
from app.hold import Hold, tightest_margins
from app.session.combined_decision import CombinedDecision
from app.session.far_structures import FarDistance, FarStructures
from app.session.link_poses import RobotLinks
from app.session.loosening import AcknowledgedSetup
from app.session.named_frames import base_measured_problem
from app.session.pose_plausibility import Plausibility, motion_limits
from app.session.pose_tree import MeasuredPose, PoseRules, PoseTree, oldest
from app.session.setup import REFERENCE, SessionSetup
from app.session.step_result import StepResult, known_edges
from app.session.structure import Structure, StructureStep
from app.session.structure_guard import Observed, StructureGuard
from app.session.tool_distances import ToolDistances

NOTHING_OUTSIDE: Mapping[Reason, str] = MappingProxyType({})
"""No faults outside the frames."""


class Session:
    """Joins tracking, registration, robot and fixture. Reads no clock: frames carry the time.

    ``free_motion``: a controller obeys the constraints, so they say how far its tool may move.
    ``skip_far``: structures and other tools that are far are not measured
    (`app.session.far_structures`).
    """

    def __init__(
        self, setup: SessionSetup, *, free_motion: bool = False, skip_far: bool = False
    ) -> None:
        self.setup = self.requested = setup
        self._free_motion = free_motion
        self._static_edges = setup.static_edges
        self._poses = PoseTree(_pose_rules(setup))
        self._tool_frames = _tool_frames(setup)
        self._guards = [self._guard(each) for each in setup.guarded]
        self._combined = CombinedDecision()
        self._skip_far = skip_far
        self._far = self._new_far(setup)
        others = setup.other_tools
        self._tools = ToolDistances(setup, skip_far=skip_far) if others else None
        self._links = RobotLinks(setup.robot)
        self._plausibility = Plausibility(setup)
        self._checked_edges: tuple[Edge, ...] = ()
        self._frames_problem = ""
        self._virtual_fixture: Transform | None = None
        self._hold = Hold()
        self._acknowledged = AcknowledgedSetup(setup)
        self._index = -1

    def step(
        self, frame: TrackingFrame, outside: Mapping[Reason, str] = NOTHING_OUTSIDE
    ) -> StepResult:
        """Make ``frame`` the present and decide on the margin.

        ``outside``: faults that the caller found outside the frame, with a text for each.

        Never raises for bad data from a tracker or a robot: bad samples make the margin UNKNOWN
        and are named in the decision's reasons. If the tool passed through the tumour since the
        last frame, this frame counts as inside. Raises `StampError` for stamps of another clock
        than the frame's, a mistake of the caller. Every error latches the hold.
        """
        try:
            return self._step(frame, outside)
        except Exception:
            self._hold.latch_by_error()
            raise

    def _step(self, frame: TrackingFrame, outside: Mapping[Reason, str]) -> StepResult:
        self._index += 1
        problems = self._poses.insert(frame)
        if problems:  # the clock went back
            for guard in self._guards:
                guard.forget_path()
            if self._far is not None:
                self._far.forget_path()
        tip = self.setup.tool_from_tip
        tips = {
            frame: self._poses.pose(frame, tip.target, inner=tip) for frame in self._tool_frames
        }
        reference_from_tip = tips[REFERENCE].transform
        links, robot_problem = self._links.at(frame, reference_from_tip, self._poses.limits)
        drift = self._plausibility.drift(links, self._links.joints, reference_from_tip, frame.stamp)
        found = self._plausibility.faults(self._poses, frame.stamp)
        if outside:
            found = {**found, **outside}
        if self._is_base_measured():
            problems |= {Reason.REGISTRATION_REFUSED}
        observed, far = self._observe(frame.stamp, tips, problems | found.keys())
        structures = self._decide(observed, far, tips)
        far_mm = min([each.clearance_mm for each in far.values()]) if far else math.inf
        combined = self._combined.of(structures, self.setup.proximity.radius_mm, far_mm)
        decision = self._hold.applied(combined, found, [each.decision for each in structures])
        if self._far is not None:
            decisions = {number: structures[number].decision for number in observed}
            self._far.end(frame.stamp, far, decisions)
        if decision.constraint is not None:
            self._virtual_fixture = decision.constraint.fixture_frame(self._virtual_fixture)
        others = (
            ()
            if self._tools is None
            else self._tools.update(self._poses.accepted, problems | found.keys())
        )
        return StepResult(
            index=self._index,
            frame=frame,
            decision=decision,
            tumor_from_tip=structures[0].structure_from_tip,
            virtual_fixture=self._virtual_fixture if decision.constraint is not None else None,
            links=links,
            joints=self._links.joints,
            robot_problem=robot_problem,
            drift=drift,
            frames_problems=tuple(filter(None, [self._frames_problem, *found.values()])),
            hold_causes=self._hold.causes,
            edges=known_edges(
                self._static_edges,
                self.setup.robot,
                self._poses.usable(),
                links,
                self._links.joints,
            ),
            single_source=self.single_source,
            between_frames=structures[0].between_frames,
            structures=structures if len(structures) > 1 else (),
            half_spaces_of=self._combined.half_spaces_of,
            off=self.setup.off,
            tools=others,
        )

    def _observe(
        self,
        now: Stamp,
        tips: Mapping[str, MeasuredPose],
        problems: frozenset[Reason],
    ) -> tuple[dict[int, Observed], dict[int, FarDistance]]:
        """Measurements of the structures by number, the first one's first, and the far others.

        The governing structure is measured: the smallest clearance is not that of a far one.
        """

        def observe(number: int) -> Observed:
            self._wake(number)
            guard = self._guards[number]
            return guard.observe(self._poses, now, tips, problems)

        observed = {0: observe(0)}
        far = {} if self._far is None else self._far.found(tips, observed[0].observation)
        for number in range(1, len(self._guards)):
            if number not in far:
                observed[number] = observe(number)
        while far:
            nearest = min(far, key=lambda number: far[number].clearance_mm)
            measured_mm = min(each.largest_clearance_mm for each in observed.values())
            if measured_mm <= far[nearest].clearance_mm:
                break
            observed[nearest] = observe(nearest)
            del far[nearest]
        return observed, far

    def _wake(self, number: int) -> None:
        """Let the guard of a structure continue if it was far at the last step."""
        seen = None if self._far is None else self._far.last_seen(number)
        if seen is not None:
            self._guards[number].continue_from(*seen)

    def _decide(
        self,
        observed: Mapping[int, Observed],
        far: Mapping[int, FarDistance],
        tips: Mapping[str, MeasuredPose],
    ) -> tuple[StructureStep, ...]:
        decided = {number: each.guard.decide(each) for number, each in observed.items()}
        for number, distance in far.items():
            guard = self._guards[number]
            poses = tips[guard.structure.frame_from_structure.target], tips[REFERENCE]
            used = poses if self.setup.robot is not None else poses[:1]
            stamp = oldest(used)
            seq = decided[0].decision.seq
            decided[number] = guard.far(distance.at_least_mm, stamp, seq)
        return tuple([decided[number] for number in range(len(self._guards))])

    def hold(self, cause: str, *, doubt: bool = False) -> None:
        """Latch ``hold`` from the next step on, for a ``cause`` that is not visible in the frames.

        ``cause`` is a text for the operator, which `StepResult.hold_causes` shows until `rearm`.
        With ``doubt`` no pose of the tool is known to be true until then.
        """
        self._hold.latch(cause, doubt=doubt)

    @property
    def latched(self) -> bool:
        """True if ``hold`` is latched: a run that begins now must not begin without it."""
        return self._hold.latched

    def rearm(self) -> None:
        """Release the hold of an earlier fault; raises `NotRearmableError` while UNKNOWN."""
        self._hold.rearm()
        self._use(self.requested)
        self._acknowledged.acknowledge(self.setup)

    @property
    def hold_causes(self) -> tuple[str, ...]:
        """Causes that began or prolonged the present hold, as in `StepResult.hold_causes`."""
        return self._hold.causes

    def use(self, setup: SessionSetup, *, tumor_change: str = "") -> bool:
        """Replace the setup from the next step on. Not to be called during a step.

        A change that loosens what the session permits (`app.session.loosening`) latches ``hold``
        until `rearm`, with its text in `hold_causes`; then the result is True. Looser margins apply
        from that re-arm on: ``setup`` is then `requested`, not yet in use. If the tumour, the tool,
        the registration or a pose of one of them changes, or a structure is replaced or gone, the
        state is also UNKNOWN up to the next full evaluation; an added structure is guarded from the
        next step on. ``tumor_change`` describes a new tumour for the operator. Raises
        `FrameError` for a tumour in another frame, because the constraint is expressed in it.
        """
        tumor, known = setup.frame_from_tumor.source, self.setup.frame_from_tumor.source
        if tumor != known:
            raise FrameError(f"the tumour's frame is {tumor!r}; expected {known!r}, as before")
        loosened = self._acknowledged.change(self.setup, setup, tumor_change)
        self._hold.change(self._acknowledged.changes, latch=loosened)
        if loosened and _places(setup) != _places(self.setup):
            # A retreat from a tumour that no operator has acknowledged may approach the true one.
            self._hold.doubt()
        self.requested = setup
        margins = tightest_margins(
            self.setup.margins, setup.margins, follows_tumor=setup.tumor_motion is not None
        )
        former = {each.name: each for each in self.setup.structures}
        structures = tuple(each.at_least(former.get(each.name, each)) for each in setup.structures)
        unchanged = (margins, structures) == (setup.margins, setup.structures)
        self._use(setup if unchanged else replace(setup, margins=margins, structures=structures))
        return loosened

    def _use(self, setup: SessionSetup) -> None:
        before, self.setup = self.setup, setup
        self._static_edges = setup.static_edges
        self._poses.use(_pose_rules(setup))
        self._tool_frames = _tool_frames(setup)
        for number in range(len(self._guards)):
            self._wake(number)
        if self._far is None or not setup.structures:
            self._far = self._new_far(setup)
        else:
            self._far.use(setup)
        if self._tools is not None:
            self._tools.use(setup)
        self._plausibility.use(setup, before)
        motion_changed = (setup.tumor_motion, setup.motion_frame) != (
            before.tumor_motion,
            before.motion_frame,
        )
        known = {guard.structure.name: guard for guard in self._guards}
        self._guards, replaced = [], not known.keys() <= {each.name for each in setup.guarded}
        for structure in setup.guarded:
            guard = known.get(structure.name)
            if guard is None:
                guard = self._guard(structure)
            elif guard.use(structure, setup, motion_changed=motion_changed):
                replaced = True
            self._guards.append(guard)
        if setup.robot is not before.robot:
            self._links.use(setup.robot)
            self._checked_edges, self._frames_problem = (), ""
        if replaced:
            self._virtual_fixture = None
        if replaced or setup.robot is not before.robot:
            self._restart()

    def _new_far(self, setup: SessionSetup) -> FarStructures | None:
        """None for the tumour alone, which is never far."""
        return FarStructures(setup) if self._skip_far and setup.structures else None

    def _guard(self, structure: Structure) -> StructureGuard:
        return StructureGuard(structure, self.setup, free_motion=self._free_motion)

    def _restart(self) -> None:
        for guard in self._guards:
            guard.restart()
        self._combined.restart()
        self._hold.restart()

    @property
    def never_changed(self) -> tuple[tuple[str, str], ...]:
        """Measured edges (target, source) whose pose has not changed since the first frame."""
        return self._poses.never_changed()

    @property
    def known_frames(self) -> tuple[str, ...]:
        """Names of all frames that the tracker has measured so far."""
        return self._poses.known_frames()

    @property
    def single_source(self) -> bool:
        """True if nothing independent can contradict the tracker."""
        return self._plausibility.single_source

    @property
    def frames_problem(self) -> str:
        """Error in the frames that the tracker has measured so far; empty if there is none."""
        return self._frames_problem

    def _is_base_measured(self) -> bool:
        """True if the tracker measures the robot's base, which the registration places.

        The first such edge may come with any frame; the result then stays True.
        """
        edges = self._poses.edges
        if edges is not self._checked_edges:
            self._checked_edges = edges
            self._frames_problem = base_measured_problem(self.setup, edges)
        return bool(self._frames_problem)


def _places(setup: SessionSetup) -> tuple[object, ...]:
    """The values that determine the places of tool, tumour and robot."""
    shapes = [(each.proximity, each.frame_from_structure) for each in setup.guarded]
    return setup.tool_from_tip, setup.robot, *shapes


def _pose_rules(setup: SessionSetup) -> PoseRules:
    return PoseRules(
        setup.margins.freshness_limits,
        setup.moving_frames,
        setup.shown_frames,
        motion_limits(setup.plausibility),
        setup.measured_ends,
    )


def _tool_frames(setup: SessionSetup) -> tuple[str, ...]:
    """The frames in which the tip's pose is needed, beside that of a single structure."""
    if not setup.structures:
        return (REFERENCE,)
    structures = (each.frame_from_structure.target for each in setup.guarded)
    return tuple(dict.fromkeys((REFERENCE, *structures)))
