"""Limit a simulated hand to the planes of a virtual fixture.

A hand pushes the tool at 40 mm/s, straight into the tumour. Expect that the tool moves freely at
first, then slows down with the distance to the planes, and never passes one.

    python examples/limit_twist.py
"""

import numpy as np

import marginguard as mg

PERIOD_S = 0.001  # of the control loop
parameters = mg.LimiterParameters(tau_s=0.05)

# The planes of the shipped case, 0.4 s before the tool touches the tumour.
case = mg.open_case(mg.example_case())
*_, step = mg.replay(case, start_s=90.0, end_s=95.3)
planes = step.decision.constraint
normal = planes.normals[0]
desired = np.concatenate([-40.0 * normal, np.zeros(3)])  # mm/s and rad/s

points_mm = planes.points_on_tool_mm
for tick in range(501):
    now = mg.Constraint(
        planes.frame,
        planes.normals,
        planes.offsets_mm,
        points_mm,  # the tool has moved, the planes have not
        planes.tumor_velocities_mm_s,
        hold=False,
    )
    allowed = mg.limit_twist(desired, now, points_mm[0], parameters)
    if tick % 50 == 0:
        print(
            f"{tick * PERIOD_S:.2f} s: {now.clearances_mm.min():5.2f} mm to the nearest plane, "
            f"the tool moves at {np.linalg.norm(allowed[:3]):5.2f} of 40.00 mm/s"
        )
    points_mm = points_mm + PERIOD_S * allowed[:3]  # a rotation of the tool is not simulated
