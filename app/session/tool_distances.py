"""Distance of the guarded tool from the other tools: a warning, and no part of the decision."""

import math
from collections.abc import Set as AbstractSet
from typing import NamedTuple

from app.case import TrackingFrame
from app.fixture import MarginState, Proximity, Reason, path_mm, worst_first
from app.geometry import Transform
from app.session.far_structures import BEYOND_MM
from app.session.pose_tree import PoseRules, PoseTree
from app.session.setup import REFERENCE, OtherTool, SessionSetup


class ToolDistance(NamedTuple):
    """Distance of the guarded tool from the tool ``name`` at one step.

    ``state``: WARNING up to the stated distance, by the lower bound of the measured one, NEGATIVE
    beyond it, and UNKNOWN for the ``reasons`` for which a pose is not known. ``proximity``: in the
    frame of the other's tip, negative where the tools overlap, None if it was not measured. A far
    tool was not (`app.session.far_structures`): it is at least ``at_least_mm`` away.
    """

    name: str
    state: MarginState
    reasons: tuple[Reason, ...]
    proximity: Proximity | None = None
    at_least_mm: float | None = None

    @property
    def text(self) -> str:
        """A sentence, as ``tool 'left' is 3.2 mm away``."""
        tool = f"tool {self.name!r}"
        if self.at_least_mm is not None:
            return f"{tool} is at least {math.floor(self.at_least_mm)} mm away"
        if self.proximity is None:
            return f"distance of {tool} is not known ({', '.join(self.reasons)})"
        distance_mm = self.proximity.signed_distance_mm
        if distance_mm > 0.0:
            return f"{tool} is {distance_mm:.1f} mm away"
        depth = f"{-distance_mm:.1f}"
        return f"{tool} touches" if depth == "0.0" else f"{tool} overlaps by {depth} mm"

    @property
    def warning(self) -> str:
        """``text`` if the tool is near or its distance is not known, else empty."""
        return "" if self.state is MarginState.NEGATIVE else self.text


class ToolDistances:
    """Follows the other tools of a session by poses of its own: no decision depends on them.

    ``skip_far``: tools that are far are not measured.
    """

    def __init__(self, setup: SessionSetup, *, skip_far: bool) -> None:
        self._skip_far = skip_far
        self._poses = PoseTree(PoseRules(setup.margins.freshness_limits, ()))
        self.use(setup)

    def use(self, setup: SessionSetup) -> None:
        """Replace the setup from the next step on."""
        self._setup, self._tool = setup, setup.tool_from_tip.target
        others = (each.tool_from_tip.target for each in setup.other_tools)
        moving = (*setup.moving_frames, REFERENCE, *others)
        self._poses.use(PoseRules(setup.margins.freshness_limits, moving))
        self._tips = [each.tool_from_tip.inverse() for each in setup.other_tools]
        self._last: dict[str, tuple[Transform, float]] = {}
        """Pose at which each was measured last, and its lower bound in mm there."""

    def update(
        self, frame: TrackingFrame, problems: AbstractSet[Reason]
    ) -> tuple[ToolDistance, ...]:
        """The distances at ``frame``; not known with ``problems``, which concern every pose."""
        self._poses.insert(frame)
        return tuple(
            self._distance(other, tip, problems)
            for other, tip in zip(self._setup.other_tools, self._tips, strict=True)
        )

    def _distance(
        self, other: OtherTool, tip_from_tool: Transform, problems: AbstractSet[Reason]
    ) -> ToolDistance:
        measured = self._poses.pose(other.tool_from_tip.target, self._tool)
        if measured.transform is None or problems:
            reasons = worst_first(problems | measured.problems)
            return ToolDistance(other.name, MarginState.UNKNOWN, reasons)
        pose = tip_from_tool @ measured.transform @ self._setup.tool_from_tip
        if self._skip_far and other.name in self._last:
            before, before_mm = self._last[other.name]
            at_least_mm = before_mm - path_mm(before, pose, other.proximity.radius_mm)
            if at_least_mm > other.warn_mm + BEYOND_MM:
                clear = (Reason.CLEAR,)
                return ToolDistance(other.name, MarginState.NEGATIVE, clear, None, at_least_mm)
        proximity = other.proximity.evaluate(pose, measured.oldest)
        self._last[other.name] = pose, proximity.lower_bound_mm
        if proximity.lower_bound_mm > other.warn_mm:
            return ToolDistance(other.name, MarginState.NEGATIVE, (Reason.CLEAR,), proximity)
        near = (Reason.WARNING_DISTANCE,)
        return ToolDistance(other.name, MarginState.WARNING, near, proximity)
