"""Quick loading, and saving in a safe order, of functions that numba has compiled."""

import hashlib
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

_Dispatcher = TypeVar("_Dispatcher")


def load_without_declarations(runtime: Any) -> Callable[[_Dispatcher], _Dispatcher]:
    """Let a function compiled with ``cache=True`` load without declaring all that numba compiles.

    numba declares every function that it can compile before it looks into the cache, which takes
    0.06 s of every program. Only a compilation needs them, and declares them itself; a compiled
    function needs the ``runtime`` alone, numba's ``rtsys``. It is saved by `_save`.
    """

    def changed(dispatcher: _Dispatcher) -> _Dispatcher:
        if not hasattr(dispatcher, "_cache"):
            return dispatcher  # NUMBA_DISABLE_JIT=1: the function stays plain Python
        cache: Any = dispatcher._cache

        def load_overload(signature: object, context: object) -> object:
            runtime.initialize(context)
            return cache._load_overload(signature, context)

        cache.load_overload = load_overload
        cache._cache_file.save = partial(_save, cache._cache_file)
        return dispatcher

    return changed


def _save(cache_file: Any, key: object, compiled_function: object) -> None:
    """Write the compiled function first and its index entry after it.

    numba writes the index first. If a program is killed between the two, the next one finds the
    data file of earlier sources under the new entry and loads it without a warning.
    """
    if not cache_file._load_index():
        cache_file.flush()  # remove the index entries of other sources
    number = int.from_bytes(hashlib.sha256(repr(key).encode()).digest()[:4])
    name = cache_file._data_name(number)
    cache_file._save_data(name, compiled_function)
    cache_file._save_index({**cache_file._load_index(), key: name})
