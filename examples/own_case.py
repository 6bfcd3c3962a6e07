"""Write a case from your own meshes and poses, and replay it.

A ball of 2 mm passes through a tumour of 10 mm in diameter. Expect one breach, 3 mm deep. Replace
the meshes by `mg.load_mesh(...)` and the loop by your recorded poses.

    python examples/own_case.py [FOLDER]
"""

import sys

import numpy as np
import trimesh

import marginguard as mg

folder = sys.argv[1] if len(sys.argv) > 1 else "my_case"


def pose(target: str, source: str, position_mm: list[float]) -> mg.Transform:
    """``target_from_source`` without a rotation."""
    return mg.Transform(target, source, np.eye(3), position_mm)


def ball(frame: str, radius_mm: float) -> mg.SurfaceMesh:
    """A closed surface about the origin of ``frame``."""
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius_mm)
    return mg.SurfaceMesh(frame, mesh.vertices, mesh.faces)


# At 50 Hz for 2 s: a time in s and the poses measured then. A lost pose is left out.
poses = [
    (
        index / 50,
        [
            pose("tracker", "needle", [0.0, 0.0, 200.0]),
            pose("tracker", "cautery", [-20.0 + 20.0 * index / 50, 3.0, 80.0]),
        ],
    )
    for index in range(101)
]
mg.write_case(
    folder,
    poses,
    tool=ball("cautery_tip", 1.0),
    tool_from_tip=pose("cautery", "cautery_tip", [0.0, 0.0, 120.0]),
    tumor=ball("tumor", 5.0),
    frame_from_tumor=pose("needle", "tumor", [0.0, 0.0, 0.0]),
    margins=mg.MarginParameters(
        stop_mm=1.0,
        warn_mm=5.0,
        k_tre=2.0,
        v_max_mm_s=50.0,
        stale_after_ns=60_000_000,
        release_samples=3,
        release_band_mm=0.5,
        frozen_after_ns=5_000_000_000,  # the needle does not move at all here
    ),
    name="a ball passes through a ball",
    provenance="simulated",
    source="examples/own_case.py",
)
print(f"wrote {folder}; 'marginguard replay {folder}' replays it, too")

case = mg.open_case(folder)
for breach in mg.find_breaches(case, mg.replay(case)):
    depth_mm = -breach.min_signed_distance_mm
    print(f"breach from {breach.start_s:.2f} to {breach.end_s:.2f} s, {depth_mm:.2f} mm deep")
