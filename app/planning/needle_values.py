"""A needle, the structures that it must not touch, and planned corridors."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray, InputError, SurfaceMesh
from app.planning.needle_places import EntryRegion

MAX_ANGLE_RAD = math.radians(60.0)
"""Largest angle between needle and normal of the skin: a flatter needle slides along the skin."""

FREE_MM = 10.0
"""Distance beyond the required one that is not better any more."""

WEIGHTS = {"distance": 0.5, "angle": 0.2, "depth": 0.15, "centrality": 0.15}
"""Weight of each rating in the score."""


@dataclass(frozen=True, slots=True)
class Needle:
    """A needle of ``diameter_mm``, whose ``length_mm`` can be inserted.

    ``bend_mm`` is the allowance for bending: the largest lateral deviation of the tip at full
    length. A tip with a bevel bends a needle to an arc of constant curvature (Webster et al. 2006,
    Int. J. Robotics Research 25, 509), so that the deviation at depth ``s`` is
    ``bend_mm (s / length_mm)^2``. The whole needle is widened by that of its tip, although it
    deviates less near the skin. Raises `InputError` for a length or diameter that is not positive
    and for a negative allowance.
    """

    length_mm: float
    diameter_mm: float
    bend_mm: float

    def __post_init__(self) -> None:
        for name in ("length_mm", "diameter_mm"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise InputError(f"needle: {name} is {getattr(self, name)}; expected more than 0")
        if not (math.isfinite(self.bend_mm) and self.bend_mm >= 0.0):
            raise InputError(f"needle: bend_mm is {self.bend_mm}; expected 0 or more")

    def radius_at(self, depth_mm: FloatArray) -> FloatArray:
        """Radius of the needle with its allowance, (n,), inserted to ``depth_mm`` (n,)."""
        return 0.5 * self.diameter_mm + self.bend_mm * (depth_mm / self.length_mm) ** 2


@dataclass(frozen=True, slots=True, eq=False)
class ForbiddenStructure:
    """A structure that the needle stays away from by ``stop_mm``.

    ``sigma_mm`` is the standard deviation of its surface along the normal. Raises `InputError` for
    a negative number or one that is not finite.
    """

    name: str
    surface: SurfaceMesh
    stop_mm: float
    sigma_mm: float

    def __post_init__(self) -> None:
        for what, value in (("stop_mm", self.stop_mm), ("sigma_mm", self.sigma_mm)):
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"{self.name}: {what} is {value}; expected 0 mm or more")


class StructureDistance(NamedTuple):
    """Distance of the widened needle to a structure, beside the required one, and its risk."""

    name: str
    clearance_mm: float
    required_mm: float
    hit_probability: float


@dataclass(frozen=True, slots=True, eq=False)
class Corridor:
    """An allowed corridor; ``ratings`` from 0 to 1 by the names of `WEIGHTS`.

    ``joints`` are the robot's positions on the way, empty without a robot.
    """

    entry_mm: FloatArray
    target_mm: FloatArray
    depth_mm: float
    angle_rad: float
    score: float
    ratings: Mapping[str, float]
    structures: tuple[StructureDistance, ...]
    joints: tuple[Mapping[str, float], ...] = ()

    @property
    def reasons(self) -> tuple[str, ...]:
        """One line for each rating and structure."""
        lines = [f"{name} rated {value:.2f}" for name, value in self.ratings.items()]
        lines += [
            f"{each.name}: {each.clearance_mm:.1f} mm away, {each.required_mm:.1f} mm required, "
            f"hit with probability {each.hit_probability:.3f}"
            for each in self.structures
        ]
        if self.joints:
            lines.append(f"the robot reaches all {len(self.joints)} steps")
        return tuple(lines)


@dataclass(frozen=True, slots=True, eq=False)
class NeedlePlan:
    """Allowed corridors, the best one first, and the map of all entries.

    ``scores`` (n,) is that of the best target point of each entry, NaN where none is allowed.
    ``blocked`` (n,) is for these the number in ``obstacles`` of what blocks the corridor to the
    first target point: of several structures the one whose distance falls short by the most. It is
    -1 where a corridor is allowed.
    """

    region: EntryRegion
    corridors: tuple[Corridor, ...]
    scores: FloatArray
    blocked: NDArray[np.int64]
    obstacles: tuple[str, ...]

    @property
    def best(self) -> Corridor:
        """The corridor with the highest score."""
        return self.corridors[0]

    def blocked_by(self) -> dict[str, int]:
        """Number of entries that each obstacle blocks, the largest first."""
        counts = np.bincount(self.blocked[self.blocked >= 0], minlength=len(self.obstacles))
        found = {name: int(n) for name, n in zip(self.obstacles, counts, strict=True) if n}
        return dict(sorted(found.items(), key=lambda item: -item[1]))

    def as_document(self) -> dict[str, Any]:
        """The corridors, and the numbers of entries, as JSON types."""
        return {
            "corridors": [
                {
                    "entry_mm": each.entry_mm.tolist(),
                    "target_mm": each.target_mm.tolist(),
                    "depth_mm": each.depth_mm,
                    "angle_deg": math.degrees(each.angle_rad),
                    "score": each.score,
                    "ratings": dict(each.ratings),
                    "structures": [found._asdict() for found in each.structures],
                    "joints": [dict(joints) for joints in each.joints],
                    "reasons": list(each.reasons),
                }
                for each in self.corridors
            ],
            "entries": {
                "count": len(self.scores),
                "allowed": int((self.scores >= 0.0).sum()),
                "blocked_by": self.blocked_by(),
            },
        }
