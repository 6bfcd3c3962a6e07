"""An import loads the compiled kernels that are cached on disk, without running any.

So a process that is forked later has no need to. Parallel ones are left out: with the first of them
numba notes the process in which OpenMP may be used, and ends a forked one that uses it.
"""

import gc

from numba.core.dispatcher import Dispatcher


def load() -> None:
    """Load each kernel of the imported modules that is compiled for this machine."""
    for kernel in [each for each in gc.get_objects() if isinstance(each, Dispatcher)]:
        if not hasattr(kernel._cache, "_cache_file") or kernel.targetoptions.get("parallel"):
            continue
        generator = kernel.targetctx.codegen()
        for key in kernel._cache._cache_file._load_index():
            signature = key[0]
            if key == kernel._cache._index_key(signature, generator):
                kernel.compile(signature)


load()
