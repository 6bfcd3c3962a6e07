"""Register a robot's base to the patient's reference sensor at landmarks.

Expect the transform, residuals of 0.2 to 0.4 mm, and an error of 0.6 mm predicted at the tumour,
which decides on the acceptance. It is larger than the residuals: the tumour is far from the
landmarks.

    python examples/register_points.py
"""

import numpy as np

import marginguard as mg

# One row per landmark, in mm: the tip by the robot's joints, and by the tracker.
in_base = np.array(
    [[180, -60, 40], [240, -50, 45], [250, 30, 60], [190, 50, 38], [215, -5, 20]], dtype=float
)
in_reference = np.array(
    [
        [53.66, -27.25, -85.39],
        [44.28, 32.44, -80.23],
        [-35.29, 43.36, -65.14],
        [-55.66, -16.23, -86.88],
        [-1.05, 8.03, -105.05],
    ]
)
tumor_in_reference = np.array([[10.0, 5.0, 60.0]])

result = mg.register_points(
    in_reference,
    in_base,
    fixed_frame="reference",
    moving_frame="robot_base",
    targets_mm=tumor_in_reference,  # the error there decides on the acceptance
)

np.set_printoptions(precision=3, suppress=True)
print(f"reference_from_robot_base, mm:\n{result.transform.matrix}")
for number, residual_mm in enumerate(result.residuals_mm, start=1):
    print(f"landmark {number}: residual {residual_mm:.2f} mm")
print(f"FRE {result.fre_mm:.2f} mm (residuals), FLE {result.fle_mm:.2f} mm (one landmark)")
print(f"TRE {mg.predict_tre(result, tumor_in_reference)[0]:.2f} mm (expected error at the tumour)")
print(f"accepted: {result.accepted}: {result.reason}")
