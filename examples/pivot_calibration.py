"""Find the tip of a tracked stylus from poses that rotate about it.

Expect a tip within 0.2 mm of the truth for a wide swing. The narrow swing is refused although its
residual is as small: a residual does not measure the error of the tip.

    python examples/pivot_calibration.py
"""

import math

import numpy as np

import marginguard as mg

TIP_MM = np.array([2.0, -1.0, 140.0])  # in the stylus, to be found
PIVOT_MM = np.array([50.0, 20.0, -300.0])  # where the tip rests, in the tracker
rng = np.random.default_rng(seed=1)


def swing(half_angle_deg: float, count: int = 200) -> list[mg.Transform]:
    """Simulated poses of the stylus with 0.2 mm and 0.1 degrees of noise."""
    poses = []
    for _ in range(count):
        azimuth, tilt = rng.uniform(0, 2 * math.pi), math.radians(half_angle_deg) * rng.uniform()
        axis = tilt * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        true = mg.Transform.from_rotation_vector(axis, [0, 0, 0], target="tracker", source="stylus")
        position = PIVOT_MM - true.apply(TIP_MM) + rng.normal(0.0, 0.2 / math.sqrt(3), 3)
        noise = rng.normal(0.0, math.radians(0.1) / math.sqrt(3), 3)
        turned = mg.Transform.from_rotation_vector(
            noise, [0, 0, 0], target="stylus", source="stylus"
        )
        poses.append(mg.Transform("tracker", "stylus", true.rotation @ turned.rotation, position))
    return poses


for half_angle_deg in (30.0, 8.0):
    result = mg.calibrate_pivot(swing(half_angle_deg))
    tip = ", ".join(f"{value:.2f}" for value in result.tip_mm)
    error_mm = np.linalg.norm(result.tip_mm - TIP_MM)
    print(f"swing of {math.degrees(result.swing_rad):.0f} degrees: tip at ({tip}) mm")
    print(f"  residual {result.rms_mm:.2f} mm, sigma {result.tip_sigma_mm:.2f} mm")
    print(f"  true error {error_mm:.2f} mm, accepted: {result.accepted}: {result.reason}")
