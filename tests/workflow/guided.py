"""A guided recording with its fits, the session that uses its results, and motions of a tool."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from app.geometry import NS_PER_MS, Stamp, TrackedTransform, TrackingStatus, Transform
from app.runtime import compute_here
from app.session import KnownEdges

PERIOD_MS = 20


class Guided:
    """A guide of the class ``guide`` and the session that uses its results, in one thread.

    ``fit_of(task)`` computes a fit; ``used(content, command)`` is the content after a command.
    """

    def __init__(
        self,
        guide: Callable[..., Any],
        content: Any,
        fit_of: Callable[[Any], Any],
        used: Callable[[Any, Any], Any],
    ) -> None:
        self.guide, self.content = guide(content, self, lambda: None), content
        self._fit_of, self._used = fit_of, used
        self.uses, self.refuses_later = True, False

    compute = staticmethod(compute_here)

    @property
    def seen(self) -> int:
        return self.guide.status().revision

    def fit(self) -> Any:
        """Compute what is to be computed; return the newest fit."""
        while (task := self.guide.task()) is not None:
            self.guide.use_fit(self._fit_of(task))
        return self.guide.status().fit

    def stop(self) -> Any:
        self.guide.stop(self.seen)
        return self.fit()

    def request(self, command: Any) -> bool:
        """Carry ``command`` out as the session does: its content has the result from then on."""
        if self.uses and not self.refuses_later:
            self.content = self._used(self.content, command)
        return self.uses

    def accept(self) -> None:
        self.guide.accept(self.seen)
        self.guide.use_content(self.content)

    def undo(self) -> None:
        self.guide.undo(self.seen)
        self.guide.use_content(self.content)


def pivot_rotation(number: int, cone_rad: float = 0.6) -> Rotation:
    """Rotation of a tool that swings to all sides about its tip."""
    tilt = cone_rad * (0.6 + 0.4 * np.sin(number / 23.0))
    return Rotation.from_rotvec(tilt * np.array([np.cos(number / 20), np.sin(number / 20), 0.0]))


def spin_rotation(number: int, shaft: np.ndarray) -> Rotation:
    """Rotation of a tool that turns about its shaft."""
    return Rotation.from_rotvec([0.3, 0.2, 0.0]) * Rotation.from_rotvec(number / 40.0 * shaft)


def edges_of(*poses: Transform, at_ms: float) -> KnownEdges:
    stamp = Stamp(int(at_ms * NS_PER_MS))
    return KnownEdges(
        measured={
            (pose.target, pose.source): TrackedTransform(pose, stamp, TrackingStatus.OK)
            for pose in poses
        }
    )


def step_with(edges: KnownEdges, reasons: tuple[Any, ...] = ()) -> Any:
    """Test double of a step: the values that a guided recording reads."""
    return SimpleNamespace(edges=edges, decision=SimpleNamespace(reasons=reasons))
