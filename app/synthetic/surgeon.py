"""Options of the simulated surgeon: skill, and a virtual fixture that stops the tool.

The effects of skill are assumptions without a public source. They are linear in it, and named here:
an expert (1) enters the tumour less often and less deeply, works faster and more evenly.
"""

from dataclasses import dataclass

import numpy as np

from app.geometry import InputError

SKILL_RANGE = (0.0, 1.0)

_ENTRIES_SPARED = 0.8
"""Share of the planned entries into the tumour that an expert does not make."""
_DEEPER = 0.6
_SLOWER = 0.5
_WANDER_DEG = 8.0
_WANDER_MM = 3.0
"""Excess of a novice: entries deeper by up to this share, strokes longer by this share, and poses
of a stroke off by up to this angle around the tumour and this distance away from it."""


@dataclass(frozen=True, slots=True)
class SurgeonOptions:
    """Skill from 0 (novice) to 1 (expert), and whether an ideal fixture stops the tool.

    Without a skill every case has its three entries, at the usual pace. With ``fixture`` the tool
    stops before the tumour where it would enter it: at 1 mm and the bound of the margin's error.
    """

    skill: float | None = None
    fixture: bool = False

    def __post_init__(self) -> None:
        low, high = SKILL_RANGE
        if self.skill is not None and not low <= self.skill <= high:
            raise InputError(f"skill is {self.skill:g}; expected {low:g} to {high:g}")

    @property
    def pace(self) -> float:
        """Duration of the strokes over the usual one."""
        return 1.0 + _SLOWER * self._lack

    def enters(self, random: np.random.Generator) -> bool:
        """True if a planned entry happens."""
        return self.skill is None or bool(random.random() >= _ENTRIES_SPARED * self.skill)

    def depth_factor(self, random: np.random.Generator) -> float:
        """Depth of an entry over the usual one."""
        return 1.0 if self.skill is None else float(random.uniform(1.0, 1.0 + _DEEPER * self._lack))

    def wander(self, random: np.random.Generator) -> tuple[float, float]:
        """Error of a pose of a stroke: in degrees around the tumour, in mm away from it."""
        if self.skill is None:
            return 0.0, 0.0
        degrees = float(random.uniform(-1.0, 1.0)) * _WANDER_DEG * self._lack
        return degrees, float(random.random()) * _WANDER_MM * self._lack

    @property
    def _lack(self) -> float:
        return 0.0 if self.skill is None else 1.0 - self.skill


USUAL_SURGEON = SurgeonOptions()
