"""Limits of the motion of a sensor on a held tool or on a patient."""

import math
from dataclasses import dataclass, fields

from app.geometry import InputError


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Largest speed and acceleration, in mm and rad, at which a pose is still plausible.

    The defaults are those of a swing by hand at 2 Hz with amplitudes of 100 mm and 90 degrees:
    1257 mm/s and 15.8 m/s2, 1131 degrees/s and 14 200 degrees/s2. 98.9 % of the power of voluntary
    movements of surgeons is below 2 Hz (Riviere, Rader and Khosla, "Characteristics of hand motion
    of eye surgeons", 1997). The fastest motion in the public recording of a stylus that is moved
    from landmark to landmark is 683 mm/s, 4.8 m/s2, 639 degrees/s and 6900 degrees/s2. The speed is
    1.6 times that of the swing, because a sensor sits on a lever. A sensor on the patient has the
    same limits: a patient or a phantom is moved by hands. Raises `InputError` for a value that is
    not a finite number above 0.
    """

    speed_mm_s: float = 2_000.0
    acceleration_mm_s2: float = 16_000.0
    speed_rad_s: float = math.radians(1_200.0)
    acceleration_rad_s2: float = math.radians(15_000.0)

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(
                    f"{each.name} of the motion limits is {value}; expected a finite number above 0"
                )
