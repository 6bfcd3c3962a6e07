"""Session: one pure step from a tracker frame to a decision with its constraint."""

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from app.case import TrackingFrame
from app.fixture import (
    MarginMonitor,
    MarginObservation,
    Proximity,
    Reason,
    RecentWitnesses,
    path_mm,
)
from app.geometry import (
    Edge,
    FloatArray,
    FrameError,
    Freshness,
    Stamp,
    Transform,
    freshness_of_stamp,
)
from app.hold import Hold, tightest_margins
from app.registration import predict_tre
from app.session.link_poses import RobotLinks
from app.session.loosening import AcknowledgedSetup
from app.session.named_frames import base_measured_problem
from app.session.path_depth import PathDepth, PathPoint, deepest_on_path, point_between
from app.session.pose_plausibility import Plausibility
from app.session.pose_tree import PoseTree, TumorVelocity
from app.session.setup import REFERENCE, SessionSetup
from app.session.step_result import StepResult, known_edges

NOTHING_OUTSIDE: Mapping[Reason, str] = MappingProxyType({})
"""No faults outside the frames."""

_DEPTH_TOLERANCE_MM = 0.1
_DEPTH_EVALUATIONS = 16
"""Accuracy of the depth of a breach between two frames, and its limit, which bounds a step."""


