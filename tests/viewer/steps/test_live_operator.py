"""Re-arms of a page: sent to the session in another thread, one at a time."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from app.runtime import RearmRefusedError, SeenHold
from app.viewer import LiveOperator
from app.viewer.access.role import Role
from app.viewer.controls import LiveControls
from app.viewer.messages.commands import Commands
from app.viewer.messages.errors import RefusedError


class SessionCommands:
    """Test double of a session's commands: a re-arm waits for ``ready``."""

    def __init__(self, error: Exception | None = None) -> None:
        self.ready = threading.Event()
        self.rearmed: list[tuple[SeenHold, str]] = []
        self._error = error

    def seen(self) -> SeenHold:
        return SeenHold(1, 2)

    def rearm(self, seen: SeenHold, *, origin: str) -> None:
        assert self.ready.wait(60.0)
        self.rearmed.append((seen, origin))
        if self._error is not None:
            raise self._error


@pytest.fixture
def workers():
    with ThreadPoolExecutor(max_workers=1) as workers:
        yield workers


def test_rearm_does_not_wait_and_another_one_meanwhile_is_dropped(workers):
    session, operator = SessionCommands(), LiveOperator(workers)
    operator.rearm(SeenHold(1, 2))  # no session yet
    operator.connect(session)
    operator.rearm(SeenHold(1, 2))
    operator.rearm(SeenHold(3, 4))
    session.ready.set()
    workers.submit(lambda: None).result(60.0)
    assert session.rearmed == [(SeenHold(1, 2), "the page")]
    operator.rearm(SeenHold(5, 6))
    workers.submit(lambda: None).result(60.0)
    assert session.rearmed[1] == (SeenHold(5, 6), "the page")


def test_refused_rearm_is_no_failure_of_the_page(workers):
    session, operator = SessionCommands(RearmRefusedError("another hold")), LiveOperator(workers)
    operator.connect(session)
    session.ready.set()
    for _ in range(2):
        operator.rearm(SeenHold(1, 2))
        workers.submit(lambda: None).result(60.0)
    assert len(session.rearmed) == 2


@pytest.mark.parametrize(
    "args",
    [
        (),
        (1,),
        (1, 2),
        (-1, "2"),
        (2**53, "2"),
        (1.0, "2"),
        (True, "2"),
        (1, ""),
        (1, "0"),
        (1, "-2"),
        (1, "1e3"),
        (1, "\N{SUPERSCRIPT TWO}"),
        (1, "\N{ARABIC-INDIC DIGIT TWO}"),
        (1, str(2**64)),
        (1, "1" * 21),
        (1, None),
    ],
)
def test_malformed_rearm_is_refused(args, workers):
    session, operator, commands = SessionCommands(), LiveOperator(workers), Commands()
    operator.connect(session)
    session.ready.set()
    LiveControls(commands, operator)
    with pytest.raises(RefusedError):
        commands.run("rearm", args, Role.OPERATE)
    workers.shutdown()
    assert session.rearmed == []


def test_page_without_controls_may_not_rearm(workers):
    session, operator, commands = SessionCommands(), LiveOperator(workers), Commands()
    operator.connect(session)
    session.ready.set()
    LiveControls(commands, operator)
    with pytest.raises(RefusedError, match="role view; expected operate"):
        commands.run("rearm", (1, "2"), Role.VIEW)
    commands.run("rearm", (1, str(2**64 - 1)), Role.OPERATE)
    workers.shutdown()
    assert session.rearmed == [(SeenHold(1, 2**64 - 1), "the page")]
