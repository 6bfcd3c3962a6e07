"""Quick loading of functions that numba has compiled and cached on disk."""

from collections.abc import Callable
from typing import Any, TypeVar

_Dispatcher = TypeVar("_Dispatcher")


def load_without_declarations(runtime: Any) -> Callable[[_Dispatcher], _Dispatcher]:
    """Let a function compiled with ``cache=True`` load without declaring all that numba compiles.

    numba declares every function that it can compile before it looks into the cache, which takes
    0.06 s of every program. Only a compilation needs them, and declares them itself; a compiled
    function needs the ``runtime`` alone, numba's ``rtsys``.
    """

    def changed(dispatcher: _Dispatcher) -> _Dispatcher:
        if not hasattr(dispatcher, "_cache"):
            return dispatcher  # NUMBA_DISABLE_JIT=1: the function stays plain Python
        cache: Any = dispatcher._cache

        def load_overload(signature: object, context: object) -> object:
            runtime.initialize(context)
            return cache._load_overload(signature, context)

        cache.load_overload = load_overload
        return dispatcher

    return changed
