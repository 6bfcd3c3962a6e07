"""Roles: everything that an operator may do is refused with the view token."""

from http.client import HTTPConnection

import pytest

from tests.viewer.attacks.raw_page import AREA, RawPage, raw_page, response, status_of

pytestmark = pytest.mark.slow

PRESS = {"type": "LeftButtonPress", "x": 5, "y": 5, "w": 100, "h": 100}
CALLS = {
    "look": ("trame.trigger", "look", ["Side"], {}),
    "part_visible": ("trame.trigger", "part_visible", ["TOOL", False], {}),
    "part_opacity": ("trame.trigger", "part_opacity", ["TUMOR", 0.5], {}),
    "centre": ("trame.trigger", "centre", [True], {}),
    "markers": ("trame.trigger", "markers", [2.0, 3.0], {}),
    "markers_delete": ("trame.trigger", "markers_delete", [], {}),
    "play": ("trame.trigger", "play", [], {}),
    "step": ("trame.trigger", "step", [3], {}),
    "frame": ("trame.trigger", "frame", [2], {}),
    "seek": ("trame.trigger", "seek", [0.9], {}),
    "rate": ("trame.trigger", "rate", [4.0], {}),
    "note": ("trame.trigger", "note", ["specimen out"], {}),
    "size": ("trame.rca.size", AREA, "a", {"w": 640, "h": 400, "p": 1}),
    "pointer": ("trame.rca.event", AREA, "a", PRESS),
    "wheel": ("trame.rca.event", AREA, "a", {**PRESS, "type": "MouseWheel", "spinY": 1}),
}
UNDONE = [
    ("trame.trigger", "play", [], {}),
    ("trame.trigger", "part_visible", ["TOOL", True], {}),
    ("trame.trigger", "part_opacity", ["TUMOR", 1.0], {}),
    ("trame.trigger", "rate", [1.0], {}),
    ("trame.trigger", "markers", [1.0, 1.4], {}),
    ("trame.trigger", "centre", [False], {}),
    ("trame.trigger", "look", ["Overview"], {}),
    ("trame.trigger", "step", [-1000], {}),
]


def state_of(page):
    state = page.call("trame.state.get")["result"]["state"]
    shown = {name: state["now"][name] for name in ("frame", "playing", "rate", "state")}
    return {"parts": state["parts"], "look": state["look"], "role": state["role"], **shown}


def test_calls_of_these_tests_are_all_commands_of_the_page(operator):
    """The answer to an unknown command names all that exist."""
    answer = operator.call("trame.trigger", "no such", [], {})["error"]["message"]
    commands = answer.rpartition("one of ")[2].split(", ")
    assert set(commands) == {call[1] for call in CALLS.values() if call[0] == "trame.trigger"}


def test_view_token_refuses_what_the_operate_token_allows(viewer, operator):
    before = state_of(viewer)
    assert before["role"] == "view"
    for name, call in CALLS.items():
        assert "role view; expected operate" in viewer.call(*call)["error"]["message"], name
    assert state_of(viewer) == before
    for name, call in CALLS.items():
        assert "error" not in operator.call(*call), name
    assert state_of(viewer)["parts"] != before["parts"]
    for call in UNDONE:
        assert "error" not in operator.call(*call)


@pytest.mark.parametrize("path", ["/index.html", "/screenshot.png"])
def test_view_token_sees_everything(target, path):
    assert status_of(response(target.server, path, Cookie=target.view)) == 200


def test_pages_of_one_role_are_limited_and_leave_room_for_the_other(target):
    pages = [RawPage(target.server, target.view) for _ in range(20)]
    try:
        statuses = [page.status for page in pages]
        assert sorted(set(statuses)) == [101, 503]
        assert statuses.count(101) <= 16
        with raw_page(target.server, target.operate) as page:
            assert page.status == 101
    finally:
        for page in pages:
            page.close()


def posted(server, who, path, content=b"solid of nothing"):
    """Status and body of a POST."""
    link = HTTPConnection(server.host, timeout=60.0)
    try:
        link.request("POST", path, content, {"Cookie": who})
        answer = link.getresponse()
        return answer.status, answer.read().decode()
    finally:
        link.close()


def test_page_without_a_simulated_world_takes_no_body(target):
    assert posted(target.server, target.operate, "/body/clip?x=0&y=0&z=0")[0] == 405
