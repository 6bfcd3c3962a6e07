"""A page that edits a simulated world refuses with the view token what an operator may do."""

import pytest

from tests.bridge.live.conftest import breach as breach
from tests.bridge.live.conftest import live_yaml as live_yaml
from tests.viewer.attacks.raw_page import cookie, raw_page
from tests.viewer.attacks.test_roles_served import posted
from tests.viewer.conftest import TOKEN, VIEW_TOKEN

pytestmark = pytest.mark.long

WORLD_CALLS = {
    "world_move": ("trame.trigger", "world_move", ["wall", 1.0, 0, 0, "x", 0], {}),
    "world_add": ("trame.trigger", "world_add", ["clip", "box", [1, 1, 1], [0, 0, 0]], {}),
    "world_remove": ("trame.trigger", "world_remove", ["clip"], {}),
}


@pytest.fixture
def world_server(serve_live, live_yaml):
    """A live page that edits a simulated world, without a simulation."""
    config = live_yaml({"tracked_transforms": {"topic": "/tracked_transforms"}, "clock": "host"})
    return serve_live(config, "--world", "marginguard_simulation")


def test_view_token_edits_no_simulated_world(world_server):
    operate, view = cookie(world_server, TOKEN), cookie(world_server, VIEW_TOKEN)
    with raw_page(world_server, view) as page:
        viewer = page.greet()
        for name, call in WORLD_CALLS.items():
            assert "role view; expected operate" in viewer.call(*call)["error"]["message"], name
    with raw_page(world_server, operate) as page:
        operator = page.greet()
        answer = operator.call("trame.trigger", "no such", [], {})["error"]["message"]
        commands = answer.rpartition("one of ")[2].split(", ")
        assert {each for each in commands if each.startswith("world_")} == set(WORLD_CALLS)
        for name, call in WORLD_CALLS.items():
            assert "expected" in operator.call(*call)["error"]["message"], name
        assert (
            "no simulation receives requests"
            in operator.call(*WORLD_CALLS["world_add"])["error"]["message"]
        )
    path = "/body/clip?x=0&y=0&z=0"
    assert posted(world_server, view, path) == (403, "")
    assert posted(world_server, "", path)[0] == 403
    status, text = posted(world_server, operate, path)
    assert (status, "clip.stl" in text) == (409, True)
