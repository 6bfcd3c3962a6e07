"""The force with which an operator's mouse pulls a tool: a spring that lasts while it is held."""

import threading
from collections.abc import Callable

import numpy as np

from app.fixture import MarginState
from app.geometry import NS_PER_MS, NS_PER_S, FloatArray
from app.viewer.steps.view_state import ViewState

STIFFNESS_N_MM = 0.5
"""Force of the spring for each mm between the tip and the point that it is pulled to."""
MAX_FORCE_N = 10.0
MAX_RISE_N_S = 100.0
"""The force rises at most as fast; it falls to 0 at once."""
MAX_SILENCE_NS = 500 * NS_PER_MS
"""A page sends requests all the time, five in a second at least: one that does not has let go."""


class MouseHand:
    """The hand of the one page that holds the tool. Thread-safe.

    ``clock_ns`` is a steady clock. A page holds the tool from `hold` to `release`, or until it has
    been silent for `MAX_SILENCE_NS`; another one cannot take it meanwhile.
    """

    def __init__(self, clock_ns: Callable[[], int]) -> None:
        self._clock_ns = clock_ns
        self._lock = threading.Lock()
        self._page: str | None = None
        self._heard_ns = 0
        self._target_mm: FloatArray = np.zeros(3)
        self._force_n: FloatArray = np.zeros(3)
        self._computed_ns = 0

    def hold(self, page: str, target_mm: FloatArray) -> bool:
        """Let ``page`` pull the tip to ``target_mm`` (3,) in the tumour's frame.

        False, and no change, while another page holds the tool or if the point is not finite.
        """
        with self._lock:
            self._expire()
            if self._page not in (None, page) or not np.isfinite(target_mm).all():
                return False
            if self._page is None:
                self._force_n, self._computed_ns = np.zeros(3), self._clock_ns()
            self._page, self._heard_ns = page, self._clock_ns()
            self._target_mm = np.array(target_mm, dtype=np.float64)
            return True

    def heard(self, page: str) -> None:
        """Record that ``page`` is alive."""
        with self._lock:
            self._expire()
            if page == self._page:
                self._heard_ns = self._clock_ns()

    def release(self, page: str) -> None:
        """Let go of the tool, if ``page`` holds it."""
        with self._lock:
            if page == self._page:
                self._let_go()

    def holder(self) -> str | None:
        """The page that holds the tool."""
        with self._lock:
            self._expire()
            return self._page

    def target_mm(self) -> FloatArray | None:
        """The point (3,) in the tumour's frame that the tip is pulled to; None if it is not."""
        with self._lock:
            self._expire()
            return None if self._page is None else self._target_mm.copy()

    def last_force_n(self) -> float:
        """Size in N of the last result of `force_n`, 0 after a release."""
        with self._lock:
            self._expire()
            return float(np.linalg.norm(self._force_n))

    def force_n(self, shown: ViewState | None) -> FloatArray:
        """The force (3,) in N on the tip in ``shown``, the present, along the tool's axes.

        0 unless a page holds the tool and the session knows where it is.
        """
        with self._lock:
            self._expire()
            now_ns, before_ns = self._clock_ns(), self._computed_ns
            self._computed_ns = now_ns
            pose = None if shown is None else shown.step.tumor_from_tip
            is_known = shown is not None and shown.step.decision.state is not MarginState.UNKNOWN
            if self._page is None or pose is None or not is_known:
                self._force_n = np.zeros(3)
                return self._force_n.copy()
            pull = STIFFNESS_N_MM * (self._target_mm - pose.translation_mm)
            rise_n = MAX_RISE_N_S * max(now_ns - before_ns, 0) / NS_PER_S
            limit_n = min(MAX_FORCE_N, float(np.linalg.norm(self._force_n)) + rise_n)
            size_n = float(np.linalg.norm(pull))
            if size_n > limit_n:
                pull = pull * (limit_n / size_n)
            self._force_n = pose.rotation.T @ pull
            return self._force_n.copy()

    def _expire(self) -> None:
        if self._page is not None and self._clock_ns() - self._heard_ns > MAX_SILENCE_NS:
            self._let_go()

    def _let_go(self) -> None:
        self._page, self._force_n = None, np.zeros(3)
