"""Motion of structures in soft tissue: breathing, and shifts that stay."""

import mujoco
import numpy as np

from app.geometry import FloatArray
from app.simulation.body_model import quaternion_wxyz
from app.simulation.world_entries import BreathingEntry, TissueEntry
from app.synthetic.physiology import Breathing


class TissueMotion:
    """Poses of one structure over time: those of `BreathingBody`, then the shifts.

    Plain arrays and MuJoCo's quaternions: a world asks at every step.
    """

    def __init__(self, entry: TissueEntry, breathing: BreathingEntry) -> None:
        self._entry = entry
        self._breathing = Breathing(breathing.held_until_s, breathing.frequency_hz)
        self._rest = quaternion_wxyz(entry.rest.rotation)
        self._turn_rad = float(np.linalg.norm(entry.breath_turn_rad))
        self._axis = entry.breath_turn_rad / (self._turn_rad or 1.0)

    def at(self, time_s: float) -> tuple[FloatArray, FloatArray]:
        """Position (3,) in mm and quaternion (4,), w first, of the structure in the world."""
        depth = self._breathing.depth(time_s)
        position = self._entry.rest.translation_mm + depth * self._entry.breath_shift_mm
        for each in self._entry.shifts:
            share = (time_s - each.start_s) / (each.end_s - each.start_s)
            share = min(max(share, 0.0), 1.0)
            position = position + (share * share * (3.0 - 2.0 * share)) * each.shift_mm
        turn, quaternion = np.zeros(4), np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, self._axis, depth * self._turn_rad)
        mujoco.mju_mulQuat(quaternion, self._rest, turn)
        return position, quaternion
