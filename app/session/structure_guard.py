"""One structure beside the tool, from step to step, and the decision on all of them."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import TypeAlias

import numpy as np

from app.fixture import (
    Constraint,
    FixtureDecision,
    MarginMonitor,
    MarginObservation,
    Proximity,
    Reason,
    RecentWitnesses,
    path_mm,
    worst_first,
)
from app.fixture.control.constraint import MAX_PLANES
from app.fixture.proximity.values import FreeMotion, Witnesses
from app.geometry import (
    FloatArray,
    Freshness,
    FreshnessLimits,
    Stamp,
    Transform,
    freshness_of_stamp,
)
from app.registration import RegistrationResult, predict_tre
from app.session.path_depth import PathDepth, PathPoint, deepest_on_path, point_between
from app.session.pose_tree import MeasuredPose, PoseTree, TumorVelocity
from app.session.setup import REFERENCE, SessionSetup
from app.session.structure import Structure, StructureStep, governing_number

_DEPTH_TOLERANCE_MM = 0.1
_DEPTH_EVALUATIONS = 16
"""Accuracy of the depth of a breach between two frames, and its limit, which bounds a step."""


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
        self._structure_from_frame = self.structure.frame_from_structure.inverse()
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

    def observe(
        self,
        poses: PoseTree,
        now: Stamp,
        tools: Mapping[str, MeasuredPose],
        reference_from_tip: Transform | None,
        problems: frozenset[Reason],
    ) -> "_Observed":
        """Measure the structure with the present ``poses``.

        ``tools`` are those of the tool by frame: in the structure's, and in the reference frame,
        through which the constraint reaches the robot; ``reference_from_tip`` is its tip there.
        ``problems`` are faults that concern every structure.
        """
        setup, structure = self._setup, self.structure
        tool, in_reference = tools[structure.frame_from_structure.target], tools[REFERENCE]
        structure_from_tool = structure_from_tip = None
        if tool.transform is not None:
            structure_from_tool = self._structure_from_frame @ tool.transform
            structure_from_tip = structure_from_tool @ setup.tool_from_tip
        used = (tool,) if setup.robot is None else (tool, in_reference)
        proximity, between = self._proximity(structure_from_tip, tool.oldest, now, poses.limits)
        sigma_tre_mm, registration_problems = self._registration_at_tool(
            reference_from_tip, in_reference.problems, proximity, structure_from_tip
        )
        tracking_mm = 0.0
        if proximity is not None and structure_from_tool is not None:
            tracking_mm = setup.tracking.sigma_of(
                proximity, structure_from_tool, self._structure_from_frame
            )
        stated = structure.sigma_mm, setup.tip_sigma_mm
        observation = MarginObservation(
            now=now,
            stamp=min((pose.oldest for pose in used if pose.oldest is not None), default=None),
            proximity=proximity,
            swept=None if between is None else between.proximity,
            problems=problems | tool.problems | registration_problems,
            sigma_tre_mm=math.hypot(sigma_tre_mm, tracking_mm, *stated),
            unchanged_ns=max(pose.unchanged_ns for pose in used),
            tumor_twist=self._twist(poses, now),
        )
        return _Observed(self, observation, structure_from_tip, between)

    def decide(self, observed: "_Observed") -> StructureStep:
        """The decision on what `observe` has measured."""
        structure = self.structure
        return StructureStep(
            structure.name,
            structure.role,
            self._monitor.update(observed.observation),
            observed.structure_from_tip,
            observed.between_frames,
        )

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
        points_mm = tip.translation_mm[None]
        if proximity is not None and structure_from_tip is not None:
            reference_from_structure = tip @ structure_from_tip.inverse()
            touched_mm = reference_from_structure.apply(proximity.witnesses.on_tool_mm)
            points_mm = np.concatenate([points_mm, touched_mm])
        return float(predict_tre(registration, points_mm).max()), problems


@dataclass(frozen=True, slots=True, eq=False)
class _Observed:
    """Measurement of one structure, before the decision on it."""

    guard: StructureGuard
    observation: MarginObservation
    structure_from_tip: Transform | None
    between_frames: PathDepth | None


class CombinedDecision:
    """Joins the decisions on all structures to that of the session, in the tumour's frame.

    The state is the worst. The reasons are those of all structures. Distance and margin are those
    of the *governing* structure: of the worst state, and among these of the smallest clearance. The
    constraint holds the planes of all structures, the governing one first, or none that is current
    unless all are: to leave one structure may mean to approach another.
    """

    def __init__(self) -> None:
        self._constraint: Constraint | None = None
        self.half_spaces_of: tuple[int, ...] = ()
        """The structure of each half-space, as its number in ``steps``; empty for one structure."""

    def restart(self) -> None:
        """Forget the planes: a structure, the tool or the registration has changed."""
        self._constraint = None

    def of(self, steps: Sequence[StructureStep], radius_mm: float) -> FixtureDecision:
        """The decision on ``steps``, the tumour's first; ``radius_mm`` is that of the tool.

        With one structure it is the decision on that.
        """
        if len(steps) == 1:
            return steps[0].decision
        governing = governing_number(steps)
        decision = steps[governing].decision
        place = cache(partial(_tumor_from, steps))
        current = all(each.decision.constraint_is_current for each in steps)
        hold = any(each.decision.hold for each in steps)
        if current:
            joined = _joined(steps, governing, place, radius_mm, hold=hold)
            self._constraint, self.half_spaces_of = (None, ()) if joined is None else joined
        elif self._constraint is not None:
            self._constraint = self._constraint.on_hold()
        stamps = [each.decision.stamp for each in steps]
        known = [stamp for stamp in stamps if stamp is not None]
        reasons = {reason for each in steps for reason in each.decision.reasons}
        if len(reasons) > 1:
            reasons.discard(Reason.CLEAR)
        return replace(
            decision,
            reasons=worst_first(reasons),
            proximity=_in_tumor_frame(decision.proximity, governing, place),
            constraint=self._constraint,
            hold=hold,
            seq=steps[0].decision.seq,
            stamp=min(known) if len(known) == len(stamps) else None,
            constraint_is_current=current,
        )


def _tumor_from(steps: Sequence[StructureStep], number: int) -> Transform | None:
    """The structure in the tumour's frame, both as the tool sees them; None if not known."""
    tumor_from_tip = steps[0].structure_from_tip
    structure_from_tip = steps[number].structure_from_tip
    if tumor_from_tip is None or structure_from_tip is None:
        return None
    return tumor_from_tip @ structure_from_tip.inverse()


