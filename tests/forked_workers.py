"""Tests in parallel processes that are forked after the collection: ``--workers N``.

A worker of pytest-xdist is a new interpreter that imports and collects all tests, which takes 17 s
of computing each time; a forked worker has them. A worker runs whole scopes, which are consecutive
tests. It asks for a scope before it runs the last test of the one before: pytest has to know the
next test to keep the fixtures that both use.
"""

import ctypes
import os
import signal
import threading
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from multiprocessing.connection import Connection, Pipe, wait
from pathlib import Path
from typing import Any

import pytest
from _pytest.junitxml import xml_key

from tests.forking import PR_SET_PDEATHSIG, fork


@dataclass(eq=False)
class Worker:
    """A forked process, as the first process sees it."""

    pid: int
    running: str | None = None
    """Node id of its test."""


@dataclass(eq=False)
class ForkedWorkers:
    """Plugin that runs the items in ``count`` workers; ``sizes`` are the lengths of the scopes."""

    count: int
    sizes: Sequence[int]

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool | None:
        """Run the tests; a worker returns from here, too, and ends as pytest does."""
        if session.testsfailed or session.config.option.collectonly:
            return None
        if (threads := threading.enumerate())[1:]:
            raise pytest.UsageError(
                f"the imports of tests have started {threads}: a fork loses them"
            )
        base = session.config._tmp_path_factory.getbasetemp()  # type: ignore[attr-defined]
        workers: dict[Connection, Worker] = {}
        for number in range(min(self.count, len(self.sizes))):
            ours, theirs = Pipe()
            if (pid := fork()) == 0:
                for each in (ours, *workers):
                    each.close()
                session.config._tmp_path_factory._basetemp = base / f"gw{number}"  # type: ignore[attr-defined]
                (base / f"gw{number}").mkdir(mode=0o700)
                return _work(session, theirs, f"gw{number}")
            theirs.close()
            workers[ours] = Worker(pid)
        self._serve(session, workers)
        return True

    def _serve(self, session: pytest.Session, workers: dict[Connection, Worker]) -> None:
        # A line for each file, as for tests in sequence, would be a line for each test.
        session.config.pluginmanager.getplugin("terminalreporter").showfspath = False
        scopes, ended = pairwise(accumulate(self.sizes, initial=0)), 0
        while workers:
            for connection in wait(list(workers)):
                worker = workers[connection]
                try:
                    message = connection.recv()
                except EOFError:
                    del workers[connection]
                    _, status = os.waitpid(worker.pid, 0)
                    code = os.waitstatus_to_exitcode(status)
                    if worker.running is not None or code not in (0, bool(session.testsfailed)):
                        session.shouldfail = f"worker ended with status {code} in {worker.running}"
                    continue
                if message is None:
                    stopped = session.shouldfail or session.shouldstop
                    connection.send(None if stopped else next(scopes, None))
                else:
                    self._report(session.config, worker, *message)
                    ended += message[0] == "end"
        if not session.shouldstop and ended < len(session.items):
            session.shouldfail = session.shouldfail or f"{ended} of {len(session.items)} tests ran"
        if session.shouldfail:
            raise session.Failed(session.shouldfail)

    @staticmethod
    def _report(config: pytest.Config, worker: Worker, kind: str, data: Any) -> None:
        if kind in ("start", "end"):
            worker.running = data
        elif kind == "warning":
            text, name, line, when, nodeid = data
            message = warnings.WarningMessage(UserWarning(text), UserWarning, name, line)
            given = {"warning_message": message, "when": when, "nodeid": nodeid, "location": None}
            config.hook.pytest_warning_recorded.call_historic(kwargs=given)
        else:
            report = config.hook.pytest_report_from_serializable(config=config, data=data)
            config.hook.pytest_runtest_logreport(report=report)


@dataclass(eq=False)
class _Reports:
    """Plugin of a worker that sends what pytest reports to the first process."""

    config: pytest.Config
    first: Connection

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        data = self.config.hook.pytest_report_to_serializable(config=self.config, report=report)
        self.first.send(("report", data))

    def pytest_warning_recorded(
        self, warning_message: warnings.WarningMessage, when: str, nodeid: str
    ) -> None:
        text = f"{warning_message.category.__name__}: {warning_message.message}"
        place = (warning_message.filename, warning_message.lineno)
        self.first.send(("warning", (text, *place, when, nodeid)))


def _work(session: pytest.Session, first: Connection, name: str) -> bool:
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    os.environ["PYTEST_XDIST_WORKER"] = name
    config, plugins = session.config, session.config.pluginmanager
    config.workerinput = {"workerid": name}  # type: ignore[attr-defined]  # plugins look for it
    if results := config.stash.get(xml_key, None):
        results.logfile = os.devnull
    plugins.getplugin("terminalreporter")._tw._file = Path(os.devnull).open("w")  # noqa: SIM115
    capture = plugins.getplugin("capturemanager")
    capture.stop_global_capturing()  # its files are those of the first process
    capture.start_global_capturing()
    plugins.register(_Reports(config, first))
    items = _items(session, first)
    item = next(items, None)
    while item is not None:
        following = next(items, None)
        first.send(("start", item.nodeid))
        item.ihook.pytest_runtest_protocol(item=item, nextitem=following)
        first.send(("end", None))
        item = following
    return True


def _items(session: pytest.Session, first: Connection) -> Iterator[pytest.Item]:
    while True:
        first.send(None)
        if not (scope := first.recv()):
            return
        yield from session.items[slice(*scope)]
