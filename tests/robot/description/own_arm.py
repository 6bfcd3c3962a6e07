"""An arm in the layout of AMBF's Blender add-on, with a mesh for each body."""

import itertools
from pathlib import Path

import numpy as np
import trimesh
import yaml
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

BODIES = ("base", "upper", "lower", "tool")


def write_arm(folder: Path) -> Path:
    """Write the arm with meshes in ``meshes/low_res`` instead of the folders that it names."""
    (folder / "meshes" / "low_res").mkdir(parents=True)
    keys = [f"BODY {name}" for name in BODIES]
    joints = [f"JOINT {a}-{b}" for a, b in itertools.pairwise(BODIES)]
    rng = np.random.default_rng(11)
    document = {
        "bodies": keys,
        "joints": joints,
        "high resolution path": "../../arm/high_res/",
        "low resolution path": "../../arm/low_res/",
    }
    poses = [np.eye(4)]
    for _ in BODIES[1:]:
        step = np.eye(4)
        step[:3, :3] = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
        step[:3, 3] = rng.uniform(-0.3, 0.3, 3)
        poses.append(poses[-1] @ step)
    for key, name, pose in zip(keys, BODIES, poses, strict=True):
        angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz")
        document[key] = {
            "name": name,
            "mesh": f"{name}.STL",
            "location": {
                "position": vector(pose[:3, 3]),
                "orientation": dict(zip("rpy", angles.tolist(), strict=True)),
            },
            "color components": {"diffuse": dict(zip("rgb", (0.1, 0.5, 0.9), strict=True))},
        }
        box = trimesh.creation.box(extents=rng.uniform(0.02, 0.1, 3))
        box.export(folder / "meshes" / "low_res" / f"{name}.STL")
    for key, (start, end) in zip(joints, itertools.pairwise(range(len(BODIES))), strict=True):
        parent_from_child = np.linalg.inv(poses[start]) @ poses[end]
        axis, pivot = np.eye(3)[end % 3], rng.uniform(-0.05, 0.05, 3)
        turned = parent_from_child[:3, :3] @ axis
        across, angle = np.cross(axis, turned), np.arccos(axis @ turned)
        shortest = Rotation.from_rotvec(angle * across / np.linalg.norm(across))
        left = Rotation.from_matrix(parent_from_child[:3, :3]) * shortest.inv()
        document[key] = {
            "name": key.removeprefix("JOINT "),
            "parent": keys[start],
            "child": keys[end],
            "type": "revolute",
            "parent axis": vector(turned),
            "parent pivot": vector(parent_from_child[:3, :3] @ pivot + parent_from_child[:3, 3]),
            "child axis": vector(axis),
            "child pivot": vector(pivot),
            "offset": float(left.as_rotvec() @ turned),
            "joint limits": {"low": -3.054, "high": 3.054},
        }
    path = folder / "arm.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return path


def vector(values: ArrayLike) -> dict[str, float]:
    return dict(zip("xyz", np.asarray(values).tolist(), strict=True))
