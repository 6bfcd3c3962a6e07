"""A Python session of a reader: blocks in one namespace, as in an interactive interpreter."""

import json
import os
import signal
import subprocess
from pathlib import Path

from tests.docs.terminal import TIMEOUT_S

DRIVER = """
import contextlib, io, json, sys, traceback
namespace = {"__name__": "__main__"}
for line in sys.stdin:
    output, failed = io.StringIO(), False
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        try:
            exec(compile(json.loads(line), "<page>", "exec"), namespace)
        except BaseException:
            failed = True
            traceback.print_exc()
    print(json.dumps([output.getvalue(), failed]), flush=True)
"""


class PythonSession:
    """Executes Python blocks in one process."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self.output = ""
        self._process = subprocess.Popen(
            ["python", "-c", DRIVER],
            cwd=folder,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def run(self, code: str) -> None:
        """Execute ``code``; fail with its output if it raises."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(code) + "\n")
        self._process.stdin.flush()
        reply = self._process.stdout.readline()
        assert reply, f"the interpreter ended in:\n{code}"
        self.output, failed = json.loads(reply)
        assert not failed, self.output

    def close(self) -> None:
        """End the process."""
        self._process.communicate(timeout=TIMEOUT_S)
        assert self._process.returncode == 0

    def kill(self) -> None:
        """End the process at once if it runs; for the end of a test that failed."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.communicate()