_Place: TypeAlias = Callable[[int], Transform | None]
"""`_tumor_from` of the structures of one step."""


def _in_tumor_frame(proximity: Proximity | None, number: int, place: _Place) -> Proximity | None:
    if number == 0 or proximity is None:
        return proximity
    placed = place(number)
    if placed is None:
        return None
    rows = proximity.witnesses.rows.copy()
    rows[:, 1:4], rows[:, 4:7] = placed.apply(rows[:, 1:4]), placed.apply(rows[:, 4:7])
    rows[:, 7:] = placed.rotate(rows[:, 7:])
    return replace(proximity, witnesses=Witnesses.of_rows(rows))


def _joined(
    steps: Sequence[StructureStep],
    governing: int,
    place: _Place,
    radius_mm: float,
    *,
    hold: bool,
) -> tuple[Constraint, tuple[int, ...]] | None:
    """The planes of all structures in the tumour's frame, `MAX_PLANES` at most, and whose they are.

    The governing plane is first. Of more planes the nearest are kept; the free motion then ends
    before one of the others is reached: a point of the tool at the lever ``radius_mm`` moves by the
    way of the tip and the angle times the lever at most.
    """
    planes: list[FloatArray] = []
    owners: list[int] = []
    free = FreeMotion(math.inf, math.inf)
    for number in (governing, *(each for each in range(len(steps)) if each != governing)):
        constraint = steps[number].decision.constraint
        if constraint is None or steps[number].structure_from_tip is None:
            return None
        planes.append(constraint.rows)
        owners += [number] * len(constraint)
        free = _smaller(free, constraint.free)
    rows = np.concatenate(planes)
    if len(rows) > MAX_PLANES:
        # A clearance is the same in every frame.
        clearances = np.einsum("ij,ij->i", rows[:, 1:4], rows[:, 4:7]) - rows[:, 0]
        order = 1 + np.argsort(clearances[1:], kind="stable")
        nearest_left_out_mm = max(float(clearances[order[MAX_PLANES - 1]]), 0.0)
        turn_rad = nearest_left_out_mm / radius_mm if radius_mm > 0.0 else math.inf  # a point
        free = _smaller(free, FreeMotion(nearest_left_out_mm, turn_rad))
        kept = [0, *np.sort(order[: MAX_PLANES - 1]).tolist()]
        rows, owners = rows[kept], [owners[number] for number in kept]
    for number in set(owners) - {0}:
        placed = place(number)
        if placed is None:
            return None
        own = np.array(owners) == number
        rows[own] = _placed_rows(rows[own], placed)
    return Constraint.unchecked(steps[0].name, rows, hold=hold, free=free), tuple(owners)


def _smaller(one: FreeMotion, other: FreeMotion) -> FreeMotion:
    return FreeMotion(min(one.distance_mm, other.distance_mm), min(one.turn_rad, other.turn_rad))


def _placed_rows(rows: FloatArray, placed: Transform) -> FloatArray:
    """``rows`` (k, 10) of a constraint after a motion: offset, normal, tool point, velocity."""
    moved = rows.copy()
    moved[:, 1:4] = placed.rotate(rows[:, 1:4])
    moved[:, 4:7] = placed.apply(rows[:, 4:7])
    moved[:, 7:] = placed.rotate(rows[:, 7:])
    moved[:, 0] += moved[:, 1:4] @ placed.translation_mm
    return moved
