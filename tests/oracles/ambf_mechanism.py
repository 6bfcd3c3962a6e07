"""Link poses of an ADF from the values of its YAML text, by plain matrices only."""

import numpy as np

from tests.oracles.ambf_poses import world_from_body


def about(axis, angle):
    """Rotation (4, 4) about a unit axis by the series of the exponential, summed to rounding."""
    x, y, z = np.asarray(axis, dtype=float)
    generator = np.zeros((4, 4))
    generator[:3, :3] = angle * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    term, total = np.eye(4), np.eye(4)
    for order in range(1, 60):
        term = term @ generator / order
        total = total + term
    return total


def moved(vector_m):
    """Translation (4, 4) in mm."""
    matrix = np.eye(4)
    matrix[:3, 3] = 1000.0 * np.asarray(vector_m, dtype=float)
    return matrix


def turned(start, end):
    """Rotation (4, 4) in the plane of two vectors that are not opposite."""
    start, end = (np.asarray(v, float) / np.linalg.norm(v) for v in (start, end))
    across = np.cross(start, end)
    length = np.linalg.norm(across)
    if length < 1e-12:
        return np.eye(4)
    return about(across / length, np.arctan2(length, start @ end))


def xyz(section, key):
    return np.array([float(section[key][axis]) for axis in "xyz"])


def link_poses(document, positions):
    """``world_from_link`` (4, 4) by body, along each body's first joint; positions by joint."""
    poses, first = {}, {}
    for key in document["joints"]:
        joint = document[key]
        if joint["type"] != "p2p":
            first.setdefault(joint["child"], joint)
    bodies = list(document["bodies"])
    while bodies:
        body = bodies.pop(0)
        joint = first.get(body)
        if joint is None:
            poses[body] = world_from_body(document[body]["location"])
        elif joint["parent"] not in poses:
            bodies.append(body)
        else:
            poses[body] = poses[joint["parent"]] @ step(joint, positions.get(joint["name"], 0.0))
    return poses


def step(joint, position):
    """Pose (4, 4) of the child in the parent: by pivots, axes and offset, at a position."""
    axis = xyz(joint, "parent axis")
    axis = axis / np.linalg.norm(axis)
    angle = joint.get("joint offset", 0.0) + joint.get("offset", 0.0)
    slide = np.eye(4)
    if joint["type"] == "prismatic":
        slide = moved(position * axis)
    else:
        angle += position
    return (
        slide
        @ moved(xyz(joint, "parent pivot"))
        @ about(axis, angle)
        @ turned(xyz(joint, "child axis"), axis)
        @ moved(-xyz(joint, "child pivot"))
    )


def loop_gaps(document, poses):
    """For each joint, how far its pivots (mm) and its axes (rad) are apart in ``poses`` by body."""
    for key in document["joints"]:
        joint = document[key]
        parent, child = poses[joint["parent"]], poses[joint["child"]]
        gap = (parent @ moved(xyz(joint, "parent pivot")))[:3, 3]
        gap = gap - (child @ moved(xyz(joint, "child pivot")))[:3, 3]
        axis = parent[:3, :3] @ xyz(joint, "parent axis")
        if joint["type"] == "prismatic":
            gap = gap - (gap @ axis) * axis
        across = np.cross(axis, child[:3, :3] @ xyz(joint, "child axis"))
        angle = 0.0 if joint["type"] == "p2p" else float(np.linalg.norm(across))
        yield joint["name"], float(np.linalg.norm(gap)), angle
