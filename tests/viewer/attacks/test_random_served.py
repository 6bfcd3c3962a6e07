"""Random messages to a served page, with both tokens: it lives, and what it shows stays true."""

from contextlib import suppress

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.viewer.attacks.raw_page import BINARY, CLOSE, PING, TEXT, message, raw_page
from tests.viewer.messages.test_calls import calls

pytestmark = pytest.mark.long

frames = st.one_of(
    calls.map(lambda call: (message(call[0], *call[1]), BINARY)),
    st.tuples(st.binary(max_size=200), st.sampled_from([BINARY, TEXT, PING, 0, 3, 11])),
)


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.lists(calls, min_size=1, max_size=15), st.lists(frames, max_size=3), st.booleans())
def check_random_messages(target, calls, frames, operates):
    with raw_page(target.server, target.operate if operates else target.view) as page:
        page.greet()
        with suppress(ConnectionError):  # the server may have closed the socket
            for name, args in calls:
                page.frame(message(name, *args))
            for data, kind in frames:
                page.frame(data, kind)
            page.frame(b"\x03\xe8", CLOSE)
        for answer in page.messages():
            assert "Traceback" not in str(answer.get("error"))


def test_random_messages_leave_the_server_alive_and_true(target):
    with target.bounded():
        check_random_messages(target)
        with raw_page(target.server, target.operate) as page:
            page.greet().call("trame.trigger", "step", [-1000], {})
            page.call("trame.trigger", "look", ["Overview"], {})
            page.call("trame.trigger", "rate", [1.0], {})
            state = page.call("trame.state.get")["result"]["state"]
    assert state["title"]["case"] == "small"
    assert "state-label" in state["trame__template_main"]
    assert "Traceback" not in target.log
