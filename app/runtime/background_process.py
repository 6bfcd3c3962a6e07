"""Background processes: their priority, and objects in memory that they share (Linux)."""

import mmap
import os
import pickle
import struct
import subprocess
from contextlib import suppress

_NICENESS = 5
"""Low enough for the thread of the constraint to go first, high enough to proceed beside others."""


def step_back() -> None:
    """Let this process give way to others that start with its present priority."""
    os.nice(_NICENESS)


def work_behind(process: "subprocess.Popen[bytes]") -> None:
    """Let the new ``process`` give way to this one."""
    with suppress(ProcessLookupError):  # it has ended: its user reports that
        os.setpriority(os.PRIO_PROCESS, process.pid, os.nice(0) + _NICENESS)


_ALIGNMENT = 64
_COUNT = struct.Struct("<Q")


def write_object(value: object) -> int:
    """Pickle ``value`` into a new memory file; returns its descriptor, which the caller closes.

    Writing the arrays releases the GIL.
    """
    buffers: list[pickle.PickleBuffer] = []
    pickled = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
    parts = [memoryview(pickled), *(buffer.raw() for buffer in buffers)]
    file = os.memfd_create("marginguard", os.MFD_CLOEXEC)
    try:
        offset = 0
        for data in (_COUNT.pack(len(parts)), *(_COUNT.pack(part.nbytes) for part in parts)):
            offset += os.pwrite(file, data, offset)
        for part in parts:
            offset = _aligned(offset)
            done = 0
            while done < part.nbytes:
                done += os.pwrite(file, part[done:], offset + done)
            offset += done
        os.ftruncate(file, max(offset, 1))
    except BaseException:
        os.close(file)
        raise
    return file


def read_object(file: int) -> object:
    """Return the object of `write_object`. Its arrays are views of the file, copied on write.

    Only for a file of a process that this one trusts: unpickling can run code.
    """
    content = memoryview(mmap.mmap(file, 0, access=mmap.ACCESS_COPY))
    count = _COUNT.unpack_from(content)[0]
    sizes = [_COUNT.unpack_from(content, _COUNT.size * (1 + k))[0] for k in range(count)]
    parts, offset = [], _COUNT.size * (1 + count)
    for size in sizes:
        offset = _aligned(offset)
        parts.append(content[offset : offset + size])
        offset += size
    value: object = pickle.loads(parts[0], buffers=parts[1:])
    return value


def _aligned(offset: int) -> int:
    return -(-offset // _ALIGNMENT) * _ALIGNMENT
