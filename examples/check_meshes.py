"""Check a tool's mesh against a tumour's mesh.

Expect the size of both meshes, and the signed distance at five poses on a straight way into the
tumour: positive outside, negative inside, where it is the depth. An open mesh is refused.

    python examples/check_meshes.py [TOOL.stl TUMOR.stl]
"""

import sys

import numpy as np

import marginguard as mg

shipped = mg.example_case()
files = sys.argv[1:] or [shipped / "cautery.stl", shipped / "tumor.stl"]
tool = mg.load_mesh(files[0], units="mm", frame="tool")  # its tip is the origin, +z forward
tumor = mg.load_mesh(files[1], units="mm", frame="tumor")

for name, mesh in (("tool", tool), ("tumor", tumor)):
    low, high = mesh.bounds_mm
    size = " x ".join(f"{length:.1f}" for length in high - low)
    print(f"{name}: {size} mm, {mesh.signed_volume_mm3 / 1000:.2f} ml, {len(mesh.faces)} triangles")

engine = mg.ProximityEngine(tumor, tool)  # prepares both meshes; raises for an open one
downwards = np.diag([1.0, -1.0, -1.0])
top_mm = tumor.bounds_mm[1][2]
for height_mm in (20.0, 10.0, 5.0, 0.0, -5.0):
    pose = mg.Transform("tumor", "tool", downwards, [0.0, 0.0, top_mm + height_mm])
    proximity = engine.evaluate(pose)
    contact = "  the surfaces intersect" if proximity.contact else ""
    print(f"tip {height_mm:+5.1f} mm: {proximity.signed_distance_mm:+6.2f} mm{contact}")
