"""Structures that are so far from the tool that a step need not measure them.

A tool that was at least ``d`` away, and of which no point has moved by more than ``w`` against the
structure since then, is at least ``d - w`` away. A step then costs what is near, not what exists.
"""

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from app.fixture import FixtureDecision, MarginObservation, MarginState
from app.fixture.jit import kernel
from app.geometry import NS_PER_S, FloatArray, Freshness, Stamp, Transform, freshness_of_stamp
from app.registration import tre_growth
from app.session.pose_tree import MeasuredPose
from app.session.sensor_motion import State
from app.session.setup import REFERENCE, SessionSetup

BEYOND_MM = 10.0
"""Distance beyond the warning from which a structure is far. At 50 mm/s, the usual largest speed, a
tool needs 0.2 s for it: more than twice as long as planes are usually valid."""

_ROUNDING_RAD = 1e-6
"""Above the error of an angle that is computed from its cosine: the root of twice 1e-14."""


class FarDistance(NamedTuple):
    """Lower bounds of the distance of a far structure and of its clearance, without its margin."""

    at_least_mm: float
    clearance_mm: float


_STRUCTURE = np.dtype(
    [
        ("frame", np.int64),  # the number of its tracked frame
        ("radius_mm", np.float64),  # of the tool
        ("stop_mm", np.float64),
        ("sigma_mm", np.float64),  # of its surface and of the tip
        ("needed_mm", np.float64),  # the clearance from which it is far
        ("measured_mm", np.float64),  # the last measured distance; -inf if it cannot be far,
        ("rotation", np.float64, (3, 3)),  # and the tip at that time in its tracked frame
        ("tip_mm", np.float64, 3),
        ("k_tre", np.float64),  # of the margins, as the next one: the same for all structures
        ("age_mm", np.float64),
        ("tre_growth", np.float64),
        ("tracking_mm", np.float64),  # of two poses
        ("tracking_rad", np.float64),
        ("tool_lever_mm", np.float64),
        ("at_least_mm", np.float64),  # `FarDistance` at this step
        ("clearance_mm", np.float64),
    ],
    align=True,
)


