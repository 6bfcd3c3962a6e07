"""Runs Python in a process of its own."""

import subprocess
import sys
from typing import Any


def run_python(
    *words: object, status: int | None = 0, **settings: Any
) -> subprocess.CompletedProcess[str]:
    """Run ``python WORD...``, which has to end with ``status``; None allows any."""
    command = [sys.executable, *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, **settings)
    assert status in (None, done.returncode), done.stdout + done.stderr
    return done
