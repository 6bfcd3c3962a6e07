"""Session: one pure step from a tracker frame to a decision with its constraint."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from app.case import JointSample, TrackingFrame
from app.fixture import (
    FixtureDecision,
    MarginMonitor,
    MarginObservation,
    Proximity,
    Reason,
    RecentWitnesses,
    path_mm,
)
from app.geometry import (
    FloatArray,
    FrameError,
    Freshness,
    Stamp,
    Transform,
    freshness_of_stamp,
)
from app.registration import RegistrationDrift, tre_at
from app.robot import JointError, UnreachableError
from app.session.following import OUT_OF_REACH, IkFollower
from app.session.known_edges import NO_EDGES, KnownEdges, known_edges
from app.session.named_frames import base_measured_problem
from app.session.plausibility.plausibility import Plausibility
from app.session.pose_tree import Edge, PoseTree
from app.session.setup import REFERENCE, RobotSetup, SessionSetup
from app.session.tumor_velocity import TumorVelocity

MAX_CAUSES = 8
"""Most causes of a hold that are kept."""

NOTHING_OUTSIDE: Mapping[Reason, str] = MappingProxyType({})
"""No faults outside the frames."""


@dataclass(frozen=True, slots=True, eq=False)
class StepResult:
    """Result of one step.

    ``tumor_from_tip`` is None when the tool or the tumour is not known. ``links`` holds
    ``root_from_link`` for every link of the robot; ``robot_problem`` is the reason if it is empty
    although there is a robot. ``virtual_fixture`` is ``tumor_from_virtual_fixture``, None without a
    constraint. ``drift`` is the difference between the tracked tool and the tool predicted from
    joints and registration, None if one of them is not known. ``frames_problem`` describes an
    error in the frames that the tracker measures, empty if there is none. ``playback`` describes a
    recording that is played on the graph of a live session, empty if there is none.
    ``hold_causes`` are texts on what began and prolonged the present hold, oldest first; empty
    without a hold. ``single_source`` is True if nothing independent can contradict the tracker.
    ``edges`` are those that the step used, for twists in other frames.

    >>> import marginguard as mg
    >>> case = mg.open_case(mg.example_case())
    >>> step = next(mg.replay(case))
    >>> step.index, step.decision.state.name, str(step.decision.reasons[0])
    (0, 'NEGATIVE', 'clear')
    """

    index: int
    frame: TrackingFrame
    decision: FixtureDecision
    tumor_from_tip: Transform | None
    virtual_fixture: Transform | None
    links: Mapping[str, Transform]
    joints: JointSample | None
    robot_problem: str = ""
    drift: RegistrationDrift | None = None
    frames_problem: str = ""
    playback: str = ""
    hold_causes: tuple[str, ...] = ()
    single_source: bool = False
    edges: KnownEdges = NO_EDGES


@dataclass(frozen=True, slots=True, eq=False)
class _LastPose:
    """Pose and proximity of the tool at ``stamp``."""

    stamp: Stamp
    tumor_from_tip: Transform
    proximity: Proximity


class Session:
    """Joins tracking, registration, robot and fixture. Reads no clock: frames carry the time."""

    def __init__(self, setup: SessionSetup) -> None:
        self.setup = setup
        self._tumor_from_frame = setup.frame_from_tumor.inverse()
        self._poses = PoseTree(
            limits=setup.margins.freshness_limits,
            moving_frames=_moving_frames(setup),
        )
        self._recent = RecentWitnesses()
        self._monitor = MarginMonitor(setup.margins, frame=setup.frame_from_tumor.source)
        self._follower = _follower(setup.robot)
        self._velocity = _velocity(setup)
        self._joints: JointSample | None = None
        self._plausibility = Plausibility(setup)
        self._checked_edges: tuple[Edge, ...] = ()
        self._frames_problem = ""
        self._last: _LastPose | None = None
        self._virtual_fixture: Transform | None = None
        self._hold_causes: tuple[str, ...] = ()
        self._index = -1

    def step(
        self, frame: TrackingFrame, outside: Mapping[Reason, str] = NOTHING_OUTSIDE
    ) -> StepResult:
        """Make ``frame`` the present and decide on the margin.

        ``outside``: faults that the caller found outside the frame, with a text for each.

        Never raises for bad data from a tracker or a robot: bad samples make the margin UNKNOWN
        and are named in the decision's reasons. If the tool passed through the tumour since the
        last frame, this frame counts as inside. Raises `StampError` for stamps of another clock
        than the frame's, a mistake of the caller.
        """
        self._index += 1
        problems = self._poses.insert(self._plausibility.admitted(frame, self._poses))
        if problems:  # the clock went back: no sweep from the pose before the jump
            self._last = None
        tool = self._poses.pose(self.setup.frame_from_tumor.target, self.setup.tool_from_tip.target)
        tumor_from_tip = None
        if tool.transform is not None:
            tumor_from_tip = self._tumor_from_frame @ tool.transform @ self.setup.tool_from_tip
        in_reference = self._poses.pose(REFERENCE, self.setup.tool_from_tip.target)
        reference_from_tip = None
        if in_reference.transform is not None:
            reference_from_tip = in_reference.transform @ self.setup.tool_from_tip
        links, robot_problem = self._links(frame, reference_from_tip)
        sigma_tre_mm, registration_problems = self._registration_at_tip(
            reference_from_tip, in_reference.problems
        )
        drift = self._plausibility.drift(links, reference_from_tip, frame.stamp)
        found = {**self._plausibility.faults(self._poses, frame.stamp), **outside}
        if self._is_base_measured():
            problems |= {Reason.REGISTRATION_REFUSED}
        # The constraint reaches the robot through the reference frame.
        used = (tool,) if self.setup.robot is None else (tool, in_reference)
        proximity, swept = self._proximity(tumor_from_tip, tool.oldest, frame.stamp)
        decision = self._monitor.update(
            MarginObservation(
                now=frame.stamp,
                stamp=min((pose.oldest for pose in used if pose.oldest is not None), default=None),
                proximity=proximity,
                swept=swept,
                problems=problems | tool.problems | registration_problems | found.keys(),
                sigma_tre_mm=sigma_tre_mm,
                unchanged_ns=max(pose.unchanged_ns for pose in used),
                tumor_twist=self._tumor_twist(frame.stamp),
            )
        )
        self._note_hold(decision, found)
        if decision.constraint is not None:
            self._virtual_fixture = decision.constraint.fixture_frame(self._virtual_fixture)
        return StepResult(
            index=self._index,
            frame=frame,
            decision=decision,
            tumor_from_tip=tumor_from_tip,
            virtual_fixture=self._virtual_fixture if decision.constraint is not None else None,
            links=links,
            joints=self._joints,
            robot_problem=robot_problem,
            drift=drift,
            frames_problem="; ".join(filter(None, [self._frames_problem, *found.values()])),
            hold_causes=self._hold_causes,
            edges=known_edges(self.setup, self._poses.usable(), links, self._joints),
            single_source=self.single_source,
        )

    def hold(self, cause: str) -> None:
        """Latch ``hold`` from the next step on, for a ``cause`` that is not visible in the frames.

        ``cause`` is a text for the operator, which `StepResult.hold_causes` shows until `rearm`.
        """
        self._monitor.hold()
        self._add_cause(cause)

    @property
    def latched(self) -> bool:
        """True if ``hold`` is latched: a run that begins now must not begin without it."""
        return self._monitor.latched

    @property
    def hold_causes(self) -> tuple[str, ...]:
        """Causes of the present hold, as in `StepResult.hold_causes`."""
        return self._hold_causes

    def rearm(self) -> None:
        """Release the hold of an earlier fault; raises `NotRearmableError` while UNKNOWN."""
        self._monitor.rearm()
        self._hold_causes = ()

    def use(self, setup: SessionSetup) -> None:
        """Replace the setup from the next step on. Not to be called during a step.

        If the tumour, the tool, the registration or a pose of one of them changes, the state is
        UNKNOWN up to the next full evaluation, and ``hold`` is latched until `rearm` if the margin
        was known before. Raises `FrameError` for a tumour in another frame, because the constraint
        is expressed in it.
        """
        tumor, known = setup.frame_from_tumor.source, self.setup.frame_from_tumor.source
        if tumor != known:
            raise FrameError(f"the tumour's frame is {tumor!r}; expected {known!r}, as before")
        before, self.setup = self.setup, setup
        self._poses.limits = setup.margins.freshness_limits
        self._poses.moving_frames = _moving_frames(setup)
        self._monitor.parameters = setup.margins
        self._plausibility.use(setup, before)
        if setup.tumor_motion != before.tumor_motion:
            self._velocity = _velocity(setup)
        if setup.robot is not before.robot:
            self._follower = _follower(setup.robot)
            self._checked_edges, self._frames_problem = (), ""
            self._monitor.restart()
        if (setup.proximity, setup.tool_from_tip, setup.frame_from_tumor) != (
            before.proximity,
            before.tool_from_tip,
            before.frame_from_tumor,
        ):
            self._tumor_from_frame = setup.frame_from_tumor.inverse()
            self._recent = RecentWitnesses()
            self._last = None
            self._virtual_fixture = None
            self._velocity = _velocity(setup)
            self._monitor.restart()

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

    def _note_hold(self, decision: FixtureDecision, texts: Mapping[Reason, str]) -> None:
        """Update the causes of the hold after ``decision``; ``texts`` describe its faults."""
        if not decision.hold:
            self._hold_causes = ()
            return
        for reason in decision.reasons:
            if reason.is_fault and reason is not Reason.RECOVERING:
                self._add_cause(texts.get(reason) or reason.text)

    def _add_cause(self, cause: str) -> None:
        """Append ``cause``; beyond `MAX_CAUSES` the first ones and the newest are kept."""
        if cause not in self._hold_causes:
            self._hold_causes = (*self._hold_causes[: MAX_CAUSES - 1], cause)

    def _is_base_measured(self) -> bool:
        """True if the tracker measures the robot's base, which the registration places.

        The first such edge may come with any frame; the result then stays True.
        """
        edges = self._poses.edges
        if edges != self._checked_edges:
            self._checked_edges = edges
            self._frames_problem = base_measured_problem(self.setup, edges)
        return bool(self._frames_problem)

    def _is_fresh(self, stamp: Stamp, now: Stamp) -> bool:
        return freshness_of_stamp(stamp, now, self._poses.limits) is Freshness.VALID

    def _tumor_twist(self, now: Stamp) -> FloatArray | None:
        if self._velocity is None:
            return None
        reference_from_frame = self._poses.pose(REFERENCE, self.setup.frame_from_tumor.target)
        return self._velocity.twist(reference_from_frame, now, self._poses.limits)

    def _proximity(
        self, tumor_from_tip: Transform | None, stamp: Stamp | None, now: Stamp
    ) -> tuple[Proximity | None, Proximity | None]:
        """Proximity of the tool now, and of its deepest pose if it passed through the tumour.

        The second is None without a breach on the path from the last known pose. Frames in which
        the tool was lost are skipped.
        """
        if tumor_from_tip is None or stamp is None:
            return None, None
        model = self.setup.proximity
        here = self._recent.augment(model.evaluate(tumor_from_tip, stamp), tumor_from_tip)
        last, self._last = self._last, _LastPose(now, tumor_from_tip, here)
        if last is None or not self._is_fresh(last.stamp, now):
            return here, None
        before = last.proximity
        outside = min(before.signed_distance_mm, here.signed_distance_mm) > 0.0
        # To touch the tumour, a point of the tool travels at least both distances.
        way_mm = path_mm(last.tumor_from_tip, tumor_from_tip, model.radius_mm)
        if not outside or way_mm < before.lower_bound_mm + here.lower_bound_mm:
            return here, None
        swept = model.sweep(last.tumor_from_tip, tumor_from_tip, stamp)
        return here, swept.lowest if swept.lowest.signed_distance_mm <= 0.0 else None

    def _registration_at_tip(
        self, tip: Transform | None, problems: frozenset[Reason]
    ) -> tuple[float, frozenset[Reason]]:
        """Standard deviation in mm of the registration at the tip, and the registration's problems.

        Without a robot both are empty. With one, the tip must be known in the reference frame,
        because the constraint reaches the robot through it. A given registration has no covariance
        and adds nothing. ``tip`` is ``reference_from_tip``; if it is None, ``problems`` holds why.
        """
        robot = self.setup.robot
        if robot is None:
            return 0.0, frozenset()
        registration = robot.registration
        if registration is None:
            return 0.0, frozenset({Reason.REGISTRATION_MISSING})
        if not registration.accepted:
            problems |= {Reason.REGISTRATION_REFUSED}
        if tip is None or registration.covariance is None:
            return 0.0, problems
        return tre_at(registration, tip.translation_mm), problems

    def _links(
        self, frame: TrackingFrame, reference_from_tip: Transform | None
    ) -> tuple[Mapping[str, Transform], str]:
        """``root_from_link`` of all links from the latest joints, or none and the problem.

        Without recorded joints: by inverse kinematics of the tracked ``reference_from_tip``.
        """
        if frame.joints:
            self._joints = frame.joints[-1]
        robot = self.setup.robot
        if robot is None:
            return {}, ""
        if robot.follows_tool:
            return self._followed(reference_from_tip)
        if self._joints is None:
            return {}, "no joint positions yet"
        if not self._is_fresh(self._joints.stamp, frame.stamp):
            return {}, "joint positions are stale or from the future"
        try:
            positions = self._joints.as_mapping()
            return robot.robot.measured_kinematics(robot.tool_link, positions), ""
        except JointError as error:
            return {}, str(error)

    def _followed(
        self, reference_from_tip: Transform | None
    ) -> tuple[Mapping[str, Transform], str]:
        if self._follower is None or reference_from_tip is None:
            return {}, "the tool is not seen in the reference frame: the robot cannot follow it"
        try:
            return self._follower.links(reference_from_tip), ""
        except UnreachableError as error:
            return {}, f"{OUT_OF_REACH}: {error}"


def _moving_frames(setup: SessionSetup) -> tuple[str, ...]:
    moving = (setup.tool_from_tip.target, setup.frame_from_tumor.target)
    return moving if setup.robot is None else (*moving, REFERENCE)


def _follower(robot: RobotSetup | None) -> IkFollower | None:
    return IkFollower(robot) if robot is not None and robot.follows_tool else None


def _velocity(setup: SessionSetup) -> TumorVelocity | None:
    if setup.tumor_motion is None:
        return None
    return TumorVelocity(setup.tumor_motion, setup.frame_from_tumor)
