"""Plan a needle's corridor, and insert the needle along it to a target that breathes.

The target is in the tumour of a simulated case, above the chest wall. A robot's approach to the
entry is planned. Then a hand pushes the needle towards the target and sideways, too; half-spaces
hold it on the corridor, and at its depth while the breath has moved the target away. Expect that
it arrives less than 2 mm beside the target, and the files needle.html (the map of entries),
approach.html (the robot's ghost and its way) and insertion.png.

    python examples/needle_insertion.py [FOLDER]
"""

import json
import math
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

import marginguard as mg

CASE, LENGTH_MM, DIAMETER_MM = "package://marginguard/structures_case", 120.0, 1.2
BREATH_MM, BREATHS_HZ, WINDOW_MM = np.array([0.0, 3.0, 2.0]), 0.25, 1.0
PERIOD_S, NOISE_MM = 0.01, 0.2
folder = Path(sys.argv[1] if len(sys.argv) > 1 else "needle")
folder.mkdir(exist_ok=True)
rng = np.random.default_rng(1)


def run(command: str) -> None:
    """Run a command of marginguard in the folder."""
    subprocess.run([sys.executable, "-m", "marginguard", *command.split()], cwd=folder, check=True)


# The plan: a disc of entries above the tumour. sigma contains noise and window.
run(f"""plan needle {CASE} --entry-frame reference
    --entry-disc -15 -133 -27 -0.25 -0.34 0.9 40 --length-mm {LENGTH_MM} --diameter-mm {DIAMETER_MM}
    --bend-mm 0 --sigma-mm {math.hypot(NOISE_MM, WINDOW_MM)} --robot --out plan.json --report .""")
plan = json.loads((folder / "plan.json").read_text())
best = plan["corridors"][0]
path = mg.NeedlePath(plan["frame"], best["entry_mm"], best["target_mm"])

# The distance of needle and chest wall.
case = mg.open_case(CASE)
(wall,) = [each for each in case.content.structures if each.role == "forbidden"]
frame_from_wall, _ = next(iter(mg.replay(case))).edges.between(path.frame, wall.name)
shape = trimesh.creation.capsule(LENGTH_MM - DIAMETER_MM, DIAMETER_MM / 2)
shaft_mm = shape.vertices - [0.0, 0.0, shape.bounds[1][2]]  # the tip is the origin
engine = mg.ProximityEngine(
    wall.surface.transformed(frame_from_wall), mg.SurfaceMesh("needle", shaft_mm, shape.faces)
)

# The approach: from above the entry, with the waist turned away, to the entry, past the wall.
arm = case.setup.robot
frame_from_root = arm.registration.transform.renamed(source=arm.robot.root_link)
holder = mg.NeedleRobot(arm.robot, frame_from_root, arm.link_from_tip)
goal = holder.insertion(path.entry_mm, path.target_mm)[0]
above = holder.insertion(2.0 * path.entry_mm - path.target_mm, path.target_mm)[0]
joint_limits = {name: {"acceleration": 5.0, "jerk": 50.0, "velocity": 0.5} for name in goal}
for name, values in (
    ("start", {**above, "waist": above["waist"] + 0.5}),
    ("goal", goal),
    ("limits", joint_limits),
):
    (folder / f"{name}.yaml").write_text(json.dumps(values))
in_root = wall.surface.transformed(frame_from_root.inverse() @ frame_from_wall)
trimesh.Trimesh(in_root.vertices_mm, in_root.faces).export(folder / "chest_wall.stl")
run("""plan approach package://marginguard/robots/touch/touch.urdf --start start.yaml
    --goal goal.yaml --limits limits.yaml --structure chest_wall.stl --clearance-mm 5
    --out approach.json --report .""")


def guard_planes(pose: mg.Transform) -> mg.Constraint:
    """Half-spaces at the stop margin of the chest wall, as a session publishes them."""
    found = engine.evaluate(pose).witnesses
    along = np.einsum("ij,ij->i", found.normals, found.on_tool_mm)
    offsets = along - (found.signed_distance_mm - wall.stop_mm)
    still = np.zeros_like(found.normals)
    return mg.Constraint(path.frame, found.normals, offsets, found.on_tool_mm, still, hold=False)


axes, limits = path.frame_from_path, mg.LimiterParameters()
needle = axes @ mg.Transform("needle_path", "needle", np.eye(3), [0.3, -0.2, -3.0])
rows = []
for tick in range(3000):
    time_s = tick * PERIOD_S
    breath_mm = math.sin(math.pi * BREATHS_HZ * time_s) ** 4 * BREATH_MM
    target_mm = path.target_mm + breath_mm
    noise_mm = rng.normal(scale=NOISE_MM, size=3)
    measured = mg.Transform(path.frame, "needle", needle.rotation, needle.translation_mm + noise_mm)
    is_near = path.is_target_near(target_mm, WINDOW_MM)
    guidance = mg.guide_needle(path, measured)
    true = mg.guide_needle(path, needle)
    wall_mm = engine.evaluate(needle).signed_distance_mm
    rows.append((time_s, true.lateral_mm, true.remaining_mm, wall_mm, is_near))
    if tick % 50 == 0:
        print(
            f"{time_s:.2f} s: {guidance.remaining_mm:5.2f} mm to go, tip {guidance.lateral_mm:.2f} "
            f"mm beside the path, chest wall {wall_mm:.2f} mm away{'' if is_near else ', waits'}"
        )
    if is_near and guidance.remaining_mm < NOISE_MM:
        break
    planes = mg.needle_constraint(
        path,
        measured,
        tolerance_mm=1.0,
        may_advance=is_near,
        guard=guard_planes(measured),
        shaft_mm=LENGTH_MM,
    )
    push = axes.rotate([8.0 * math.sin(3.0 * time_s), 5.0, 15.0])  # mm/s
    turn = rng.normal(scale=0.2, size=3)  # rad/s
    twist = mg.limit_twist(np.append(push, turn), planes, measured.translation_mm, limits)
    rotation = Rotation.from_rotvec(PERIOD_S * twist[3:]).as_matrix() @ needle.rotation
    place_mm = needle.translation_mm + PERIOD_S * twist[:3]
    needle = mg.Transform(path.frame, "needle", rotation, place_mm)

times_s, lateral_mm, remaining_mm, walls_mm, near = np.array(rows).T
missed_mm = axes.inverse().rotate(needle.translation_mm - target_mm)
print(
    f"arrived after {times_s[-1]:.2f} s, {(1.0 - near).sum() * PERIOD_S:.2f} s of them waiting: "
    f"{math.hypot(*missed_mm[:2]):.2f} mm beside the target, never further than "
    f"{lateral_mm.max():.2f} mm from the path nor nearer than {walls_mm.min():.2f} mm to the wall"
)
figure, plots = plt.subplots(3, sharex=True, figsize=(7.0, 7.0))
for plot, values, name in zip(
    plots,
    (lateral_mm, remaining_mm, walls_mm),
    ("tip to path (mm)", "depth to go (mm)", "to the chest wall (mm)"),
    strict=True,
):
    plot.plot(times_s, values)
    plot.fill_between(times_s, 0.0, values.max(), where=near < 0.5, alpha=0.2, label="waits")
    plot.set_ylabel(name)
plots[0].legend()
plots[-1].set_xlabel("time (s)")
figure.savefig(folder / "insertion.png")
print(f"wrote needle.html, approach.html and insertion.png in {folder}")
