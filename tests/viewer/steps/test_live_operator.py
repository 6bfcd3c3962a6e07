"""Commands of the page to a live session: sent in other threads, most of them one at a time."""

import queue
import threading
from types import SimpleNamespace

import pytest

from app.geometry import Transform
from app.hold import RearmRefusedError
from app.runtime import (
    ITEM_COMMANDS,
    ChooseDepth,
    ImageDepth,
    Rearm,
    Record,
    SetMargins,
    SetTip,
    SwitchStructure,
)
from app.viewer import LiveOperator
from app.viewer.address import Role
from app.viewer.controls import LiveControls
from app.viewer.messages.checks import Commands, NotDoneError, RefusedError
from tests.doubles import PARAMETERS

PAGE = "the page"
SEEN = (PARAMETERS.stop_mm, PARAMETERS.warn_mm)


class Session:
    """Test double of a session: a re-arm and a recording wait for ``ready``."""

    recording = None

    def __init__(self, error=None):
        self.ready = threading.Event()
        self.called = []
        self.answered = threading.Semaphore(0)
        self.content = SimpleNamespace(
            margins=PARAMETERS, image_depth=ImageDepth((40.0, 60.0), 40.0)
        )
        self._error = error

    def request(self, command):
        self.called.append(command)
        try:
            if isinstance(command, Rearm | Record | SetTip):
                assert self.ready.wait(60.0)
            if self._error is not None:
                raise self._error
        finally:
            self.answered.release()
        return ""


class Operating:
    """A page's commands to a session that is not connected yet."""

    def __init__(self, error=None):
        self.shown = queue.Queue()
        self.session = Session(error)
        self.operator = LiveOperator(self.shown.put, lambda: 17)
        self.commands = Commands()
        LiveControls(self.commands, self.operator)

    def run(self, name, *args, role=Role.OPERATE):
        self.commands.run(name, args, role)

    def wait(self):
        """Wait until the session has answered what was sent."""
        assert self.session.answered.acquire(timeout=60.0)


@pytest.fixture
def page():
    page = Operating()
    yield page
    page.session.ready.set()
    page.operator.close()


def test_rearm_does_not_wait_and_another_one_meanwhile_is_not_sent(page):
    session, operator = page.session, page.operator
    assert not operator.request(Rearm(1, 2))  # no session yet
    operator.connect(session)
    page.run("rearm", 1, "2")
    with pytest.raises(NotDoneError, match="does not answer an earlier request yet"):
        page.run("rearm", 3, "4")
    session.ready.set()
    page.wait()
    assert session.called == [Rearm(1, 2)]


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (RearmRefusedError("another hold"), "another hold"),
        (RuntimeError("a bug"), "unexpected RuntimeError: see the log"),
    ],
)
def test_refused_or_failed_request_is_shown_and_the_next_one_is_sent(error, text):
    page = Operating(error)
    page.operator.connect(page.session)
    page.session.ready.set()
    for kind, command in (("rearm", Rearm(1, 2)), ("set_margins", SetMargins(2.0, 6.0))):
        assert page.operator.request(command)
        shown = page.shown.get(timeout=60.0)
        assert (shown.kind, shown.origin, shown.accepted, shown.text) == (kind, PAGE, False, text)
    page.operator.close()


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
    assert page.session.called == []


@pytest.mark.parametrize(
    ("name", "args", "command"),
    [
        ("rearm", (1, str(2**64 - 1)), Rearm(1, 2**64 - 1)),
        ("margins", (*SEEN, 2.0, 6.0), SetMargins(2.0, 6.0)),
        ("switch", ("vessel", False, " no field "), SwitchStructure("vessel", False, "no field")),
        ("switch", ("vessel", True, ""), SwitchStructure("vessel", True)),
        ("needle_length", (5,), ITEM_COMMANDS["needle"](5)),
        ("image_depth", (40, 60), ChooseDepth(60)),
        ("record", (True, " today "), Record(True, "today")),
        ("record", (False, ""), Record(False)),
    ],
)
def test_command_needs_a_session_and_the_role_of_an_operator(name, args, command, page):
    with pytest.raises(NotDoneError, match="the session has not begun"):
        page.run(name, *args)
    page.operator.connect(page.session)
    with pytest.raises(RefusedError, match="role view; expected operate"):
        page.run(name, *args, role=Role.VIEW)
    page.session.ready.set()
    assert page.session.called == []
    page.run(name, *args)
    page.wait()
    assert page.session.called == [command]


def test_margins_of_the_page_are_those_that_the_operator_has_seen(page):
    page.operator.connect(page.session)
    for stop_mm, warn_mm in ((6.0, 6.0), (7.0, 6.0)):
        with pytest.raises(NotDoneError, match="expected a larger warning"):
            page.run("margins", *SEEN, stop_mm, warn_mm)
    with pytest.raises(NotDoneError, match=r"margins: they are now .* expected the same request"):
        page.run("margins", SEEN[0] + 1.0, SEEN[1], 2.0, 6.0)
    assert page.session.called == []


def test_needle_and_depth_of_the_page_are_within_their_ranges(page):
    page.operator.connect(page.session)
    with pytest.raises(RefusedError, match="expected a number from -10 to 10"):
        page.run("needle_length", 10.5)
    with pytest.raises(NotDoneError, match="depth of the images: it is now 40 mm, and nothing"):
        page.run("image_depth", 60, 40)
    assert page.session.called == []


def test_recording_of_the_page_is_one_request_at_a_time(page):
    assert page.operator.recording is None
    page.operator.connect(page.session)
    for refused in ((True,), (True, 5), ("yes", ""), (True, "a" * 65)):
        with pytest.raises(RefusedError):
            page.run("record", *refused)
    page.run("record", True, "today")
    with pytest.raises(NotDoneError, match="expected the request later"):
        page.run("record", True, "")


def test_second_tip_waits_for_the_first_and_each_step_of_the_needle_counts(page):
    page.operator.connect(page.session)
    tip = SetTip(Transform.identity("cautery", "cautery_tip"), 0.1)
    assert page.operator.request(tip)
    assert not page.operator.request(tip)
    for _ in range(5):
        page.run("needle_length", 1)
    for _ in range(5):
        page.wait()
    assert page.session.called.count(ITEM_COMMANDS["needle"](1)) == 5
    assert page.session.called.count(tip) == 1
