"""The mouse as a hand on the page of a live session: its wrench, as a controller receives it."""

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped

from app.bridge import RosNode
from app.bridge.topics import STREAM, Topic
from tests.cli.command import run
from tests.cli.test_view import SENDER
from tests.viewer.conftest import Server
from tests.waiting import wait_until

pytestmark = pytest.mark.long

TOPIC = "/arm/body/measured_cf"


class Received:
    """The wrenches that a controller would receive."""

    def __init__(self, ros):
        self.wrenches = []
        ros.subscribe(Topic(TOPIC, WrenchStamped, STREAM), self.wrenches.append)

    def sizes(self, since=0):
        forces = [each.wrench.force for each in self.wrenches[since:]]
        return [float(np.linalg.norm([each.x, each.y, each.z])) for each in forces]

    def until(self, page, condition):
        wait_until(
            condition, lambda: page.wait_for_timeout(50), describe=lambda: self.sizes()[-20:]
        )

    def until_zero(self, page):
        """Wait until 30 wrenches after the present have no force."""
        since = len(self.wrenches)
        self.until(page, lambda: len(self.wrenches) > since + 30 and not any(self.sizes(-30)))


@pytest.fixture
def server(can_draw, domain_id, live_yaml, tmp_path):
    config = live_yaml({"tracked_transforms": {"topic": "/tracked_transforms"}, "clock": "host"})
    found = Server(["--live", "--config", str(config), "--hand", TOPIC], tmp_path / "view.txt")
    yield found
    found.close()


def opened(context, url):
    page = context.new_page()
    page.goto(url)
    page.wait_for_selector("#grip")
    return page


def drag(page):
    """Press on the tip until the page shows that the tool is held, and pull."""
    box = page.locator("main.view").bounding_box()
    for _ in range(100):
        page.mouse.up()
        x, y = page.evaluate("() => (trame.state.get('hand') || {tip: [50, 50]}).tip")
        place = (box["x"] + x / 100 * box["width"], box["y"] + y / 100 * box["height"])
        page.mouse.move(*place)
        page.mouse.down()
        page.wait_for_timeout(500)
        if page.evaluate("() => Boolean((trame.state.get('hand') || {}).pulled)"):
            page.mouse.move(place[0] - 150, place[1] - 60, steps=10)
            return
    pytest.fail("the tool was not held")


def test_drag_publishes_a_limited_force_until_release_and_until_the_page_is_closed(
    browser, server, start, frames_file, domain_id
):
    start(str(SENDER), str(frames_file), "tracked", "again")
    context = browser.new_context(viewport={"width": 960, "height": 600})
    page = opened(context, server.url)
    with RosNode("controller", domain_id=domain_id) as ros:
        received = Received(ros)
        received.until(page, lambda: len(received.wrenches) > 20)
        assert not any(received.sizes())
        drag(page)
        received.until(page, lambda: max(received.sizes()[-20:]) > 1.0)
        assert max(received.sizes()) <= 10.0 + 1e-9
        message = received.wrenches[-1]
        assert message.header.frame_id == "cautery_tip"
        assert message.wrench.torque.x == message.wrench.torque.y == 0.0
        page.mouse.up()
        received.until_zero(page)
        drag(page)
        received.until(page, lambda: max(received.sizes()[-20:]) > 1.0)
        other = browser.new_context(viewport={"width": 960, "height": 600}).new_page()
        context.close()
        received.until_zero(other)
        viewer = opened(browser.new_context(), server.view_url)
        drawn = viewer.locator("main.view").bounding_box()
        viewer.mouse.move(drawn["x"] + drawn["width"] / 2, drawn["y"] + drawn["height"] / 2)
        viewer.mouse.down()
        since = len(received.wrenches)
        received.until(viewer, lambda: len(received.wrenches) > since + 50)
        assert not any(received.sizes(since))
        assert viewer.locator("#hand").inner_text() == "An operator may drag the tool"


@pytest.mark.parametrize(
    "words",
    [
        ["view", "data/recorded_case", "--hand", TOPIC],
        ["view", "--live", "--config", "live.yaml", "--hand", TOPIC, "--render", "client"],
        ["simulate", "data/worlds/lumpectomy", "--hand", "page", "--with", "control"],
    ],
)
def test_hand_without_a_page_that_can_show_it_is_refused(words):
    assert "--hand is" in run(*words, status=2).err
