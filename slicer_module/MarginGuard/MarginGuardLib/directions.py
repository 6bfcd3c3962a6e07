"""Distances of the tip to the stop margin in the six anatomical directions, as a text."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from app.geometry import MarginGuardError, SurfaceMesh
from app.runtime import Compute, SessionContent
from app.session import StepResult
from app.workflow import TipDirections, stop_surface

_PAIRS = ("RL", "AP", "SI")


class PanelDirections:
    """Computes the surface at the stop margin in the background. Call it in the scene's thread.

    ``changed()`` is called in another thread when it is done.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._directions = TipDirections()
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="stop surface")
        self._of: tuple[SurfaceMesh, float] | None = None
        self._computing: Future[SurfaceMesh | None] | None = None
        self._shown: StepResult | None = None
        self._text = ""

    def text(self, step: StepResult, content: SessionContent, compute: Compute) -> str:
        """The distances at ``step`` in mm; empty while they are not known."""
        stop_mm = content.margins.stop_mm
        if self._of is None or self._of[0] is not content.tumor or self._of[1] != stop_mm:
            self._of, self._shown = (content.tumor, stop_mm), None
            self._computing = self._worker.submit(compute, stop_surface, content)
            self._computing.add_done_callback(lambda _: self._changed())
        if self._computing is None or not self._computing.done():
            return ""
        if step is not self._shown:
            self._shown = step
            found = self._directions.at(step, content, _result(self._computing))
            lines = ("   ".join(f"{letter} {_mm(found[letter])}" for letter in p) for p in _PAIRS)
            self._text = "\n".join(lines) if found else ""
        return self._text

    def close(self) -> None:
        """End the thread."""
        self._worker.shutdown(wait=False, cancel_futures=True)


def _result(computing: "Future[SurfaceMesh | None]") -> SurfaceMesh | None:
    try:
        return computing.result()
    except MarginGuardError:
        return None  # a surface that cannot be dilated: the margin itself is not affected


def _mm(distance_mm: float | None) -> str:
    return "\N{EN DASH}" if distance_mm is None else f"{distance_mm:.1f}"
