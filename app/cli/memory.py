"""What a command loads stays to its end: it is not looked through for cycles again and again."""

import gc
from types import TracebackType
from typing import Self


class LongLived:
    """Within the context no cycles are looked for until `settle`, and then among what is newer.

    Loading makes a million objects, nearly all of which stay.
    """

    def __enter__(self) -> Self:
        self._enabled = gc.isenabled()
        gc.disable()
        return self

    def settle(self) -> None:
        """All is loaded: what there is now is left alone up to the context's end."""
        gc.freeze()
        self._let_search()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        gc.unfreeze()
        self._let_search()

    def _let_search(self) -> None:
        if self._enabled:
            gc.enable()
