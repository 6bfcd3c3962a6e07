"""Run a benchmark as ``marginguard bench`` does."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from tests.tiers import PROJECT_ROOT


def run(
    name: str, path: Path, *options: str, timeout_s: float
) -> tuple[subprocess.CompletedProcess[str], list[dict[str, Any]]]:
    """The process, and the rows of the figures that it writes to ``path``."""
    done = subprocess.run(
        [sys.executable, "-m", "app.cli.commands.bench", f"benchmarks.{name}",
         "--json", str(path), *options],
        cwd=PROJECT_ROOT, capture_output=True, text=True, timeout=timeout_s, check=False,
    )  # fmt: skip
    assert path.exists(), done.stdout + done.stderr
    return done, json.loads(path.read_text())["rows"]
