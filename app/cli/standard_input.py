"""Standard input for a thread that still waits for it when the process ends."""

import io
import sys


def standard_input() -> io.BufferedReader:
    """A reader of the bytes of standard input; nothing else may read it.

    Python aborts at its end when a thread waits in the reader of ``sys.stdin``, whose lock it
    needs to close it. This reader stays open.
    """
    return io.BufferedReader(io.FileIO(sys.stdin.fileno(), closefd=False))
