"""A recorded case, played at its pace: the steps of a replay."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from app.bridge.control import SessionChanges
from app.bridge.publishing.prepared_shapes import PreparedShapes
from app.bridge.publishing.replay_scene import ReplayScene, scene_of
from app.case import Case, Player, open_case
from app.geometry import NS_PER_S, InputError
from app.session import (
    Session,
    SessionSetup,
    StepResult,
    setup_from_case,
    with_estimated_clock,
    with_repaired_tumor,
)


@dataclass(frozen=True, slots=True, eq=False)
class OpenedCase:
    """A case that can be played: what its session begins with, and how long it lasts."""

    case: Case
    setup: SessionSetup
    scene: ReplayScene
    first_ns: int
    duration_s: float


def open_recorded(folder: Path) -> OpenedCase:
    """Open and register the case; takes seconds. Raises `InputError` for what cannot be played."""
    case, _ = with_estimated_clock(with_repaired_tumor(open_case(folder)))
    setup = setup_from_case(case)
    stamps = [frame.stamp.ns for frame in case.frames()]
    if not stamps:
        raise InputError(f"the recording of {folder} has no frame")
    return OpenedCase(
        case,
        setup,
        scene_of(case, setup, tip_only=False),
        stamps[0],
        (stamps[-1] - stamps[0]) / NS_PER_S,
    )


class ReplaySteps:
    """Plays ``opened`` from ``start_s`` on with a session that knows nothing of what came before.

    A seek therefore is a replay of its own: a clock that jumps would be a fault, and stay latched.
    ``setup`` and ``scene``: as opened, or as they were changed since. While it is ``paused`` the
    recording's present stands still, and nothing becomes stale.
    """

    def __init__(
        self,
        opened: OpenedCase,
        setup: SessionSetup,
        scene: ReplayScene,
        *,
        start_s: float,
        rate: float,
        paused: bool,
    ) -> None:
        self._session = Session(setup)
        self._stepping = threading.Lock()
        self._rate = rate
        self.changes = SessionChanges(self.between_steps, self, scene)
        self.player = Player(opened.case.frames, clock_ns=time.monotonic_ns, rate=rate)
        if paused:
            self.player.pause()
        self.player.seek(start_s)

    def steps(self) -> Iterator[StepResult]:
        """A step a frame, each when it is due."""
        for frame in self.player.play():
            with self._stepping:
                yield self._session.step(frame)

    def halt(self) -> None:
        """End the replay."""
        self.player.stop()

    @contextmanager
    def between_steps(self) -> Iterator[Session]:
        """The session, while no step is taken."""
        with self._stepping:
            yield self._session

    def set_margins(self, stop_mm: float, warn_mm: float) -> None:
        """Use these from the next frame on; `MarginParameterError` for what cannot be."""
        margins = self.changes.setup.margins
        self.changes.set_margins(margins.replaced(stop_mm=stop_mm, warn_mm=warn_mm))

    def pace(self) -> float:
        """The recording's time stands still while it is paused; faster than a clock is no lag."""
        return 0.0 if self.player.paused else min(self._rate, 1.0)

    def set_rate(self, rate: float) -> None:
        """Recording seconds a second; raises `InputError` out of range."""
        self.player.set_rate(rate)
        self._rate = rate

    def use(self, scene: ReplayScene, shapes: PreparedShapes | None = None) -> None:
        """Nobody else hears of a replay in Slicer; the scene asks `changes` itself."""