class Session:
    """Joins tracking, registration, robot and fixture. Reads no clock: frames carry the time.

    ``free_motion``: a controller obeys the constraints, so they say how far its tool may move.
    """

    def __init__(self, setup: SessionSetup, *, free_motion: bool = False) -> None:
        self.setup = self.requested = setup
        self._free_motion = free_motion
        self._tumor_from_frame = setup.frame_from_tumor.inverse()
        self._poses = PoseTree(
            limits=setup.margins.freshness_limits,
            moving_frames=_moving_frames(setup),
        )
        self._recent = RecentWitnesses()
        self._monitor = MarginMonitor(setup.margins, frame=setup.frame_from_tumor.source)
        self._links = RobotLinks(setup.robot)
        self._velocity = _velocity(setup)
        self._plausibility = Plausibility(setup)
        self._checked_edges: tuple[Edge, ...] = ()
        self._frames_problem = ""
        self._last: PathPoint | None = None
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
        than the frame's, a mistake of the caller.
        """
        self._index += 1
        problems = self._poses.insert(self._plausibility.remove_implausible(frame, self._poses))
        if problems:  # the clock went back: no sweep from the pose before the jump
            self._last = None
        tool = self._poses.pose(self.setup.frame_from_tumor.target, self.setup.tool_from_tip.target)
        tumor_from_tool = tumor_from_tip = None
        if tool.transform is not None:
            tumor_from_tool = self._tumor_from_frame @ tool.transform
            tumor_from_tip = tumor_from_tool @ self.setup.tool_from_tip
        in_reference = self._poses.pose(REFERENCE, self.setup.tool_from_tip.target)
        reference_from_tip = None
        if in_reference.transform is not None:
            reference_from_tip = in_reference.transform @ self.setup.tool_from_tip
        links, robot_problem = self._links.at(frame, reference_from_tip, self._poses.limits)
        drift = self._plausibility.drift(links, reference_from_tip, frame.stamp)
        found = {**self._plausibility.faults(self._poses, frame.stamp), **outside}
        if self._is_base_measured():
            problems |= {Reason.REGISTRATION_REFUSED}
        # The constraint reaches the robot through the reference frame.
        used = (tool,) if self.setup.robot is None else (tool, in_reference)
        proximity, between = self._proximity(tumor_from_tip, tool.oldest, frame.stamp)
        sigma_tre_mm, registration_problems = self._registration_at_tool(
            reference_from_tip, in_reference.problems, proximity, tumor_from_tip
        )
        tracking_mm = self._tracking_sigma(proximity, tumor_from_tool)
        stated = self.setup.tumor_sigma_mm, self.setup.tip_sigma_mm
        sigma_mm = math.hypot(sigma_tre_mm, tracking_mm, *stated)
        observation = MarginObservation(
            now=frame.stamp,
            stamp=min((pose.oldest for pose in used if pose.oldest is not None), default=None),
            proximity=proximity,
            swept=None if between is None else between.proximity,
            problems=problems | tool.problems | registration_problems | found.keys(),
            sigma_tre_mm=sigma_mm,
            unchanged_ns=max(pose.unchanged_ns for pose in used),
            tumor_twist=self._tumor_twist(frame.stamp),
        )
        with self._hold.latched_by_error():
            decision = self._hold.applied(self._monitor.update(observation), found)
        if decision.constraint is not None:
            self._virtual_fixture = decision.constraint.fixture_frame(self._virtual_fixture)
        return StepResult(
            index=self._index,
            frame=frame,
            decision=decision,
            tumor_from_tip=tumor_from_tip,
            virtual_fixture=self._virtual_fixture if decision.constraint is not None else None,
            links=links,
            joints=self._links.joints,
            robot_problem=robot_problem,
            drift=drift,
            frames_problems=tuple(filter(None, [self._frames_problem, *found.values()])),
            hold_causes=self._hold.causes,
            edges=known_edges(
                self.setup.static_edges,
                self.setup.robot,
                self._poses.usable(),
                links,
                self._links.joints,
            ),
            single_source=self.single_source,
            between_frames=between,
        )

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
        the registration or a pose of one of them changes, the state is also UNKNOWN up to the next
        full evaluation. ``tumor_change`` describes a new tumour for the operator. Raises
        `FrameError` for a tumour in another frame, because the constraint is expressed in it.
        """
        tumor, known = setup.frame_from_tumor.source, self.setup.frame_from_tumor.source
        if tumor != known:
            raise FrameError(f"the tumour's frame is {tumor!r}; expected {known!r}, as before")
        loosened = self._acknowledged.change(self.setup, setup, tumor_change)
        self._hold.change(self._acknowledged.changes, latch=loosened)
        if _places(setup) != _places(self.setup):
            # A retreat from a tumour that no operator has acknowledged may approach the true one.
            self._hold.doubt()
        self.requested = setup
        margins = tightest_margins(
            self.setup.margins, setup.margins, follows_tumor=setup.tumor_motion is not None
        )
        self._use(setup if margins == setup.margins else replace(setup, margins=margins))
        return loosened

    def _use(self, setup: SessionSetup) -> None:
        before, self.setup = self.setup, setup
        self._poses.limits = setup.margins.freshness_limits
        self._poses.moving_frames = _moving_frames(setup)
        self._monitor.parameters = setup.margins
        self._plausibility.use(setup, before)
        if (setup.tumor_motion, setup.motion_frame) != (before.tumor_motion, before.motion_frame):
            self._velocity = _velocity(setup)
        if setup.robot is not before.robot:
            self._links.use(setup.robot)
            self._checked_edges, self._frames_problem = (), ""
            self._restart()
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
            self._restart()

    def _restart(self) -> None:
        self._monitor.restart()
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
        if edges != self._checked_edges:
            self._checked_edges = edges
            self._frames_problem = base_measured_problem(self.setup, edges)
        return bool(self._frames_problem)

    def _is_fresh(self, stamp: Stamp, now: Stamp) -> bool:
        return freshness_of_stamp(stamp, now, self._poses.limits) is Freshness.VALID

    def _tumor_twist(self, now: Stamp) -> FloatArray | None:
        if self._velocity is None:
            return None
        fixed = self.setup.motion_frame or REFERENCE
        fixed_from_frame = self._poses.pose(fixed, self.setup.frame_from_tumor.target)
        return self._velocity.twist(fixed_from_frame, now, self._poses.limits)

    def _tracking_sigma(
        self, proximity: Proximity | None, tumor_from_tool: Transform | None
    ) -> float:
        """Standard deviation in mm of the tracked tool beside the tumour; 0 without a pose."""
        if proximity is None or tumor_from_tool is None:
            return 0.0
        return self.setup.tracking.sigma_of(proximity, tumor_from_tool, self._tumor_from_frame)

    def _proximity(
        self, tumor_from_tip: Transform | None, stamp: Stamp | None, now: Stamp
    ) -> tuple[Proximity | None, PathDepth | None]:
        """Proximity of the tool now, and its deepest pose if it passed through the tumour.

        The second is None without a breach on the path from the last known pose. Frames in which
        the tool was lost are skipped.
        """
        if tumor_from_tip is None or stamp is None:
            return None, None
        model = self.setup.proximity
        here = self._recent.augment(model.evaluate(tumor_from_tip, stamp), tumor_from_tip)
        if self._free_motion:
            here = model.add_free_motion(here, tumor_from_tip)
        end = PathPoint(now, tumor_from_tip, here)
        last, self._last = self._last, end
        if last is None or not self._is_fresh(last.stamp, now):
            return here, None
        before = last.proximity
        outside = min(before.signed_distance_mm, here.signed_distance_mm) > 0.0
        # To touch the tumour, a point of the tool travels at least both distances.
        way_mm = path_mm(last.tumor_from_tip, tumor_from_tip, model.radius_mm)
        if not outside or way_mm < before.lower_bound_mm + here.lower_bound_mm:
            return here, None
        swept = model.sweep(last.tumor_from_tip, tumor_from_tip, stamp)
        if swept.lowest.signed_distance_mm > 0.0:
            return here, None
        # The sweep ends at the first contact, which may be far above the deepest point.
        contact = point_between(last, end, min(swept.fraction, 1.0), lambda _: swept.lowest)
        return here, deepest_on_path(
            (last, contact, end),
            lambda pose: model.evaluate(pose, stamp),
            radius_mm=model.radius_mm,
            tolerance_mm=_DEPTH_TOLERANCE_MM,
            max_evaluations=_DEPTH_EVALUATIONS,
        )

    def _registration_at_tool(
        self,
        tip: Transform | None,
        problems: frozenset[Reason],
        proximity: Proximity | None,
        tumor_from_tip: Transform | None,
    ) -> tuple[float, frozenset[Reason]]:
        """Standard deviation in mm of the registration at the tool, and its problems.

        It is the largest at the tip and at the witnesses of ``proximity``: a shaft that touches is
        not where the tip is. Without a robot both are empty. With one, the tip must be known in the
        reference frame, because the constraint reaches the robot through it. A given registration
        has no covariance and adds nothing. ``tip`` is ``reference_from_tip``; if it is None,
        ``problems`` holds why.
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
        points_mm = tip.translation_mm[None]
        if proximity is not None and tumor_from_tip is not None:
            reference_from_tumor = tip @ tumor_from_tip.inverse()
            touched_mm = reference_from_tumor.apply(proximity.witnesses.on_tool_mm)
            points_mm = np.concatenate([points_mm, touched_mm])
        return float(predict_tre(registration, points_mm).max()), problems


def _places(setup: SessionSetup) -> tuple[object, ...]:
    """The values that determine the places of tool, tumour and robot."""
    return setup.proximity, setup.tool_from_tip, setup.frame_from_tumor, setup.robot


def _moving_frames(setup: SessionSetup) -> tuple[str, ...]:
    moving = (setup.tool_from_tip.target, setup.frame_from_tumor.target)
    return moving if setup.robot is None else (*moving, REFERENCE)


def _velocity(setup: SessionSetup) -> TumorVelocity | None:
    if setup.tumor_motion is None:
        return None
    return TumorVelocity(setup.tumor_motion, setup.frame_from_tumor)
