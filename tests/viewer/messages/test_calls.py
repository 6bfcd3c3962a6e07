"""The calls of a page, with random ones: only what is listed runs, with values within ranges."""

from contextlib import suppress
from typing import Any

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from trame_rca.view_adapter import RcaViewAdapter
from trame_server import Server

from app.geometry import InputError, MarginGuardError
from app.viewer.address import Role
from app.viewer.controls import add_replay_controls
from app.viewer.feeds import RATES, ReplayControl
from app.viewer.messages.checks import (
    Commands,
    NotDoneError,
    RefusedError,
    integer,
    number,
    numbers,
    text,
)
from app.viewer.messages.methods import HELLO, Methods
from app.viewer.messages.open_pages import MAX_PAGES, OPENED_BURST, OpenPage, OpenPages

pytestmark = pytest.mark.slow

METHODS = [
    HELLO,
    "trame.state.get",
    "trame.lifecycle.update",
    "trame.error.client",
    "marginguard.seen",
    "trame.trigger",
    "trame.rca.size",
    "trame.rca.event",
    "trame.state.update",
    "application.exit",
    "__class__",
]
COMMANDS = ["play", "step", "seek", "rate", "look", "__init__"]
WORDS = [*COMMANDS, "scene", "type", "w", "h", "p", "x", "y", "MouseMove", "Pinch", "positions"]
leaves = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=8)
    | st.binary(max_size=4)
    | st.sampled_from(WORDS)
    | st.sampled_from(RATES)
)
values = st.recursive(
    leaves,
    lambda each: st.lists(each, max_size=4) | st.dictionaries(st.sampled_from(WORDS), each),
    max_leaves=12,
)
near_calls = st.one_of(
    st.tuples(
        st.just("trame.trigger"),
        st.tuples(st.sampled_from(COMMANDS), st.lists(values, max_size=2), st.just({})),
    ),
    st.tuples(st.just("trame.rca.event"), st.tuples(st.just("scene"), st.just("a"), values)),
    st.tuples(st.just("trame.rca.size"), st.tuples(st.just("scene"), st.just("a"), values)),
    st.tuples(st.just("marginguard.seen"), st.tuples(values)),
)
calls = near_calls | st.tuples(
    st.sampled_from(METHODS) | st.text(max_size=20), st.lists(values, max_size=4).map(tuple)
)


class AreaDouble:
    """A test double: the area of a page that records what reaches VTK."""

    def __init__(self):
        self.sizes: list[tuple[int, int]] = []
        self.events: list[dict[str, Any]] = []

    def process_resize_event(self, width, height):
        self.sizes.append((width, height))

    def process_interaction_event(self, event):
        self.events.append(event)


class SchedulerDouble:
    """A test double: the part of a `RenderLoop` that trame's adapter calls."""

    def __init__(self, area):
        self.rca = area

    def set_push_callback(self, callback):
        pass

    def schedule_render(self):
        pass


class ServerDouble:
    """A test double: a trame server that is not started."""

    def __init__(self):
        self.state = Server().state
        self.protocol = self

    def get_server_state(self):
        return {"name": "marginguard", "state": {"now": 1}}


class Calls:
    """The methods of a page of a replay with ten frames."""

    def __init__(self, role):
        server = ServerDouble()
        self.area = AreaDouble()
        self.control = ReplayControl([n * 10**7 for n in range(10)], lambda: 0)
        commands = Commands()
        add_replay_controls(server.state, commands, self.control)
        adapter = RcaViewAdapter(self.area, "scene", scheduler=SchedulerDouble(self.area))
        adapter.max_pixel_count = 1920 * 1200
        self.methods = Methods(server, commands, "scene", adapter, lambda page, number: None)
        self.page = OpenPage(role)
        self.state = server.state.to_dict()

    def run(self, name, args):
        return self.methods.call(self.page, name, args)


OPERATOR, VIEWER = Calls(Role.OPERATE), Calls(Role.VIEW)


