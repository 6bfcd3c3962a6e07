"""A scripted hand that pushes a tool towards structures and away from them."""

import numpy as np

from app.geometry import NS_PER_S, FloatArray
from app.simulation.state import WorldState, Wrench
from app.simulation.world_hand import HandEntry, Push

FULL_FORCE_MM = 5.0
"""Within this distance of the point that it pushes at, the force falls to 0."""

NEAR_MM = 0.5
"""Nearer to the point that it retreats from, the hand pulls upward: +z of the world."""


class ScriptedHand:
    """The force of the hand on the origin of the tool ``tool``, which is its tip."""

    def __init__(self, entry: HandEntry, tool: str) -> None:
        self._entry = entry
        self.tool = tool

    @property
    def admittance_mm_s_n(self) -> float:
        """Speed of the tool per force in free space, for the controller."""
        return self._entry.free_speed_mm_s / self._entry.force_n

    def wrench(self, state: WorldState) -> Wrench:
        """The hand's wrench on the tool in ``state``; 0 between the pushes."""
        time_s = state.time_ns / NS_PER_S
        if self._entry.period_s is not None:
            time_s %= self._entry.period_s
        push = next((p for p in self._entry.pushes if p.start_s <= time_s < p.end_s), None)
        force: FloatArray = np.zeros(3)
        if push is not None:
            force = self._force(push, state)
        return Wrench(force, np.zeros(3))

    def _force(self, push: Push, state: WorldState) -> FloatArray:
        way = state.bodies[push.towards].translation_mm - state.bodies[self.tool].translation_mm
        distance = float(np.linalg.norm(way))
        if not push.retreat:
            return np.asarray(self._entry.force_n / max(distance, FULL_FORCE_MM) * way)
        if distance < NEAR_MM:
            return np.array([0.0, 0.0, self._entry.force_n])
        return np.asarray(-self._entry.force_n / distance * way)
