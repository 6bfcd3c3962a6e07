"""Save the deepest moment of a case as a scene of 3D Slicer.

Expect deepest.mrb, which 3D Slicer opens by drag and drop: tumour, tool, robot, the plane of the
fixture, and the recording, which its Sequences module plays.

    python examples/slicer_scene.py [CASE] [FILE.mrb]
"""

import sys

import marginguard as mg

folder, file = [*sys.argv[1:], *[mg.example_case(), "deepest.mrb"][len(sys.argv) - 1 :]]

case = mg.open_case(folder)
steps = list(mg.replay(case))
measured = [step for step in steps if step.decision.proximity is not None]
deepest = min(measured, key=lambda step: step.decision.proximity.signed_distance_mm)

mg.save_scene(case, deepest, file, recording=steps)
print(f"frame {deepest.index}: {deepest.decision.proximity.signed_distance_mm:+.2f} mm")
print(f"wrote {file}")
