"""Structures that are so far from the tool that a step need not measure them.

A tool that was at least ``d`` away, and of which no point has moved by more than ``w`` against the
structure since then, is at least ``d - w`` away. A step then costs what is near, not what exists.
"""

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from app.fixture import FixtureDecision, MarginObservation, MarginState
from app.geometry import NS_PER_S, FloatArray, Freshness, Stamp, Transform, freshness_of_stamp
from app.registration import tre_growth
from app.session.pose_tree import MeasuredPose
from app.session.setup import REFERENCE, SessionSetup

BEYOND_MM = 20.0
"""Distance beyond the warning from which a structure is far. At 50 mm/s, the usual largest speed, a
tool needs 0.4 s for it: five times as long as planes are usually valid."""

_ROUNDING_RAD = 1e-6
"""Above the error of an angle that is computed from its cosine: the root of twice 1e-14."""


class FarDistance(NamedTuple):
    """Lower bounds of the distance of a far structure and of its clearance, without its margin."""

    at_least_mm: float
    clearance_mm: float


class FarStructures:
    """Remembers for each structure but the first how far the tool was when it was last measured.

    Once per step `found`, then `end`.
    """

    def __init__(self, setup: SessionSetup) -> None:
        self._now: Stamp | None = None
        self._tools: Mapping[str, MeasuredPose] = {}
        self._tips: dict[str, Transform] = {}
        self._last: dict[str, Transform] = {}
        self.use(setup)

    def use(self, setup: SessionSetup) -> None:
        """Replace the setup: each structure is measured at the next step."""
        structures, margins = setup.guarded, setup.margins
        self._setup = setup
        self._asleep: frozenset[int] = frozenset()
        self._frames = [each.frame_from_structure.target for each in structures]
        self._names = tuple(dict.fromkeys(self._frames))
        self._needed_frames = {*self._names, *(() if setup.robot is None else (REFERENCE,))}
        self._frame = np.array([self._names.index(name) for name in self._frames])
        self._radius_mm = np.array([each.proximity.radius_mm for each in structures])
        self._stop_mm = np.array([each.stop_mm for each in structures])
        warn_mm = np.array([each.warn_mm for each in structures])
        self._needed_mm = warn_mm - self._stop_mm + margins.release_band_mm + BEYOND_MM
        own = [math.hypot(each.sigma_mm, setup.tip_sigma_mm) for each in structures]
        self._own_sigma_mm = np.array(own)
        self._tool_lever_mm = float(np.linalg.norm(setup.tool_from_tip.translation_mm))
        registration = None if setup.robot is None else setup.robot.registration
        self._growth = 0.0 if registration is None else tre_growth(registration)
        self._age_mm = margins.v_max_mm_s * margins.stale_after_ns / NS_PER_S
        self._known: set[int] = set()
        self._at_least_mm = np.full(len(structures), -math.inf)
        self._rotations = np.zeros((len(structures), 3, 3))
        self._tips_mm = np.zeros((len(structures), 3))

    def found(
        self, tools: Mapping[str, MeasuredPose], first: MarginObservation
    ) -> dict[int, FarDistance]:
        """The far structures by number: none after a fault, or if a pose may be old.

        ``tools`` are the poses of the tool by frame, ``first`` is the observation of the first
        structure, whose margin holds the error of the registration at the tip.
        """
        self._tools, self._tips = {}, {}  # those of a step that has failed
        limits = self._setup.margins.freshness_limits
        used = [tools[name] for name in self._needed_frames]
        if first.problems or any(each.problems or each.unchanged_ns for each in used):
            return {}
        self._tools = tools
        if freshness_of_stamp(self._now, first.now, limits) is not Freshness.VALID:
            self._forget()  # the margin is UNKNOWN after a gap
        if not self._known:
            return {}
        tips = [self._tip(name) for name in self._names]
        tips_mm = np.array([each.translation_mm for each in tips])[self._frame]
        rotations = np.array([each.rotation for each in tips])[self._frame]
        cosines = 0.5 * (np.einsum("nij,nij->n", self._rotations, rotations) - 1.0)
        turns_rad = np.arccos(np.clip(cosines, -1.0, 1.0)) + _ROUNDING_RAD
        ways_mm = np.linalg.norm(tips_mm - self._tips_mm, axis=1) + self._radius_mm * turns_rad
        at_least_mm = self._at_least_mm - ways_mm
        clearances_mm = at_least_mm - self._largest_margins_mm(tips_mm, first.sigma_tre_mm)
        return {
            number: FarDistance(float(at_least_mm[number]), float(clearances_mm[number]))
            for number in np.flatnonzero(clearances_mm >= self._needed_mm).tolist()
        }

    def _largest_margins_mm(self, tips_mm: FloatArray, sigma_mm: float) -> FloatArray:
        """Upper bounds (n,) of the stop margins, wherever on the tool the witnesses are.

        ``tips_mm`` (n, 3) is the tip in the structures' tracked frames. ``sigma_mm`` holds the
        error of the registration at the tip.
        """
        tracking, radius_mm = self._setup.tracking, self._radius_mm
        levers_mm = np.hypot(
            self._tool_lever_mm + radius_mm, np.linalg.norm(tips_mm, axis=1) + radius_mm
        )
        tracked = np.hypot(math.sqrt(2.0) * tracking.sigma_mm, tracking.sigma_rad * levers_mm)
        sigmas_mm = np.hypot(sigma_mm + self._growth * radius_mm, tracked)
        sigmas_mm = np.hypot(sigmas_mm, self._own_sigma_mm)
        return np.asarray(self._stop_mm + self._setup.margins.k_tre * sigmas_mm + self._age_mm)

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
        if not self._tools:
            self._forget()
        else:
            for number, decision in measured.items():
                if number > 0:
                    self._note(number, decision)
        self._now, self._asleep, self._last = now, frozenset(far), self._tips
        self._tools, self._tips = {}, {}

    def _note(self, number: int, decision: FixtureDecision) -> None:
        """Remember the distance of a structure if it can be far at the next step."""
        proximity = decision.proximity
        if (
            proximity is None
            or decision.state is not MarginState.NEGATIVE
            or proximity.lower_bound_mm < self._needed_mm[number]
        ):
            self._known.discard(number)
            self._at_least_mm[number] = -math.inf
            return
        tip = self._tip(self._frames[number])
        self._known.add(number)
        self._at_least_mm[number] = proximity.lower_bound_mm
        self._rotations[number], self._tips_mm[number] = tip.rotation, tip.translation_mm

    def _tip(self, frame: str) -> Transform:
        """The tip at this step in a tracked frame."""
        if frame not in self._tips:
            tool = self._tools[frame].transform
            assert tool is not None, "poses are without a fault"
            self._tips[frame] = tool @ self._setup.tool_from_tip
        return self._tips[frame]

    def _forget(self) -> None:
        self._known.clear()
        self._at_least_mm[:] = -math.inf
