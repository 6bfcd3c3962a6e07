"""Configured relations between measurements: where one fails, one of the measurements is wrong."""

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np

from app.case import (
    ApproachEntry,
    BoxEntry,
    DistanceEntry,
    EnvelopeEntry,
    PlausibilityEntry,
    SphereEntry,
)
from app.geometry import NS_PER_S, Stamp, Transform, closest_rotation

LEARN_NS = 5 * NS_PER_S
"""Time over which the centre of an envelope is averaged: more than one breath of 4 s."""

ENDS_AFTER_NS = NS_PER_S // 2
"""Time for which a relation must hold before its contradiction ends: noise at the limit would
begin and end one with every sample."""

PoseOf = Callable[[str, str], Transform | None]
"""``target_from_source`` by the names of two frames, None where it is not known."""


Problems = dict[str, str]
"""Name of a sensor or a relation -> one line on its problem."""


class Relation(Protocol):
    """One relation; ``name`` says of which frames."""

    name: str

    def check(self, pose_of: PoseOf, now: Stamp) -> str | None:
        """One line on a contradiction at ``now``, empty if it holds, None for unknown frames."""


class Relations:
    """All relations of a session, for a tool with its tip at ``tool_from_tip``.

    A relation whose frames are not measured now is reported as unknown: it checks nothing.
    """

    def __init__(self, entry: PlausibilityEntry, tool_from_tip: Transform) -> None:
        self._entry = entry
        self._pairs: list[Relation] = [
            _Envelope(pair) if isinstance(pair, EnvelopeEntry) else _Distance(pair)
            for pair in entry.pairs
        ]
        self._failed: dict[str, tuple[int, str]] = {}
        """Time of the last failure of each relation, and its first text."""
        self.use_tip(tool_from_tip)

    def use_tip(self, tool_from_tip: Transform) -> None:
        """Check with another tip in the same frames.

        What the relations of two sensors have learned stays, and so does every contradiction.
        """
        entry = self._entry
        self._of_tip: list[Relation] = []
        if entry.workspace is not None:
            self._of_tip.append(_Workspace(entry.workspace, tool_from_tip))
        if entry.approach is not None:
            self._of_tip.append(_Approach(entry.approach, tool_from_tip))

    def __bool__(self) -> bool:
        """True if there is a relation."""
        return bool(self._pairs or self._of_tip)

    def check(self, pose_of: PoseOf, now: Stamp) -> tuple[Problems, Problems]:
        """The relations that fail at ``now``, and those that cannot be checked."""
        failed: Problems = {}
        unknown: Problems = {}
        for relation in (*self._pairs, *self._of_tip):
            name, problem = relation.name, relation.check(pose_of, now)
            last_ns, text = self._failed.get(name, (now.ns, f"{name} {problem}"))
            if problem is None:
                unknown[name] = f"{name} is not known"
            elif problem:
                self._failed[name], failed[name] = (now.ns, text), text
            elif name in self._failed:
                if 0 <= now.ns - last_ns < ENDS_AFTER_NS:
                    failed[name] = text
                else:
                    del self._failed[name]
        return failed, unknown


