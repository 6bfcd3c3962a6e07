"""What a command loads stays to its end: it is not looked through for cycles again and again."""

import gc
from types import TracebackType
from typing import Self

_NEWER = 50_000
"""So many objects more than before are worth a search. Each block of frames that is read ahead
(`app.case.frames.read_ahead`) is a thousand, which are soon given back."""


class GcPause:
    """Within the context no cycles are looked for until `settle`, and then among what is newer.

    Loading makes a million objects, nearly all of which stay.
    """

    def __enter__(self) -> Self:
        self._enabled, self._thresholds = gc.isenabled(), gc.get_threshold()
        gc.disable()
        return self

    def settle(self) -> None:
        """All is loaded: what there is now is left alone up to the context's end."""
        gc.freeze()
        gc.set_threshold(_NEWER, *self._thresholds[1:])
        self._let_search()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        gc.unfreeze()
        gc.set_threshold(*self._thresholds)
        self._let_search()

    def _let_search(self) -> None:
        if self._enabled:
            gc.enable()
