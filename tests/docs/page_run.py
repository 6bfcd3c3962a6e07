"""Execute a page as a reader would: every fenced block, in its order."""

import re
import shutil
import sys
import time
import urllib.request
from pathlib import Path

from tests.docs.page_blocks import PageBlock, blocks_of
from tests.docs.python_session import PythonSession
from tests.docs.terminal import TIMEOUT_S, Terminal

INSTALL = """git clone https://github.com/marginguard/marginguard
cd marginguard
make demo
"""
"""The one block that is replaced: the environment of the suite is linked as ``.venv`` instead."""

FOLDERS = ("data", "examples")
"""Folders of the working copy. The code itself is imported from the project: its kernels are
compiled there."""


class PageRun:
    """Runs the blocks of a page in a working copy of its own, with a home of its own."""

    def __init__(self, project: Path, folder: Path, environment: dict[str, str]) -> None:
        self.not_run: list[str] = []
        self._folder = folder
        self._copy = folder / "marginguard"
        (folder / "home").mkdir()
        self._copy.mkdir()
        for name in FOLDERS:
            if (project / name).exists():
                shutil.copytree(project / name, self._copy / name)
        (self._copy / ".venv").symlink_to(sys.prefix)
        self._environment = {
            "HOME": str(folder / "home"),
            "PATH": "/usr/local/bin:/usr/bin:/bin",
            "LANG": "C.UTF-8",
            "PYTHONPATH": str(project),
            "PYTHONUNBUFFERED": "1",  # a terminal shows each line at once
            **environment,
        }
        self._terminals: dict[int, Terminal] = {}
        self._python: PythonSession | None = None
        self._printed = ""

    def run(self, page: Path) -> None:
        """Execute ``page``; an error names the line of its block."""
        try:
            for block in blocks_of(page):
                try:
                    self._run(block)
                except AssertionError as error:
                    raise AssertionError(f"{page.name}:{block.line}: {error}") from error
            for number in sorted(self._terminals, reverse=True):
                self._terminals[number].interrupt()
            if self._python is not None:
                self._python.close()
        finally:
            for terminal in self._terminals.values():
                terminal.kill()
            if self._python is not None:
                self._python.kill()

    def _run(self, block: PageBlock) -> None:
        if "not run" in block.keys:
            assert block.keys["not run"], "a reason is missing; expected 'not run: REASON'"
            self.not_run.append(block.keys["not run"])
        elif "install" in block.keys:
            assert block.text == INSTALL, f"expected the installation:\n{INSTALL}"
        elif "file" in block.keys:
            path = self._copy / block.keys["file"]
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
        elif block.language == "sh":
            self._shell(block)
        elif block.language == "python":
            self._session().run(block.text)
            self._printed = self._session().output
        elif block.language == "text":
            if "ctrl-c" in block.keys:
                self._terminal(int(block.keys["ctrl-c"])).interrupt()
            self._compare(block)
        else:
            raise AssertionError(f"a block of {block.language!r} is neither a file nor not run")

    def _shell(self, block: PageBlock) -> None:
        terminal = self._terminal(block.terminal)
        terminal.start(block.text)
        if "until" in block.keys:
            terminal.wait_for(re.compile(re.escape(block.keys["until"])))
            for url in re.findall(r"^http://\S+$", terminal.output, re.MULTILINE):
                _open_page(url)
            return
        status = terminal.finish()
        deadline = time.monotonic() + TIMEOUT_S
        while "retry" in block.keys and status != 0 and time.monotonic() < deadline:
            terminal.start(block.text)
            status = terminal.finish()
        assert status == int(block.keys.get("status", "0")), f"status {status}:\n{terminal.output}"
        self._printed = terminal.output

    def _compare(self, block: PageBlock) -> None:
        """Require the shown lines in the output, ``...`` for any text or any lines."""
        pattern = shown(block.text)
        if "terminal" in block.keys:
            self._terminal(block.terminal).wait_for(pattern)
        else:
            assert pattern.search(self._printed), (
                f"not printed:\n{block.text}\nbut:\n{self._printed}"
            )

    def _terminal(self, number: int) -> Terminal:
        if number not in self._terminals:
            state = self._folder / f"terminal-{number}"
            self._terminals[number] = Terminal(self._copy, state, self._environment)
        return self._terminals[number]

    def _session(self) -> PythonSession:
        if self._python is None:
            environment = self._terminal(1).environment
            self._python = PythonSession(self._copy, environment)
        return self._python


def _open_page(url: str) -> None:
    """Open a printed URL as a browser does, which keeps the cookie of its access control."""
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    with opener.open(url, timeout=TIMEOUT_S) as page:
        assert page.headers.get_content_type() == "text/html"


def shown(text: str) -> re.Pattern[str]:
    """Pattern of shown lines: ``...`` stands for any text, and as a line for any lines."""
    lines = []
    for line in text.splitlines():
        if line.strip() == "...":
            lines.append(r"(?:.*\n)*?")
        else:
            lines.append(re.escape(line.rstrip()).replace(r"\.\.\.", ".*") + r" *\n")
    return re.compile("^" + "".join(lines), re.MULTILINE)
