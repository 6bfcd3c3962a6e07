"""Messages that no page sends, from outside, with the token: refused, without memory or harm."""

import struct
import zlib

import msgpack
import pytest

from tests.viewer.attacks.raw_page import AREA, BINARY, PING, TEXT, message, raw_page

pytestmark = pytest.mark.slow

POLICY, TOO_BIG, PROTOCOL_ERROR = 1008, 1009, 1002
NO_FIN, COMPRESSED = 0x00, 0xC0
CONTINUED = 0


def test_header_that_claims_four_gigabytes_allocates_nothing(target):
    """wslink allocates what a header claims: six such frames ended the server."""
    with target.bounded():
        for number in range(6):
            with raw_page(target.server, target.operate) as page:
                page.greet().frame(struct.pack("<III", number, 0, 0xFFFF_FFF0) + bytes(18))
                assert page.ended() == POLICY


@pytest.mark.parametrize(
    "data",
    [
        b"",
        bytes(12),
        bytes(13),
        struct.pack("<III", 1, 5, 1) + b"\xc0",
        struct.pack("<III", 1, 0, 5) + b"\xdd\xff\xff\xff\xff",  # an array of 2**32 items
        struct.pack("<III", 1, 0, 5) + b"\xdf\xff\xff\xff\xff",
        struct.pack("<III", 1, 0, 5) + b"\xc6\xff\xff\xff\xff",
        struct.pack("<III", 1, 0, 9000) + b"\x91" * 9000,  # nested
        struct.pack("<III", 1, 0, 6) + b"\xd6\xff\x00\x00\x00\x00",  # a time stamp
        struct.pack("<III", 1, 0, 2) + b"\xa1\xff",  # no UTF-8
        message("trame.state.get", id=["rpc:1:1"]),
        message("trame.state.get", id="publish:trame.state.topic:0"),
        message("trame.state.get", id="rpc:\n:1"),
        message("trame.state.get", kwargs={"a": 1}),
        message("trame.state.get", args={"a": 1}),
        message("trame.state.get", method=7),
        struct.pack("<III", 1, 0, 1) + msgpack.packb(7),
    ],
)
def test_malformed_message_closes_the_socket(target, operator, data):
    with target.bounded():
        operator.frame(data)
        assert operator.ended() == POLICY


@pytest.mark.parametrize(
    ("frames", "code"),
    [
        ([{"data": b"{}", "kind": TEXT}], POLICY),
        ([{"data": b"", "claimed": 2**62}], TOO_BIG),
        ([{"data": bytes(20_000)}], TOO_BIG),
        (
            [{"data": bytes(9000), "first": NO_FIN}, {"data": bytes(9000), "kind": CONTINUED}],
            TOO_BIG,
        ),
        ([{"data": zlib.compress(bytes(10_000_000))[2:], "first": COMPRESSED}], PROTOCOL_ERROR),
        ([{"data": bytes(126), "kind": PING}], PROTOCOL_ERROR),
        ([{"data": b"", "kind": 5}], PROTOCOL_ERROR),
    ],
    ids=["text", "claimed length", "long", "fragments", "compressed", "long ping", "reserved"],
)
def test_frame_outside_the_limits_closes_the_socket(target, operator, frames, code):
    with target.bounded():
        for frame in frames:
            operator.frame(**frame)
        assert operator.ended() == code


def test_socket_offers_no_compression(target):
    """A small compressed message could unpack to a large one."""
    asked = {"Sec-WebSocket-Extensions": "permessage-deflate"}
    with raw_page(target.server, target.operate, **asked) as page:
        assert page.status == 101
        assert b"Sec-WebSocket-Extensions" not in page.headers


@pytest.mark.parametrize(
    ("count", "data", "kind"),
    [
        (1600, message("marginguard.seen", 0), BINARY),
        (1600, b"", PING),
        (300, message("trame.state.get"), BINARY),  # which is answered with the whole state
    ],
)
def test_too_many_messages_close_the_socket(target, operator, count, data, kind):
    with target.bounded():
        for _ in range(count):
            operator.frame(data, kind)
        assert operator.ended() == POLICY


def test_first_message_is_the_greeting(target):
    with raw_page(target.server, target.operate) as page:
        page.frame(message("trame.trigger", "play", [], {}))
        assert page.ended() == POLICY


def test_ping_is_answered(operator):
    """A proxy may send them."""
    operator.frame(b"42", PING)
    assert operator.call("trame.state.get")["result"]["state"]["role"] == "operate"


