"""Run a benchmark as ``marginguard bench`` does."""

import json
import subprocess
from pathlib import Path
from typing import Any

from tests.python_process import run_python
from tests.tiers import PROJECT_ROOT


def run(
    name: str, path: Path, *options: str, timeout_s: float
) -> tuple[subprocess.CompletedProcess[str], list[dict[str, Any]]]:
    """The process, and the rows of the figures that it writes to ``path``."""
    command = ("-m", "app.cli.commands.bench", f"benchmarks.{name}", "--json", path, *options)
    done = run_python(*command, status=None, cwd=PROJECT_ROOT, timeout=timeout_s)
    assert path.exists(), done.stdout + done.stderr
    return done, json.loads(path.read_text())["rows"]
