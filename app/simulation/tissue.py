"""Motion of structures in soft tissue: breathing, and shifts that stay."""

import numpy as np

from app.geometry import FloatArray, Transform
from app.simulation.world_entries import BreathingEntry, TissueEntry
from app.synthetic.physiology import Breathing, BreathingBody


class TissueMotion:
    """Poses of one structure over time."""

    def __init__(self, entry: TissueEntry, breathing: BreathingEntry) -> None:
        self._entry = entry
        self._breathing = Breathing(breathing.held_until_s, breathing.frequency_hz)
        self._body = BreathingBody(entry.rest, entry.breath_shift_mm, entry.breath_turn_rad)

    def at(self, time_s: float) -> Transform:
        """``world_from_structure`` at a time."""
        pose = self._body.at(self._breathing.depth(time_s))
        shift: FloatArray = np.zeros(3)
        for each in self._entry.shifts:
            share = np.clip((time_s - each.start_s) / (each.end_s - each.start_s), 0.0, 1.0)
            shift = shift + (share * share * (3.0 - 2.0 * share)) * each.shift_mm
        return Transform(pose.target, pose.source, pose.rotation, pose.translation_mm + shift)
