"""One structure beside the tool, from step to step."""

import math
from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

import numpy as np

from app.fixture import (
    FixtureDecision,
    MarginMonitor,
    MarginObservation,
    MarginState,
    Proximity,
    Reason,
    RecentWitnesses,
    TumorMotionFilter,
    TumorMotionParameters,
    Witnesses,
    path_mm,
)
from app.geometry import (
    FloatArray,
    Freshness,
    FreshnessLimits,
    Stamp,
    Transform,
    freshness_of_stamp,
)
from app.registration import RegistrationResult, largest_tre, load_tre_kernel, predict_tre
from app.session.path_depth import PathDepth, PathPoint, deepest_on_path, point_between
from app.session.pose_tree import MeasuredPose, PoseTree, oldest
from app.session.setup import REFERENCE, SessionSetup
from app.session.structure import Structure, StructureStep
from app.session.tumor_velocity import TumorVelocity

_DEPTH_TOLERANCE_MM = 0.1
_DEPTH_EVALUATIONS = 16
"""Accuracy of the depth of a breach between two frames, and its limit, which bounds a step."""


@cache
def _load_kernels() -> None:
    """Run the kernels that only a step calls once: a step must not wait for the compiler."""
    load_tre_kernel()
    start = Transform.identity("structure", "tip")
    path_mm(start, start, 0.0)
    bool(Witnesses.of_rows(np.zeros((1, 10))).is_finite)
    motion = TumorMotionFilter(TumorMotionParameters(1.0, 1.0, 1.0, 1.0, 1.0))
    for ns in range(2):
        motion.update(start, Stamp(ns))


