"""Commands of the page to a live session: sent in another thread, one at a time."""

import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

from app.geometry import InputError, Transform
from app.runtime import ImageDepth, RearmRefusedError, RequestKind, RequestLog, SeenHold, TipChange
from app.viewer import LiveOperator
from app.viewer.access.role import Role
from app.viewer.controls import LiveControls
from app.viewer.messages.commands import Commands
from app.viewer.messages.errors import NotDoneError, RefusedError
from tests.doubles import PARAMETERS

PAGE = "the page"
SEEN = (PARAMETERS.stop_mm, PARAMETERS.warn_mm)


class SessionCommands:
    """Test double of a session's commands: a re-arm and a recording wait for ``ready``."""

    recording = None

    def __init__(self, error=None):
        self.ready = threading.Event()
        self.called = []
        self.requests = RequestLog(lambda: 0, lambda: 0)
        self.content = SimpleNamespace(
            margins=PARAMETERS, image_depth=ImageDepth((40.0, 60.0), 40.0)
        )
        self._error = error

    def rearm(self, seen, *, origin):
        assert self.ready.wait(60.0)
        self.called.append((seen, origin))
        if self._error is not None:
            raise self._error

    def change_shown(self, request, *, origin):
        self.called.append((str(request[0]), origin))

    def start_recording(self, name, *, origin):
        assert self.ready.wait(60.0)
        self.called.append((name, origin))

    def stop_recording(self, *, origin):
        self.called.append((origin,))
        raise InputError("none is running")  # listed by the session


class Operating:
    """A page's commands to a session that is not connected yet."""

    def __init__(self, error=None):
        self.workers = ThreadPoolExecutor(max_workers=1)
        self.session, self.operator = SessionCommands(error), LiveOperator(self.workers)
        self.commands = Commands()
        LiveControls(self.commands, self.operator)

    def run(self, name, *args, role=Role.OPERATE):
        self.commands.run(name, args, role)

    def wait(self):
        """Wait until the session has got what was sent."""
        self.workers.submit(lambda: None).result(60.0)


@pytest.fixture
def page():
    page = Operating()
    yield page
    page.session.ready.set()
    page.workers.shutdown()


def test_rearm_does_not_wait_and_another_one_meanwhile_is_dropped(page):
    session, operator = page.session, page.operator
    operator.rearm(SeenHold(1, 2))  # no session yet
    operator.connect(session)
    operator.rearm(SeenHold(1, 2))
    operator.rearm(SeenHold(3, 4))
    session.ready.set()
    page.wait()
    assert session.called == [(SeenHold(1, 2), PAGE)]
    operator.rearm(SeenHold(5, 6))
    page.wait()
    assert session.called[1] == (SeenHold(5, 6), PAGE)


def test_refused_rearm_is_no_failure_of_the_page():
    page = Operating(RearmRefusedError("another hold"))
    page.operator.connect(page.session)
    page.session.ready.set()
    for _ in range(2):
        page.operator.rearm(SeenHold(1, 2))
        page.wait()
    assert len(page.session.called) == 2
    page.workers.shutdown()


@pytest.mark.parametrize(
    "args",
    [
        *((), (1,), (1, 2), (-1, "2"), (2**53, "2"), (1.0, "2"), (True, "2"), (1, None)),
        *((1, text) for text in ("", "0", "-2", "1e3", str(2**64), "1" * 21)),
        *((1, text) for text in ("\N{SUPERSCRIPT TWO}", "\N{ARABIC-INDIC DIGIT TWO}")),
    ],
)
def test_malformed_rearm_is_refused(args, page):
    page.operator.connect(page.session)
    page.session.ready.set()
    with pytest.raises(RefusedError):
        page.run("rearm", *args)
    page.wait()
    assert page.session.called == []