class _Envelope:
    """Displacement and rotation of a frame from the middle of its envelope."""

    def __init__(self, entry: EnvelopeEntry) -> None:
        self._entry = entry
        self.name = f"{entry.child} in {entry.parent}"
        self._middle = entry.parent_from_child
        self._since: Stamp | None = None
        self._sum = np.zeros((3, 4))
        self._count = 0

    def check(self, pose_of: PoseOf, now: Stamp) -> str | None:
        entry = self._entry
        pose = pose_of(entry.parent, entry.child)
        if pose is None:
            return None
        if self._middle is None:
            self._learn(pose, now)
            return ""
        away_mm, turned_rad = pose.distance_mm_to(self._middle), pose.angle_to(self._middle)
        if away_mm <= entry.max_mm and turned_rad <= entry.max_rad:
            return ""
        return (
            f"is {away_mm:.1f} mm and {math.degrees(turned_rad):.1f} degrees from the "
            f"middle of its envelope; expected at most {entry.max_mm:g} mm and "
            f"{math.degrees(entry.max_rad):.3g} degrees"
        )

    def _learn(self, pose: Transform, now: Stamp) -> None:
        """Add ``pose`` to the mean, which is the middle once it covers `LEARN_NS`."""
        if self._since is None or now < self._since:  # the source's clock may jump back
            self._since, self._count = now, 0
            self._sum = np.zeros((3, 4))
        self._sum[:, :3] += pose.rotation
        self._sum[:, 3] += pose.translation_mm
        self._count += 1
        if now.ns - self._since.ns >= LEARN_NS:
            mean = self._sum / self._count
            rotation = closest_rotation(mean[:, :3])
            self._middle = Transform(pose.target, pose.source, rotation, mean[:, 3])


class _Distance:
    """Distance between the origins of two frames, such as two sensors on one tool."""

    def __init__(self, entry: DistanceEntry) -> None:
        self._entry = entry
        self.name = f"{entry.child} from {entry.parent}"

    def check(self, pose_of: PoseOf, now: Stamp) -> str | None:
        entry = self._entry
        pose = pose_of(entry.parent, entry.child)
        if pose is None:
            return None
        distance_mm = math.hypot(*pose.translation_mm.tolist())
        if abs(distance_mm - entry.distance_mm) <= entry.tolerance_mm:
            return ""
        return (
            f"is {distance_mm:.1f} mm apart; expected {entry.distance_mm:g} mm within "
            f"{entry.tolerance_mm:g} mm"
        )


class _Workspace:
    """Position of the tip in a sphere or a box."""

    def __init__(self, entry: SphereEntry | BoxEntry, tool_from_tip: Transform) -> None:
        self._entry, self._tool_from_tip = entry, tool_from_tip
        self.name = f"{tool_from_tip.source} in {entry.frame}"

    def check(self, pose_of: PoseOf, now: Stamp) -> str | None:
        entry, tool_from_tip = self._entry, self._tool_from_tip
        pose = pose_of(entry.frame, tool_from_tip.target)
        if pose is None:
            return None
        x, y, z = pose.apply(tool_from_tip.translation_mm).tolist()
        if isinstance(entry, SphereEntry):
            away_mm = math.dist((x, y, z), entry.center_mm)
            if away_mm <= entry.radius_mm:
                return ""
            return (
                f"is {away_mm:.1f} mm from the middle of the workspace; "
                f"expected at most {entry.radius_mm:g} mm"
            )
        bounds = zip(entry.min_mm, entry.max_mm, strict=True)
        for axis, value, (low, high) in zip("xyz", (x, y, z), bounds, strict=True):
            if not low <= value <= high:
                return (
                    f"is at {axis} = {value:.1f} mm; expected {low:g} to {high:g} mm, the workspace"
                )
        return ""


class _Approach:
    """Angle between the tool's axis and a direction, such as that of gravity."""

    def __init__(self, entry: ApproachEntry, tool_from_tip: Transform) -> None:
        self._entry, self._tool_from_tip = entry, tool_from_tip
        self.name = f"axis of {tool_from_tip.source} in {entry.frame}"
        self._axis = tool_from_tip.rotate(entry.axis)

    def check(self, pose_of: PoseOf, now: Stamp) -> str | None:
        entry = self._entry
        pose = pose_of(entry.frame, self._tool_from_tip.target)
        if pose is None:
            return None
        cosine = sum(a * b for a, b in zip(pose.rotate(self._axis), entry.direction, strict=True))
        angle = math.acos(min(max(float(cosine), -1.0), 1.0))
        if angle <= entry.max_rad:
            return ""
        return (
            f"is {math.degrees(angle):.1f} degrees from the approach; "
            f"expected at most {math.degrees(entry.max_rad):.3g} degrees"
        )
