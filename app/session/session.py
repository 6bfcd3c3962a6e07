"""One pure step: a tracker frame in, a decision with its constraint out."""

from collections.abc import Mapping
from dataclasses import dataclass

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
from app.registration import RegistrationDrift, check_drift, tre_at
from app.robot import JointError, UnreachableError
from app.session.following import OUT_OF_REACH, IkFollower
from app.session.named_frames import placed_twice
from app.session.pose_tree import Edge, PoseTree
from app.session.setup import REFERENCE, RobotSetup, SessionSetup
from app.session.tumor_velocity import TumorVelocity


@dataclass(frozen=True, slots=True, eq=False)
class StepResult:
    """What one step found.

    ``tumor_from_tip`` is None when the tool or the tumour is not known; ``links`` holds
    ``root_from_link`` for every link of the robot; where it is empty although there is a robot,
    ``robot_problem`` says why. ``virtual_fixture`` is ``tumor_from_virtual_fixture``, None without
    a constraint. ``drift`` compares where the registration puts the tool with where it is seen,
    None where one of the two is not known. ``frames_problem`` tells in words what is wrong with the
    frames that the tracker names, empty when nothing is.
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


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """Where the tool was at ``stamp``, and how near it was there."""

    stamp: Stamp
    tumor_from_tip: Transform
    proximity: Proximity


class Session:
    """Joins tracking, registration, robot and fixture. Reads no clock: time is in the frames."""

    def __init__(self, setup: SessionSetup) -> None:
        self.setup = setup
        self._tumor_from_frame = setup.frame_from_tumor.inverse()
        self._reference_from_root = _reference_from_root(setup.robot)
        self._poses = PoseTree(
            limits=setup.margins.freshness_limits,
            moving_frames=_moving_frames(setup),
        )
        self._recent = RecentWitnesses()
        self._monitor = MarginMonitor(setup.margins, frame=setup.frame_from_tumor.source)
        self._follower = _follower(setup.robot)
        self._velocity = _velocity(setup)
        self._joints: JointSample | None = None
        self._drifted = False
        self._looked_at: tuple[Edge, ...] = ()
        self._frames_problem = ""
        self._last: _Place | None = None
        self._virtual_fixture: Transform | None = None
        self._index = -1

    def step(self, frame: TrackingFrame) -> StepResult:
        """Take ``frame`` as the present and decide on the margin.

        Never raises for what a tracker or a robot can say: bad samples make the margin UNKNOWN
        and are named in the decision's reasons. A tool that went through the tumour since the last
        frame is in it now, for one frame. Stamps of another clock than the frame's are a mistake
        of the caller and raise `StampError`.
        """
        self._index += 1
        problems = self._poses.insert(frame)
        if problems:  # the clock went back: where the tool was before says nothing of its way
            self._last = None
        tool = self._poses.pose(self.setup.frame_from_tumor.target, self.setup.tool_from_tip.target)
        tumor_from_tip = None
        if tool.transform is not None:
            tumor_from_tip = self._tumor_from_frame @ tool.transform @ self.setup.tool_from_tip
        in_reference = self._poses.pose(REFERENCE, self.setup.tool_from_tip.target)
        seen = None
        if in_reference.transform is not None:
            seen = in_reference.transform @ self.setup.tool_from_tip
        links, robot_problem = self._links(frame, seen)
        sigma_tre_mm, registration_problems = self._registration_at_tip(seen, in_reference.problems)
        drift = self._drift(links, seen)
        if drift is not None:
            self._drifted = not drift.accepted
        if self._is_placed_twice():
            problems |= {Reason.REGISTRATION_REFUSED}
        # A drift that was seen is not over because the robot has fallen silent.
        if self._drifted:
            problems |= {Reason.REGISTRATION_DRIFT}
        # The constraint reaches the robot through the reference frame.
        used = (tool,) if self.setup.robot is None else (tool, in_reference)
        proximity, swept = self._proximity(tumor_from_tip, tool.oldest, frame.stamp)
        decision = self._monitor.update(
            MarginObservation(
                now=frame.stamp,
                stamp=min((pose.oldest for pose in used if pose.oldest is not None), default=None),
                proximity=proximity,
                swept=swept,
                problems=problems | tool.problems | registration_problems,
                sigma_tre_mm=sigma_tre_mm,
                unchanged_ns=max(pose.unchanged_ns for pose in used),
                tumor_twist=self._tumor_twist(frame.stamp),
            )
        )
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
            frames_problem=self._frames_problem,
        )

    def hold(self) -> None:
        """Latch ``hold`` from the next step on, for a fault that the steps do not tell."""
        self._monitor.hold()

    def rearm(self) -> None:
        """End the hold of an earlier fault; `NotRearmableError` while the state is UNKNOWN."""
        self._monitor.rearm()

    def use(self, setup: SessionSetup) -> None:
        """Go on with ``setup`` from the next step on; not to be called during a step.

        With another tumour, tool, registration or place of one of them nothing is known of the
        margin any more: the state is UNKNOWN up to the next full evaluation, and ``hold`` is
        latched until `rearm` if the margin was known before. Raises `FrameError` for a tumour in
        another frame, since that is what the constraint is given in.
        """
        tumor, known = setup.frame_from_tumor.source, self.setup.frame_from_tumor.source
        if tumor != known:
            raise FrameError(f"the tumour's frame is {tumor!r}: {known!r} wanted, as before")
        before, self.setup = self.setup, setup
        self._poses.limits = setup.margins.freshness_limits
        self._poses.moving_frames = _moving_frames(setup)
        self._monitor.parameters = setup.margins
        if setup.tumor_motion != before.tumor_motion:
            self._velocity = _velocity(setup)
        if setup.robot is not before.robot:
            self._drifted = False
            self._reference_from_root = _reference_from_root(setup.robot)
            self._follower = _follower(setup.robot)
            self._looked_at, self._frames_problem = (), ""
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
        """Measured edges (target, source) that have repeated one pose from the first frame on."""
        return self._poses.never_changed()

    @property
    def known_frames(self) -> tuple[str, ...]:
        """Every frame that the tracker has named so far."""
        return self._poses.known_frames()

    @property
    def frames_problem(self) -> str:
        """What is wrong with the frames that the tracker has named so far; empty when nothing."""
        return self._frames_problem

    def _is_placed_twice(self) -> bool:
        """Whether the tracker measures the robot's base, which the registration places.

        It may begin to at any frame; then it is so for as long as its edges are known.
        """
        edges = self._poses.edges
        if edges != self._looked_at:
            self._looked_at = edges
            self._frames_problem = placed_twice(self.setup, edges)
        return bool(self._frames_problem)

    def _is_fresh(self, stamp: Stamp, now: Stamp) -> bool:
        return freshness_of_stamp(stamp, now, self._poses.limits) is Freshness.VALID

    def _tumor_twist(self, now: Stamp) -> FloatArray | None:
        if self._velocity is None:
            return None
        seen = self._poses.pose(REFERENCE, self.setup.frame_from_tumor.target)
        return self._velocity.twist(seen, now, self._poses.limits)

    def _proximity(
        self, tumor_from_tip: Transform | None, stamp: Stamp | None, now: Stamp
    ) -> tuple[Proximity | None, Proximity | None]:
        """Of the tool where it is, and of where it went through the tumour to get there, if so.

        The way is that from where it was last known, frames in which it was lost left out.
        """
        if tumor_from_tip is None or stamp is None:
            return None, None
        model = self.setup.proximity
        here = self._recent.joined(model.evaluate(tumor_from_tip, stamp), tumor_from_tip)
        last, self._last = self._last, _Place(now, tumor_from_tip, here)
        if last is None or not self._is_fresh(last.stamp, now):
            return here, None
        before = last.proximity
        outside = min(before.signed_distance_mm, here.signed_distance_mm) > 0.0
        # To touch the tumour on the way, a point has to come there and to go as far as it is now.
        way_mm = path_mm(last.tumor_from_tip, tumor_from_tip, model.radius_mm)
        if not outside or way_mm < before.lower_bound_mm + here.lower_bound_mm:
            return here, None
        swept = model.sweep(last.tumor_from_tip, tumor_from_tip, stamp)
        return here, swept.lowest if swept.lowest.signed_distance_mm <= 0.0 else None

    def _registration_at_tip(
        self, tip: Transform | None, problems: frozenset[Reason]
    ) -> tuple[float, frozenset[Reason]]:
        """The standard deviation in mm of the registration at the tip, and what is wrong with it.

        Without a robot nothing is registered and nothing is added. With one, the tip has to be
        known in the reference frame, since the constraint reaches the robot through it. A
        registration that was given states no uncertainty, and adds none. ``tip`` is
        ``reference_from_tip``, or ``problems`` say why it is not known.
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

    def _drift(
        self, links: Mapping[str, Transform], seen: Transform | None
    ) -> RegistrationDrift | None:
        """How far the tip is from where the robot's joints and the registration put it.

        ``seen`` is ``reference_from_tip``.
        """
        robot = self.setup.robot
        if (
            robot is None
            or robot.follows_tool
            or self._reference_from_root is None
            or not links
            or seen is None
        ):
            return None
        link = self._reference_from_root @ links[robot.tool_link]
        # Without a known mount the link only tells where the tip is, not how it is turned.
        predicted = (
            Transform.unchecked(link.target, seen.source, seen.rotation, link.translation_mm)
            if robot.link_from_tip is None
            else link @ robot.link_from_tip
        )
        return check_drift(predicted, seen, robot.max_drift)

    def _links(
        self, frame: TrackingFrame, seen: Transform | None
    ) -> tuple[Mapping[str, Transform], str]:
        """``root_from_link`` from the latest joints, or nothing and what is wrong with them.

        Without recorded joints: from the tip where it is ``seen`` in the reference frame.
        """
        if frame.joints:
            self._joints = frame.joints[-1]
        robot = self.setup.robot
        if robot is None:
            return {}, ""
        if robot.follows_tool:
            return self._followed(seen)
        if self._joints is None:
            return {}, "no joint positions yet"
        if not self._is_fresh(self._joints.stamp, frame.stamp):
            return {}, "joint positions are stale or from the future"
        try:
            positions = self._joints.as_mapping()
            return robot.robot.measured_kinematics(robot.tool_link, positions), ""
        except JointError as error:
            return {}, str(error)

    def _followed(self, seen: Transform | None) -> tuple[Mapping[str, Transform], str]:
        if self._follower is None or seen is None:
            return {}, "the tool is not seen in the reference frame: the robot cannot follow it"
        try:
            return self._follower.links(seen), ""
        except UnreachableError as error:
            return {}, f"{OUT_OF_REACH}: {error}"


def _moving_frames(setup: SessionSetup) -> tuple[str, ...]:
    moving = (setup.tool_from_tip.target, setup.frame_from_tumor.target)
    return moving if setup.robot is None else (*moving, REFERENCE)


def _reference_from_root(robot: RobotSetup | None) -> Transform | None:
    """The registration, to the robot's own root, which is the base by another name."""
    if robot is None or robot.registration is None:
        return None
    return robot.registration.transform.renamed(source=robot.robot.root_link)


def _follower(robot: RobotSetup | None) -> IkFollower | None:
    return IkFollower(robot) if robot is not None and robot.follows_tool else None


def _velocity(setup: SessionSetup) -> TumorVelocity | None:
    if setup.tumor_motion is None:
        return None
    return TumorVelocity(setup.tumor_motion, setup.frame_from_tumor)
