"""Re-arms of a page: sent to the session in another thread, one at a time."""

import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

from app.geometry import InputError
from app.runtime import ImageDepth, RearmRefusedError, RequestKind, RequestLog, SeenHold
from app.viewer import LiveOperator
from app.viewer.access.role import Role
from app.viewer.controls import LiveControls
from app.viewer.messages.commands import Commands
from app.viewer.messages.errors import NotDoneError, RefusedError
from tests.doubles import PARAMETERS


class SessionCommands:
    """Test double of a session's commands: a re-arm waits for ``ready``."""

    def __init__(self, error=None):
        self.ready = threading.Event()
        self.rearmed: list[tuple[SeenHold, str]] = []
        self._error = error

    def seen(self):
        return SeenHold(1, 2)

    def rearm(self, seen, *, origin):
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


class MarginCommands(SessionCommands):
    """Test double of a session's commands with margins and a list of requests."""

    def __init__(self):
        super().__init__()
        self.requests = RequestLog(lambda: 0, lambda: 0)
        self.content = SimpleNamespace(margins=PARAMETERS)


def test_margins_of_the_page_reach_the_session_with_their_origin(workers):
    session, operator, commands = MarginCommands(), LiveOperator(workers), Commands()
    LiveControls(commands, operator)
    seen = (PARAMETERS.stop_mm, PARAMETERS.warn_mm)
    with pytest.raises(NotDoneError, match="the session has not begun"):
        commands.run("margins", (*seen, 2.0, 6.0), Role.OPERATE)
    used = []
    operator.connect(session, lambda *args: used.append(args))
    with pytest.raises(RefusedError, match="role view; expected operate"):
        commands.run("margins", (*seen, 2.0, 6.0), Role.VIEW)
    for stop_mm, warn_mm in ((6.0, 6.0), (7.0, 6.0)):
        with pytest.raises(NotDoneError, match="expected a larger warning"):
            commands.run("margins", (*seen, stop_mm, warn_mm), Role.OPERATE)
    with pytest.raises(NotDoneError, match=r"margins: they are now .* expected the same request"):
        commands.run("margins", (seen[0] + 1.0, seen[1], 2.0, 6.0), Role.OPERATE)
    commands.run("margins", (*seen, 2.0, 6.0), Role.OPERATE)
    workers.shutdown()
    assert used == [(2.0, 6.0, "the page")]


class NeedleCommands(MarginCommands):
    """Test double of a session's commands with a needle."""

    def __init__(self):
        super().__init__()
        self.lengthened = []

    def change_shown(self, request, *, origin):
        self.lengthened.append((str(request[0]), origin))


def test_needle_of_the_page_reaches_the_session_with_its_origin(workers):
    session, operator, commands = NeedleCommands(), LiveOperator(workers), Commands()
    LiveControls(commands, operator)
    with pytest.raises(NotDoneError, match="needle: the session has not begun"):
        commands.run("needle_length", (5,), Role.OPERATE)
    operator.connect(session)
    with pytest.raises(RefusedError, match="role view; expected operate"):
        commands.run("needle_length", (5,), Role.VIEW)
    with pytest.raises(RefusedError, match="expected a number from -10 to 10"):
        commands.run("needle_length", (10.5,), Role.OPERATE)
    for by_mm in (5, -1):
        commands.run("needle_length", (by_mm,), Role.OPERATE)
    workers.shutdown()
    assert session.lengthened == [("needle_length", "the page")] * 2


def test_depth_of_the_page_reaches_the_session_while_the_page_shows_the_one_in_use(workers):
    session, operator, commands = NeedleCommands(), LiveOperator(workers), Commands()
    session.content = SimpleNamespace(image_depth=ImageDepth((40.0, 60.0), 40.0))
    LiveControls(commands, operator)
    with pytest.raises(NotDoneError, match="depth of the images: the session has not begun"):
        commands.run("image_depth", (40, 60), Role.OPERATE)
    operator.connect(session)
    with pytest.raises(RefusedError, match="role view; expected operate"):
        commands.run("image_depth", (40, 60), Role.VIEW)
    with pytest.raises(NotDoneError, match="depth of the images: it is now 40 mm, and nothing"):
        commands.run("image_depth", (60, 40), Role.OPERATE)
    commands.run("image_depth", (40, 60), Role.OPERATE)
    workers.shutdown()
    assert session.lengthened == [("image_depth", "the page")]


def test_recording_of_the_page_reaches_the_session_one_request_at_a_time(workers):
    class RecordingCommands(SessionCommands):
        recording = None

        def __init__(self):
            super().__init__()
            self.called: list[tuple[str, ...]] = []

        def start_recording(self, name, *, origin):
            assert self.ready.wait(60.0)
            self.called.append((name, origin))

        def stop_recording(self, *, origin):
            self.called.append((origin,))
            raise InputError("none is running")  # listed by the session

    session, operator, commands = RecordingCommands(), LiveOperator(workers), Commands()
    LiveControls(commands, operator)
    assert operator.recording is None
    with pytest.raises(NotDoneError, match="recording: the session or the recorder is starting"):
        commands.run("record", (True, ""), Role.OPERATE)
    operator.connect(session)
    for refused in ((True,), (True, 5), ("yes", ""), (True, "a" * 65)):
        with pytest.raises(RefusedError):
            commands.run("record", refused, Role.OPERATE)
    with pytest.raises(RefusedError, match="role view; expected operate"):
        commands.run("record", (True, ""), Role.VIEW)
    commands.run("record", (True, " today "), Role.OPERATE)
    with pytest.raises(NotDoneError, match="is starting; expected the request later"):
        commands.run("record", (True, ""), Role.OPERATE)
    session.ready.set()
    workers.submit(lambda: None).result(60.0)
    commands.run("record", (False, ""), Role.OPERATE)
    workers.shutdown()
    assert session.called == [("today", "the page"), ("the page",)]


def test_margins_that_the_session_refuses_are_listed_once(workers):
    session, operator = MarginCommands(), LiveOperator(workers)
    listed = []
    session.requests.listen(listed.append)

    def refuse(stop_mm, warn_mm, origin):
        if stop_mm < 2.0:
            session.requests.refused(RequestKind.MARGINS, origin, "another change")
            raise InputError("another change")
        raise InputError("out of range")

    operator.connect(session, refuse)
    operator.set_margins(1.0, 6.0)
    operator.set_margins(2.0, 6.0)
    workers.shutdown()
    assert [each.text for each in listed] == ["another change", "out of range"]
    assert all(each.origin == "the page" and not each.accepted for each in listed)


def test_note_is_listed_with_the_requests(workers):
    session, operator = MarginCommands(), LiveOperator(workers)
    operator.note("too early")
    operator.connect(session)
    operator.note("specimen out (step 3, stamp 5 ns)")
    last = session.requests.last
    assert last.line == "note from the page accepted: specimen out (step 3, stamp 5 ns)"