class FarStructures:
    """Remembers for each structure but the first how far the tool was when it was last measured.

    Once per step `found`, then `end`.
    """

    def __init__(self, setup: SessionSetup) -> None:
        self._now: Stamp | None = None
        self._tips: dict[str, Transform] = {}
        self._last: dict[str, Transform] = {}
        self.use(setup)
        # Run the kernel once, so that the first step does not wait for the compiler.
        tip = Transform.identity("frame", "tip")
        _find_bounds(self._state, -1, tip.rotation, tip.translation_mm, 0.0)

    def use(self, setup: SessionSetup) -> None:
        """Replace the setup: each structure is measured at the next step."""
        structures, margins, tracking = setup.guarded, setup.margins, setup.tracking
        self._limits = margins.freshness_limits
        self._asleep: frozenset[int] = frozenset()
        self._frames = [each.frame_from_structure.target for each in structures]
        self._names = tuple(dict.fromkeys(self._frames))
        self._needed_frames = {*self._names, *(() if setup.robot is None else (REFERENCE,))}
        self._known: set[int] = set()
        self._state: State = np.zeros(len(structures), _STRUCTURE)
        self._needed_mm, self._measured_mm = self._state["needed_mm"], self._state["measured_mm"]
        self._rotations, self._tips_mm = self._state["rotation"], self._state["tip_mm"]
        for state, each, frame in zip(self._state, structures, self._frames, strict=True):
            state["frame"] = self._names.index(frame)
            state["radius_mm"], state["stop_mm"] = each.proximity.radius_mm, each.stop_mm
            state["sigma_mm"] = math.hypot(each.sigma_mm, setup.tip_sigma_mm)
            band_mm = each.warn_mm - each.stop_mm + margins.release_band_mm
            state["needed_mm"] = band_mm + BEYOND_MM
        registration = None if setup.robot is None else setup.robot.registration
        growth = 0.0 if registration is None else tre_growth(registration)
        lever_mm = np.linalg.norm(setup.tool_from_tip.translation_mm)
        self._state["k_tre"], self._state["tre_growth"] = margins.k_tre, growth
        self._state["age_mm"] = margins.v_max_mm_s * margins.stale_after_ns / NS_PER_S
        self._state["tracking_mm"] = math.sqrt(2.0) * tracking.sigma_mm
        self._state["tracking_rad"], self._state["tool_lever_mm"] = tracking.sigma_rad, lever_mm
        self._forget()

    def found(
        self, tips: Mapping[str, MeasuredPose], first: MarginObservation
    ) -> dict[int, FarDistance]:
        """The far structures by number: none after a fault, or if a pose may be old.

        ``tips`` are the poses of the tool's tip by frame, ``first`` is the observation of the first
        structure, whose margin holds the error of the registration at the tip.
        """
        self._tips = {}  # those of a step that has failed
        used = [tips[name] for name in self._needed_frames]
        if first.problems or any(each.problems or each.unchanged_ns for each in used):
            return {}
        poses = [(name, tips[name].transform) for name in self._names]
        self._tips = {name: pose for name, pose in poses if pose is not None}
        if freshness_of_stamp(self._now, first.now, self._limits) is not Freshness.VALID:
            self._forget()  # the margin is UNKNOWN after a gap
        if not self._known:
            return {}
        for number, name in enumerate(self._names):
            tip, sigma_mm = self._tips[name], first.sigma_tre_mm
            _find_bounds(self._state, number, tip.rotation, tip.translation_mm, sigma_mm)
        fields = ("at_least_mm", "clearance_mm", "needed_mm")
        bounds = zip(*(self._state[name].tolist() for name in fields), strict=True)
        return {
            number: FarDistance(at_least_mm, clearance_mm)
            for number, (at_least_mm, clearance_mm, needed_mm) in enumerate(bounds)
            if clearance_mm >= needed_mm
        }

    def last_seen(self, number: int) -> tuple[Stamp, Transform | None] | None:
        """Time and pose ``frame_from_tip`` of the last step if the structure was far at it.

        The pose is None after `forget_path`.
        """
        if number not in self._asleep or self._now is None:
            return None
        return self._now, self._last.get(self._frames[number])

    def forget_path(self) -> None:
        """The clock went back: no path from the pose before the jump."""
        self._last = {}

    def end(self, now: Stamp, far: Iterable[int], measured: Mapping[int, FixtureDecision]) -> None:
        """End the step at ``now`` with the structures that were ``far`` and the ``measured`` ones.

        After a fault all are measured at the next step.
        """
        if not self._tips:
            self._forget()
        else:
            for number, decision in measured.items():
                if number > 0:
                    self._note(number, decision)
        self._now, self._asleep, self._last = now, frozenset(far), self._tips
        self._tips = {}

    def _note(self, number: int, decision: FixtureDecision) -> None:
        """Remember the distance of a structure if it can be far at the next step."""
        proximity = decision.proximity
        if (
            proximity is None
            or decision.state is not MarginState.NEGATIVE
            or proximity.lower_bound_mm < self._needed_mm[number]
        ):
            self._known.discard(number)
            self._measured_mm[number] = -math.inf
            return
        tip = self._tips[self._frames[number]]
        self._known.add(number)
        self._measured_mm[number] = proximity.lower_bound_mm
        self._rotations[number], self._tips_mm[number] = tip.rotation, tip.translation_mm

    def _forget(self) -> None:
        self._known.clear()
        self._measured_mm[:] = -math.inf


@kernel
def _find_bounds(
    structures: State, frame: int, rotation: FloatArray, tip_mm: FloatArray, sigma_mm: float
) -> None:
    """Write the `FarDistance` of the ``structures`` (n,) of the tracked frame number ``frame``.

    ``rotation`` (3, 3) and ``tip_mm`` (3,) are the tip in that frame. The margin is the largest,
    wherever on the tool the witnesses are; ``sigma_mm`` holds the error of the registration at the
    tip.
    """
    for k in range(len(structures)):
        s = structures[k]
        if s["frame"] != frame:
            continue
        trace = squared_way = squared_tip = 0.0
        for i in range(3):
            squared_way += (tip_mm[i] - s["tip_mm"][i]) ** 2
            squared_tip += tip_mm[i] ** 2
            for j in range(3):
                trace += s["rotation"][i, j] * rotation[i, j]
        radius_mm = s["radius_mm"]
        turn_rad = math.acos(min(max(0.5 * (trace - 1.0), -1.0), 1.0)) + _ROUNDING_RAD
        s["at_least_mm"] = s["measured_mm"] - (math.sqrt(squared_way) + radius_mm * turn_rad)
        lever_mm = math.hypot(s["tool_lever_mm"] + radius_mm, math.sqrt(squared_tip) + radius_mm)
        tracked_mm = math.hypot(s["tracking_mm"], s["tracking_rad"] * lever_mm)
        error_mm = math.hypot(sigma_mm + s["tre_growth"] * radius_mm, tracked_mm)
        margin_mm = s["stop_mm"] + s["k_tre"] * math.hypot(error_mm, s["sigma_mm"]) + s["age_mm"]
        s["clearance_mm"] = s["at_least_mm"] - margin_mm