@settings(max_examples=120, deadline=None)
@given(calls)
def test_random_call_runs_within_limits_or_is_refused(call):
    before = dict(OPERATOR.state)
    try:
        result = OPERATOR.run(*call)
    except MarginGuardError as error:
        assert str(error).isascii()
        assert len(str(error)) < 400
    else:
        assert call[0] in METHODS[:-3]
        msgpack.packb(result)
    assert OPERATOR.state == before
    assert 0 <= OPERATOR.control.frame < 10
    assert OPERATOR.control.rate in RATES
    for width, height in OPERATOR.area.sizes:
        assert 0 <= width * height <= 1.1 * 1920 * 1200
    for event in OPERATOR.area.events:
        assert set(event) <= {"type", "w", "h", "x", "y", "ctrlKey", "altKey", "shiftKey"} | {
            *("spinY", "position", "positions", "factor", "translation", "rotation")
        }
    OPERATOR.area.sizes.clear()
    OPERATOR.area.events.clear()


@settings(max_examples=60, deadline=None)
@given(near_calls)
def test_random_call_of_a_view_page_changes_nothing(call):
    with suppress(MarginGuardError):
        VIEWER.run(*call)
    assert (VIEWER.control.frame, VIEWER.control.playing, VIEWER.control.rate) == (0, False, 1.0)
    assert VIEWER.area.sizes == VIEWER.area.events == []


def test_whole_state_has_the_role_and_no_value_that_a_page_may_send():
    state = VIEWER.run("trame.state.get", ())["state"]
    assert state["role"] == "view"
    assert set(state["trame__client_only"]) >= {"now", "role"}


def test_publications_reach_greeted_pages_only():
    pages, greeted, silent = OpenPages(), OpenPage(Role.VIEW), OpenPage(Role.VIEW)
    for page in (greeted, silent):
        pages.add(page)
    OPERATOR.methods.call(greeted, HELLO, ({"secret": "wslink-secret"},))
    pages.beat(3)
    assert greeted.outbox.take()
    assert not silent.outbox.take()
    pages.remove(greeted)
    pages.beat(4)
    assert not greeted.outbox.take()


def test_pages_of_a_role_are_limited_in_number_and_in_rate():
    pages, page = OpenPages(), OpenPage(Role.VIEW)
    for _ in range(MAX_PAGES):
        assert pages.has_room(Role.VIEW, 0)
        pages.add(page := OpenPage(Role.VIEW))
    assert not pages.has_room(Role.VIEW, 0)
    assert pages.has_room(Role.OPERATE, 0)
    pages.remove(page)
    opened = [pages.has_room(Role.VIEW, 0) for _ in range(200)]
    assert opened.count(True) == OPENED_BURST - MAX_PAGES
    assert pages.has_room(Role.OPERATE, 0)
    assert pages.has_room(Role.VIEW, 10**9)


def test_command_without_its_role_or_arguments_is_refused():
    drawn, called = [], []
    commands = Commands(lambda: drawn.append(len(called)))

    def fail():
        raise InputError("not now")

    commands.add("fail", fail, role=Role.VIEW)
    commands.add("play", lambda: called.append("play"))
    commands.add("own", lambda: called.append("own"), role=Role.VIEW)
    for name, args, role in [
        ("play", [], Role.VIEW),
        ("play", [1], Role.OPERATE),
        ("x", [], Role.OPERATE),
    ]:
        with pytest.raises(RefusedError, match="; expected "):
            commands.run(name, args, role)
    with pytest.raises(NotDoneError, match="not now"):
        commands.run("fail", [], Role.VIEW)
    commands.run("own", [], Role.VIEW)
    commands.run("own", [], Role.OPERATE)
    assert called == ["own", "own"]
    assert drawn == [1, 2]  # after each command that was done


@pytest.mark.parametrize(
    ("check", "good", "bad"),
    [
        (text(3), "abc", "abcd"),
        (integer(-1, 3), 3, 4),
        (integer(-1, 3), -1, -2),
        (number(-1.0, 2.0), 2.0, 2.1),
        (number(-1.0, 2.0), -1, float("nan")),
        (numbers(2, 0.0, 1.0), [0.0, 1.0], [0.0, 1.0, 1.0]),
    ],
)
def test_value_beyond_its_limit_is_refused(check, good, bad):
    check(good)
    with pytest.raises(RefusedError, match="; expected "):
        check(bad)


def test_command_with_too_many_arguments_is_refused_before_they_are_looked_at():
    with pytest.raises(RefusedError, match="expected a list of at most 6 values"):
        OPERATOR.run("trame.trigger", ("seek", [0] * 7, {}))
