"""Markers of plans for RViz. Each array replaces the one before it."""

import math
from collections.abc import Iterable

from geometry_msgs.msg import Pose, Quaternion
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from app.bridge.messages import color_message, point_message
from app.geometry import FloatArray, Transform
from app.planning import NeedlePlan

_WAY_RGB, _BEST_RGB, _OTHER_RGB = (0.2, 0.6, 1.0), (0.0, 0.9, 0.2), (0.9, 0.9, 0.2)
_BLOCKED = color_message((0.6, 0.1, 0.1), 0.3)
_LINE_M, _GOAL_M, _ENTRY_M = 0.001, 0.006, 0.001


def way_markers(frame_from_root: Transform, tips_mm: FloatArray) -> MarkerArray:
    """The way of the tool's tip, ``tips_mm`` (n, 3) in the root link, and its end."""
    places = frame_from_root.apply(tips_mm)
    way = _marker("planned_way", frame_from_root.target, Marker.LINE_STRIP, _LINE_M, places)
    way.color = color_message(_WAY_RGB)
    goal = _marker("planned_goal", frame_from_root.target, Marker.SPHERE_LIST, _GOAL_M, places[-1:])
    goal.color = color_message(_WAY_RGB)
    return _replacing(way, goal)


def corridor_markers(plan: NeedlePlan) -> MarkerArray:
    """All entries, from yellow to green by their score and red where blocked, and the corridors."""
    frame = plan.region.frame
    entries = _marker("entries", frame, Marker.POINTS, _ENTRY_M, plan.region.points_mm)
    entries.colors = [
        _BLOCKED if math.isnan(score) else color_message((1.0 - score, 0.8, 0.0))
        for score in plan.scores.tolist()
    ]
    corridors = _marker(
        "corridors",
        frame,
        Marker.LINE_LIST,
        _LINE_M,
        (end for each in plan.corridors for end in (each.entry_mm, each.target_mm)),
    )
    corridors.colors = [
        color_message(_OTHER_RGB if number else _BEST_RGB)
        for number in range(len(plan.corridors))
        for _ in range(2)
    ]
    return _replacing(entries, corridors)


def _replacing(*markers: Marker) -> MarkerArray:
    return MarkerArray(markers=[Marker(action=Marker.DELETEALL), *markers])


def _marker(
    name: str, frame: str, kind: int, size_m: float, points_mm: Iterable[FloatArray]
) -> Marker:
    marker = Marker(
        header=Header(frame_id=frame),
        ns=name,
        type=kind,
        action=Marker.ADD,
        pose=Pose(orientation=Quaternion(w=1.0)),
        color=ColorRGBA(a=1.0),
        frame_locked=True,
        points=[point_message(each) for each in points_mm],
    )
    marker.scale.x = marker.scale.y = marker.scale.z = size_m
    return marker
