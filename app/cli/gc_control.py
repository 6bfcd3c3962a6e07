"""Freeze long-lived objects so that the garbage collector does not scan them."""

import gc
from types import TracebackType
from typing import Self

_THRESHOLD = 50_000
"""New objects between two collections. Each block of frames that is read ahead
(`app.case.frame_streams.read_ahead`) allocates a thousand and soon frees them."""


class GcPause:
    """Within the context collection is off until `settle`, and then covers newer objects only.

    Loading allocates a million objects, nearly all of which stay until the end.
    """

    def __enter__(self) -> Self:
        self._enabled, self._thresholds = gc.isenabled(), gc.get_threshold()
        gc.disable()
        return self

    def settle(self) -> None:
        """Freeze all present objects until the end of the context; call it when all is loaded."""
        gc.freeze()
        gc.set_threshold(_THRESHOLD, *self._thresholds[1:])
        self._restore_enabled()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        gc.unfreeze()
        gc.set_threshold(*self._thresholds)
        self._restore_enabled()

    def _restore_enabled(self) -> None:
        if self._enabled:
            gc.enable()