class StructureGuard:
    """Observes one `Structure` of a session and decides on its margin.

    ``free_motion``: the constraint says how far the tool may move.
    """

    def __init__(self, structure: Structure, setup: SessionSetup, *, free_motion: bool) -> None:
        self.structure, self._setup = structure, setup
        self._free_motion = free_motion
        margins = structure.margins(setup.margins)
        self._monitor = MarginMonitor(margins, frame=structure.name)
        self._begin()
        _load_kernels()

    def use(self, structure: Structure, setup: SessionSetup, *, motion_changed: bool) -> bool:
        """Continue with ``structure``; True if its shape, pose or tool has changed.

        The caller then restarts the margin.
        """
        before, self.structure = self.structure, structure
        before_setup, self._setup = self._setup, setup
        self._monitor.parameters = structure.margins(setup.margins)
        if (structure.proximity, structure.frame_from_structure, setup.tool_from_tip) != (
            before.proximity,
            before.frame_from_structure,
            before_setup.tool_from_tip,
        ):
            self._begin()
            return True
        if motion_changed:
            self._velocity = self._new_velocity()
        return False

    def _begin(self) -> None:
        self._outer = self.structure.frame_from_structure.inverse()
        self._recent = RecentWitnesses()
        self._last: PathPoint | None = None
        self._velocity = self._new_velocity()

    def _new_velocity(self) -> TumorVelocity | None:
        setup = self._setup
        frame = self.structure.frame_from_structure.target
        if setup.tumor_motion is None or frame == (setup.motion_frame or REFERENCE):
            return None
        return TumorVelocity(setup.tumor_motion, self.structure.frame_from_structure)

    def restart(self) -> None:
        """Reset the margin after a change of the structure, the tool or the registration."""
        self._monitor.restart()

    def forget_path(self) -> None:
        """The clock went back: no sweep from the pose before the jump."""
        self._last = None

    def continue_from(self, now: Stamp, frame_from_tip: Transform | None) -> None:
        """Continue after steps at which the structure was far and not measured.

        ``frame_from_tip`` is the tip in the structure's tracked frame at the last of them, at
        ``now``; None if no path leads from there to the present.
        """
        self._monitor.continue_from(now)
        self._recent, self._velocity, self._last = RecentWitnesses(), self._new_velocity(), None
        if frame_from_tip is not None:
            pose = self._outer @ frame_from_tip
            self._last = PathPoint(now, pose, self.structure.proximity.evaluate(pose, now))

    def observe(
        self,
        poses: PoseTree,
        now: Stamp,
        tips: Mapping[str, MeasuredPose],
        problems: frozenset[Reason],
    ) -> "Observed":
        """Measure the structure with the present ``poses``.

        ``tips`` are the poses of the tool's tip by frame: in the structure's, and in the reference
        frame, through which the constraint reaches the robot. ``problems`` are faults that concern
        every structure.
        """
        setup, structure = self._setup, self.structure
        frame, tip, outer = structure.frame_from_structure.target, setup.tool_from_tip, self._outer
        measured, in_reference = poses.pose(frame, tip.target, outer, tip), tips[REFERENCE]
        structure_from_tip = measured.transform
        used = (measured,) if setup.robot is None else (measured, in_reference)
        proximity, between = self._proximity(structure_from_tip, measured.oldest, now, poses.limits)
        sigma_tre_mm, registration_problems = self._registration_at_tool(
            in_reference.transform, in_reference.problems, proximity, structure_from_tip
        )
        tracking_mm = 0.0
        if proximity is not None and setup.tracking.is_known:
            structure_from_tool = poses.pose(frame, tip.target, outer).transform
            assert structure_from_tool is not None, "its tip is known"
            tracking_mm = setup.tracking.sigma_of(proximity, structure_from_tool, outer)
        stated = structure.sigma_mm, setup.tip_sigma_mm
        observation = MarginObservation(
            now=now,
            stamp=oldest(used),
            proximity=proximity,
            swept=None if between is None else between.proximity,
            problems=problems | measured.problems | registration_problems,
            sigma_tre_mm=math.hypot(sigma_tre_mm, tracking_mm, *stated),
            unchanged_ns=max([pose.unchanged_ns for pose in used]),
            tumor_twist=self._twist(poses, now),
        )
        return Observed(self, observation, structure_from_tip, between)

    def decide(self, observed: "Observed") -> StructureStep:
        """The decision on what `observe` has measured."""
        structure = self.structure
        return StructureStep(
            structure.name,
            structure.role,
            self._monitor.update(observed.observation),
            observed.structure_from_tip,
            observed.between_frames,
        )

    def far(self, at_least_mm: float, stamp: Stamp | None, seq: int) -> StructureStep:
        """The step of the structure, which is far and was not measured."""
        decision = FixtureDecision(
            MarginState.NEGATIVE,
            (Reason.CLEAR,),
            proximity=None,
            margin=None,
            constraint=None,
            hold=False,
            stamp=stamp,
            seq=seq,
            constraint_is_current=True,
        )
        structure = self.structure
        return StructureStep(structure.name, structure.role, decision, None, None, at_least_mm)

    def _twist(self, poses: PoseTree, now: Stamp) -> FloatArray | None:
        if self._velocity is None:
            return None
        fixed = self._setup.motion_frame or REFERENCE
        fixed_from_frame = poses.pose(fixed, self.structure.frame_from_structure.target)
        return self._velocity.twist(fixed_from_frame, now, poses.limits)

    def _proximity(
        self,
        structure_from_tip: Transform | None,
        stamp: Stamp | None,
        now: Stamp,
        limits: FreshnessLimits,
    ) -> tuple[Proximity | None, PathDepth | None]:
        """Proximity of the tool now, and its deepest pose if it passed through the structure.

        The second is None without a breach on the path from the last known pose. Frames in which
        the tool was lost are skipped.
        """
        if structure_from_tip is None or stamp is None:
            return None, None
        model = self.structure.proximity
        here = self._recent.augment(model.evaluate(structure_from_tip, stamp), structure_from_tip)
        if self._free_motion:
            here = model.add_free_motion(here, structure_from_tip)
        end = PathPoint(now, structure_from_tip, here)
        last, self._last = self._last, end
        if last is None or freshness_of_stamp(last.stamp, now, limits) is not Freshness.VALID:
            return here, None
        before = last.proximity
        outside = min(before.signed_distance_mm, here.signed_distance_mm) > 0.0
        # To touch the structure, a point of the tool travels at least both distances.
        way_mm = path_mm(last.tumor_from_tip, structure_from_tip, model.radius_mm)
        if not outside or way_mm < before.lower_bound_mm + here.lower_bound_mm:
            return here, None
        swept = model.sweep(last.tumor_from_tip, structure_from_tip, stamp)
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
        structure_from_tip: Transform | None,
    ) -> tuple[float, frozenset[Reason]]:
        """Standard deviation in mm of the registration at the tool, and its problems.

        It is the largest at the tip and at the witnesses of ``proximity``: a shaft that touches is
        not where the tip is. Without a robot both are empty. With one, the tip must be known in the
        reference frame, because the constraint reaches the robot through it. A given registration
        has no covariance and adds nothing. ``tip`` is ``reference_from_tip``; if it is None,
        ``problems`` holds why.
        """
        robot = self._setup.robot
        if robot is None:
            return 0.0, frozenset()
        registration: RegistrationResult | None = robot.registration
        if registration is None:
            return 0.0, frozenset({Reason.REGISTRATION_MISSING})
        if not registration.accepted:
            problems |= {Reason.REGISTRATION_REFUSED}
        if tip is None or registration.covariance is None:
            return 0.0, problems
        if proximity is None or structure_from_tip is None:
            return float(predict_tre(registration, tip.translation_mm[None])[0]), problems
        points_mm = proximity.witnesses.on_tool_mm
        return largest_tre(registration, tip, structure_from_tip, points_mm), problems


class Observed(NamedTuple):
    """Measurement of one structure, before the decision on it."""

    guard: StructureGuard
    observation: MarginObservation
    structure_from_tip: Transform | None
    between_frames: PathDepth | None

    @property
    def largest_clearance_mm(self) -> float:
        """Upper bound of the clearance by which the structure may govern."""
        proximity = self.observation.proximity
        if proximity is None:
            return -math.inf
        return proximity.lower_bound_mm - self.guard.structure.stop_mm
