"""Products of the poses of one frame, by the numbers that its file prints."""

import numpy as np

from app.geometry import Edge, FloatArray, TrackingStatus, shortest_path

FramePoses = dict[Edge, FloatArray | TrackingStatus]
"""(target, source) to a matrix (4, 4), or to the status of a pose that is lost."""


def matrix_between(poses: FramePoses, target: str, source: str) -> FloatArray | str:
    """Return ``target_from_source`` (4, 4) through ``poses``, or the reason why it is not known.

    The path with the fewest poses is used.
    """
    known = {edge: pose for edge, pose in poses.items() if not isinstance(pose, TrackingStatus)}
    path = shortest_path(known, source, target)
    if path is not None:
        found, frame = np.eye(4), source
        for parent, child in path:
            pose = known[parent, child]
            found = (pose if child == frame else np.linalg.inv(pose)) @ found
            frame = parent if child == frame else child
        return found
    lost = [
        f"{parent} -> {child} is {pose.name}"
        for (parent, child), pose in poses.items()
        if isinstance(pose, TrackingStatus)
    ]
    return ", ".join(lost) or f"no pose connects {target!r} with {source!r}"