EXITS = [("application.exit", ()), ("application.exit.later", (0,))]
FORGERIES = [
    ("trame.state.update", ([{"key": "trame__template_main", "value": "<b>CLEAR 38.2 mm</b>"}],)),
    ("trame.state.update", ([{"key": "now", "value": {"state": "NEGATIVE"}}],)),
    ("trame.state.update", ([],)),
    ("trame.force.push", ("now",)),
    ("trame.rca.push", (AREA, {"type": "image/jpeg", "number": 1}, b"\xff\xd8")),
    ("trame.rca.reset", (AREA,)),
    ("trame.rca.drop", (AREA, -1)),
    ("trame.rca.video.codecs", (AREA,)),
]
WRONG_TRIGGERS = [
    *(("__class__", []), ("trigger__1", []), ("play", [1]), ("step", [10**9]), ("step", [True])),
    *(("look", ["<script>"]), ("look", [["Overview"]]), ("rate", [3.0]), ("seek", [float("inf")])),
    *(("part_visible", ["TOOL", "no"]), ("part_visible", ["__init__", True])),
    *(("part_opacity", ["TOOL", float("nan")]), ("part_opacity", ["TOOL", 2.0])),
    *(("frame", [10**6]), ("frame", [-1])),
]
WRONG_ARGUMENTS = [
    *(("trame.trigger", (*call, {})) for call in WRONG_TRIGGERS),
    ("trame.trigger", ("play", [], {"self": 1})),
    ("trame.rca.size", ("other", "a", {"w": 10, "h": 10, "p": 1})),
    ("trame.rca.size", (AREA, "a", {"w": 1e9, "h": 1e9, "p": 1})),
    ("trame.rca.size", (AREA, "a", {"w": float("nan"), "h": 10, "p": 1})),
    ("trame.rca.event", (AREA, "a", {"type": "LeftButtonPress"})),
    # VTK ends the process at this one.
    ("trame.rca.event", (AREA, "a", {"type": "MouseMove", "x": "a", "y": 1, "w": 1, "h": 1})),
    ("trame.rca.event", (AREA, "a", {"type": "Pinch", "w": 9, "h": 9, "positions": {}})),
    ("trame.rca.event", (AREA, "a", {"type": "NoEvent"})),
    ("marginguard.seen", (-1,)),
    ("marginguard.seen", ("page", 1)),
    ("trame.lifecycle.update", ("server_exited",)),
    ("trame.error.client", ({},)),
    ("wslink.nothing", ()),
]


def test_call_that_no_page_makes_is_refused_without_a_trace(target):
    with target.bounded():
        for calls in (EXITS + FORGERIES, WRONG_ARGUMENTS[:13], WRONG_ARGUMENTS[13:]):
            with raw_page(target.server, target.operate) as page:
                page.greet()
                for method, args in calls:
                    error = page.call(method, *args)["error"]
                    assert set(error) == {"code", "message"}
                    assert "; expected" in error["message"], (method, args)
                    assert "Traceback" not in error["message"]
    assert "Traceback" not in target.log


def test_repeated_refusals_close_the_socket(operator):
    for _ in range(20):
        assert "error" in operator.call("application.exit")
    operator.frame(message("application.exit"))
    assert operator.ended() == POLICY


def test_picture_that_was_never_sent_is_not_acknowledged(operator):
    operator.frame(message("marginguard.seen", 10**9))
    assert operator.ended() == POLICY


def test_error_of_a_browser_is_logged_in_one_line_of_ascii(target, operator):
    operator.call("trame.error.client", "a\r\nCRITICAL forged\x1b[2J\N{SNOWMAN}")
    (line,) = [each for each in target.log.splitlines() if "forged" in each]
    assert "error in the browser: 'a\\r\\nCRITICAL forged\\x1b[2J\\u2603'" in line


def test_picture_comes_with_its_values_and_the_next_after_the_acknowledgement(operator):
    operator.call("marginguard.seen", 0)
    values = operator.published("trame.state.topic")
    number = operator.published("trame.rca.topic.stream")["meta"]["number"]
    assert values["now"]["number"] == number
    operator.call("trame.trigger", "step", [1], {})
    for _ in range(3):
        operator.published("marginguard.beat")
    operator.frame(message("marginguard.seen", number, id="rpc:ack:0"))
    seen = [each["id"] for each in _until_picture(operator)]
    assert "rpc:ack:0" in seen  # no picture came before
    operator.call("trame.trigger", "seek", [0.0], {})


def _until_picture(page):
    for each in page.messages():
        yield each
        if each["id"].startswith("publish:trame.rca.topic.stream"):
            return
