"""The displayed values of the panel: the logic computes them, the widgets show them."""

from dataclasses import dataclass

from app.fixture import MarginState
from app.runtime import ShownItem
from app.session import ShownState
from app.workflow import Coverage, GuidedShown

from .contour import ContourShown
from .plans import PlansShown
from .ultrasound import UltrasoundShown


@dataclass(frozen=True, slots=True)
class PanelStatus:
    """``position_s`` is None without a case; ``message`` is the last line about an error or a job,
    ``request`` the last request to change the session, from any interface. ``reasons`` has a line
    for each cause of a hold below those of the state.

    ``banner``: state, reason and distance as the scene shows them, and a hold; ``shown`` is the
    worse of both, whose colour and symbol the banner has. ``trackers``: one line for each
    transform. ``recording``: the last recording of the live session, empty before one.
    ``workflow``: one line for each step of the case, with what it has and why it is not done.
    ``directions``: of the tip to the stop margin, in mm. ``activation``: in words, empty where
    no source tells it.
    ``calibration`` with its ``coverage``, and ``touch``: the guided calibration, and registration
    by touch; without a ``phase`` where there is no session for it.
    ``items``: the display items, ``tools``: the tools with a tip. ``structures``: names of those
    beside the tumour, and whether each is guarded. ``plans``: those of files, and an executed one.
    """

    state: MarginState
    shown: ShownState
    banner: str
    reasons: str
    trackers: str
    session: str
    registration: str
    message: str
    request: str
    position_s: float | None
    duration_s: float
    is_live: bool
    has_session: bool
    is_playing: bool
    can_accept: bool
    recording: str
    is_recording: bool
    workflow: str
    directions: str
    activation: str
    calibration: GuidedShown
    coverage: Coverage | None
    touch: GuidedShown
    contour: ContourShown
    items: tuple[ShownItem, ...]
    ultrasound: UltrasoundShown
    tools: tuple[str, ...]
    structures: tuple[tuple[str, bool], ...]
    plans: PlansShown


REPEAT_NS = 1_000_000_000
"""Time between two sounds of one breach."""


class Alarm:
    """Due at once when a breach begins, and every `REPEAT_NS` while it lasts; never while muted."""

    def __init__(self) -> None:
        self.muted = False
        self._last_ns: int | None = None

    def due(self, state: MarginState, now_ns: int) -> bool:
        """Return True if the alarm has to sound now; ``now_ns`` is of a steady clock."""
        if state is not MarginState.POSITIVE:
            self._last_ns = None
            return False
        if self.muted or (self._last_ns is not None and now_ns - self._last_ns < REPEAT_NS):
            return False
        self._last_ns = now_ns
        return True
