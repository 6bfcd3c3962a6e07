"""A structure that a session guards: a target or a forbidden one, with its shape and margins."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple, Protocol, TypeVar

from app.fixture import FixtureDecision, MarginParameters, Proximity, SweptProximity
from app.geometry import InputError, Stamp, Transform
from app.session.path_depth import PathDepth


class Role(StrEnum):
    """A ``TARGET`` is to be removed with a margin around it, a ``FORBIDDEN`` one not touched.

    Both are kept out of in the same way; they are named and coloured differently.
    """

    TARGET = "target"
    FORBIDDEN = "forbidden"


def role_of(text: str) -> Role:
    """The role that ``text`` names. Raises `InputError` for another text."""
    if text not in list(Role):
        raise InputError(f"role: is {text[:40]!r}; expected one of {', '.join(Role)}")
    return Role(text)


class ProximityModel(Protocol):
    """Measures the distance of a tool from a structure: the whole mesh, or its tip alone.

    No part of the tool is further than ``radius_mm`` from its origin.
    """

    radius_mm: float

    @property
    def frames(self) -> tuple[str, str | None]:
        """Frames of the structure and the tool; None for a tool that is valid in any frame."""

    def evaluate(self, tumor_from_tool: Transform, stamp: Stamp | None = None) -> Proximity:
        """Signed distance in mm of the tool at this pose, negative inside the structure."""

    def sweep(
        self, previous: Transform, current: Transform, stamp: Stamp | None = None
    ) -> SweptProximity:
        """Lowest signed distance in mm on the path from one pose to the next."""

    def add_free_motion(self, proximity: Proximity, tumor_from_tool: Transform) -> Proximity:
        """``proximity``, which is that of the pose, with its free motion."""


@dataclass(frozen=True, slots=True, eq=False)
class Structure:
    """A structure in the tracked frame that it moves with.

    ``frame_from_structure``: its pose there; the source is its name. ``proximity``: distance model
    of the tool and the structure. ``stop_mm`` and ``warn_mm`` replace those of the session's
    margins, which give the rest. ``sigma_mm``: standard deviation of its surface along the normal,
    0 where it is not stated. ``change``: how it differs from the one that it replaces, for the
    operator.
    """

    frame_from_structure: Transform
    proximity: ProximityModel
    stop_mm: float
    warn_mm: float
    sigma_mm: float = 0.0
    role: Role = Role.FORBIDDEN
    change: str = ""

    @property
    def name(self) -> str:
        """Its name, which is that of the frame of its shape."""
        return self.frame_from_structure.source

    def margins(self, of_session: MarginParameters) -> MarginParameters:
        """Its margins in a session with the margins ``of_session``."""
        return of_session.replaced(stop_mm=self.stop_mm, warn_mm=self.warn_mm)

    def at_least(self, before: "Structure") -> "Structure":
        """The structure with the distances of ``before`` where those are larger."""
        stop_mm, warn_mm = max(self.stop_mm, before.stop_mm), max(self.warn_mm, before.warn_mm)
        if (stop_mm, warn_mm) == (self.stop_mm, self.warn_mm):
            return self
        return replace(self, stop_mm=stop_mm, warn_mm=warn_mm)


class StructureStep(NamedTuple):
    """One structure at one step, decided by its own margins, without the session's hold.

    ``structure_from_tip`` is None while its frame or the tool's is not known; ``between_frames`` as
    in `StepResult`. All vectors of ``decision`` are in the structure's frame ``name``. A far
    structure was not measured (`app.session.far_structures`): the tool is at least ``at_least_mm``
    away, the state is NEGATIVE, and its decision has no distance, margin and planes.
    """

    name: str
    role: Role
    decision: FixtureDecision
    structure_from_tip: Transform | None
    between_frames: PathDepth | None
    at_least_mm: float | None = None


class Named(Protocol):
    """A structure, in whichever form."""

    @property
    def name(self) -> str:
        """Its name."""


_Named = TypeVar("_Named", bound=Named)


def with_named(structures: Iterable[_Named], new: _Named) -> tuple[_Named, ...]:
    """``structures`` with ``new`` for the one of its name, or as the last one."""
    found = {each.name: each for each in structures}
    return tuple((found | {new.name: new}).values())


def governing_number(steps: Sequence[StructureStep]) -> int:
    """The number of the governing one of ``steps``, at least one: never a far structure."""
    near = (number for number, each in enumerate(steps) if each.at_least_mm is None)
    return min(near, key=lambda number: _rank(steps[number].decision))


def _rank(decision: FixtureDecision) -> tuple[int, float]:
    """The smallest governs: by the worst state, then by the smallest clearance."""
    if decision.proximity is None or decision.margin is None:
        return -decision.state, -math.inf
    return -decision.state, decision.proximity.lower_bound_mm - decision.margin.total_mm
