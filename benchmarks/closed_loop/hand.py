"""A hand that brings a tool beside a structure, pushes at it, slides and pulls back."""

from enum import IntEnum

import numpy as np

from app.geometry import NS_PER_S, FloatArray
from app.simulation import WorldState, Wrench

STOP_MM = 1.0  # ``stop_mm`` of the shipped live.yaml
AWAY_MM = 40.0  # distance from the structure's origin at which a push begins
REACHED_MM = 6.0
SOFT_MM = 5.0  # nearer to its goal the hand's force falls to 0
WAY_S, PUSH_S, SLIDE_S, RETREAT_S = 8.0, 1.5, 0.25, 0.5
MAX_TILT = np.radians(55.0)  # largest angle from +z of the world: what the arm reaches from above


class Phase(IntEnum):
    """Phase of the hand's motion."""

    REST = 0
    WAY = 1
    PUSH = 2
    SLIDE = 3
    RETREAT = 4


class PushingHand:
    """Pushes ``tool`` with ``force_n`` at the origin of ``structure`` from random directions.

    It stays in `Phase.REST` until `begin`. Torques are 0: the tool keeps its direction.
    """

    def __init__(self, tool: str, structure: str, force_n: float, seed: int) -> None:
        self.tool, self._structure, self._force_n = tool, structure, force_n
        self._seed = seed
        self._direction: FloatArray = np.array([0.0, 0.0, 1.0])
        self._since_ns = 0
        self._longest_s: dict[Phase, float] = {}
        self.phase = Phase.REST
        self.reached = False
        """True if the last push began beside the structure, in its direction."""

    def begin(self, time_ns: int, number: int, push_s: float = PUSH_S) -> None:
        """Begin a push of ``push_s`` from the direction that seed and ``number`` give."""
        self._longest_s = {Phase.PUSH: push_s, Phase.SLIDE: SLIDE_S, Phase.RETREAT: RETREAT_S}
        random = np.random.default_rng([self._seed, number])
        tilt = np.arccos(random.uniform(np.cos(MAX_TILT), 1.0))
        turn = random.uniform(-np.pi, np.pi)
        self._direction = np.array(
            [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)]
        )
        self.phase, self._since_ns, self.reached = Phase.WAY, time_ns, False

    def wrench(self, state: WorldState) -> Wrench:
        """The force towards the goal of the present phase."""
        center = state.bodies[self._structure].translation_mm
        tip = state.bodies[self.tool].translation_mm
        self._proceed(state.time_ns, center, tip)
        way = np.zeros(3)
        if self.phase is Phase.WAY:
            way = center + AWAY_MM * self._direction - tip
        elif self.phase is Phase.PUSH:
            way = center - tip
        elif self.phase is Phase.SLIDE:
            across = np.cross(tip - center, np.array([0.6, 0.8, 0.0]))
            way = AWAY_MM * across / max(float(np.linalg.norm(across)), 1e-6)
        elif self.phase is Phase.RETREAT:
            away = tip - center
            way = AWAY_MM * away / max(float(np.linalg.norm(away)), 1e-6)
        scale = self._force_n / max(float(np.linalg.norm(way)), SOFT_MM)
        return Wrench(scale * way, np.zeros(3))

    def _proceed(self, now_ns: int, center: FloatArray, tip: FloatArray) -> None:
        spent_s = (now_ns - self._since_ns) / NS_PER_S
        if self.phase is Phase.WAY:
            goal = center + AWAY_MM * self._direction
            self.reached = float(np.linalg.norm(goal - tip)) < REACHED_MM
            if self.reached:
                self._next(Phase.PUSH, now_ns)
            elif spent_s > WAY_S:
                self._next(Phase.REST, now_ns)
        elif spent_s > self._longest_s.get(self.phase, np.inf):
            self._next(Phase((self.phase + 1) % len(Phase)), now_ns)

    def _next(self, phase: Phase, now_ns: int) -> None:
        self.phase, self._since_ns = phase, now_ns
