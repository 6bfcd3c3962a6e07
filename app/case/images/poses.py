"""Products of the poses of one frame, by the numbers that its file prints."""

import numpy as np

from app.geometry import FloatArray, TrackingStatus

FramePoses = dict[tuple[str, str], FloatArray | TrackingStatus]
"""(target, source) to a matrix (4, 4), or to the status of a pose that is lost."""


def matrix_between(poses: FramePoses, target: str, source: str) -> FloatArray | str:
    """Return ``target_from_source`` (4, 4) through ``poses``, or the reason why it is not known.

    The path with the fewest poses is used.
    """
    steps: dict[str, dict[str, FloatArray]] = {}
    for (parent, child), pose in poses.items():
        if not isinstance(pose, TrackingStatus):
            steps.setdefault(child, {})[parent] = pose
            inverse = np.asarray(np.linalg.inv(pose), dtype=np.float64)
            steps.setdefault(parent, {})[child] = inverse
    reached: dict[str, FloatArray] = {source: np.eye(4)}
    to_visit = [source]
    for frame in to_visit:  # grows in the loop: a search in breadth
        for neighbour, step in steps.get(frame, {}).items():
            if neighbour not in reached:
                reached[neighbour] = step @ reached[frame]
                to_visit.append(neighbour)
    if target in reached:
        return reached[target]
    lost = [
        f"{parent} -> {child} is {pose.name}"
        for (parent, child), pose in poses.items()
        if isinstance(pose, TrackingStatus)
    ]
    return ", ".join(lost) or f"no pose connects {target!r} with {source!r}"