@pytest.mark.parametrize(
    ("name", "args", "unconnected"),
    [
        ("rearm", (1, str(2**64 - 1)), None),
        ("margins", (*SEEN, 2.0, 6.0), "the session has not begun"),
        ("needle_length", (5,), "needle: the session has not begun"),
        ("image_depth", (40, 60), "depth of the images: the session has not begun"),
        ("record", (True, ""), "recording: the session or the recorder is starting"),
    ],
)
def test_command_needs_a_session_and_the_role_of_an_operator(name, args, unconnected, page):
    if unconnected is not None:
        with pytest.raises(NotDoneError, match=unconnected):
            page.run(name, *args)
    page.operator.connect(page.session, lambda *args: page.session.called.append(args))
    with pytest.raises(RefusedError, match="role view; expected operate"):
        page.run(name, *args, role=Role.VIEW)
    page.session.ready.set()
    page.wait()
    assert page.session.called == []
    page.run(name, *args)
    page.wait()
    (called,) = page.session.called
    assert called[-1] == PAGE


def test_margins_of_the_page_are_those_that_the_operator_has_seen(page):
    used = []
    page.operator.connect(page.session, lambda *args: used.append(args))
    for stop_mm, warn_mm in ((6.0, 6.0), (7.0, 6.0)):
        with pytest.raises(NotDoneError, match="expected a larger warning"):
            page.run("margins", *SEEN, stop_mm, warn_mm)
    with pytest.raises(NotDoneError, match=r"margins: they are now .* expected the same request"):
        page.run("margins", SEEN[0] + 1.0, SEEN[1], 2.0, 6.0)
    page.run("margins", *SEEN, 2.0, 6.0)
    page.wait()
    assert used == [(2.0, 6.0, PAGE)]


def test_needle_and_depth_of_the_page_are_within_their_ranges(page):
    page.operator.connect(page.session)
    with pytest.raises(RefusedError, match="expected a number from -10 to 10"):
        page.run("needle_length", 10.5)
    with pytest.raises(NotDoneError, match="depth of the images: it is now 40 mm, and nothing"):
        page.run("image_depth", 60, 40)
    for name, args in (("needle_length", (-1,)), ("image_depth", (40, 60))):
        page.run(name, *args)
        page.wait()
    assert page.session.called == [("needle_length", PAGE), ("image_depth", PAGE)]


def test_recording_of_the_page_reaches_the_session_one_request_at_a_time(page):
    assert page.operator.recording is None
    page.operator.connect(page.session)
    for refused in ((True,), (True, 5), ("yes", ""), (True, "a" * 65)):
        with pytest.raises(RefusedError):
            page.run("record", *refused)
    page.run("record", True, " today ")
    with pytest.raises(NotDoneError, match="is starting; expected the request later"):
        page.run("record", True, "")
    page.session.ready.set()
    page.wait()
    page.run("record", False, "")
    page.wait()
    assert page.session.called == [("today", PAGE), (PAGE,)]


def test_margins_that_the_session_refuses_are_listed_once(page):
    requests, listed = page.session.requests, []
    requests.listen(listed.append)

    def refuse(stop_mm, warn_mm, origin):
        if stop_mm < 2.0:
            requests.refused(RequestKind.MARGINS, origin, "another change")
            raise InputError("another change")
        raise InputError("out of range")

    page.operator.connect(page.session, refuse)
    page.operator.set_margins(1.0, 6.0)
    page.operator.set_margins(2.0, 6.0)
    page.wait()
    assert [each.text for each in listed] == ["another change", "out of range"]
    assert all(each.origin == PAGE and not each.accepted for each in listed)


@pytest.mark.parametrize(
    ("name", "args"),
    [
        ("set_tip", (TipChange(Transform.identity("cautery", "cautery_tip"), 0.1),)),
        ("set_tumor", (Transform.identity("needle", "tumor"), None, 0.5)),
    ],
)
def test_second_tip_or_tumour_waits_for_the_first(page, name, args):
    entered = threading.Event()

    def change(*_, **__):
        entered.set()
        assert page.session.ready.wait(60.0)

    setattr(page.session, name, change)
    page.operator.connect(page.session)
    assert getattr(page.operator, name)(*args)
    assert entered.wait(60.0)
    assert not getattr(page.operator, name)(*args)


def test_note_is_listed_with_the_requests(page):
    page.operator.note("too early")
    page.operator.connect(page.session)
    page.operator.note("specimen out (step 3, stamp 5 ns)")
    last = page.session.requests.last
    assert last.line == "note from the page accepted: specimen out (step 3, stamp 5 ns)"
