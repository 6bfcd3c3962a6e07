"""A person drags the simulated tool into the tumour with the mouse on the page, in Chromium."""

import shutil
import signal
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from playwright.sync_api import TimeoutError as PlaywrightTimeout
from rclpy.serialization import deserialize_message
from tf2_msgs.msg import TFMessage

from app.bridge import RosNode
from app.bridge.tf_poses import TfMessageReader
from app.bridge.topics import STREAM, Topic
from app.fixture import ProximityEngine
from app.geometry import Transform
from benchmarks.closed_loop.loop_operator import Operator
from benchmarks.closed_loop.truth import Surfaces
from tests.viewer.page_actions import choose
from tests.viewer.pictures import capture

pytestmark = pytest.mark.long

SIZE = {"width": 1000, "height": 700}
"""A small page: two cores draw it, simulate and show it in a browser."""

STOP_MM = 1.0
NEAR_MM = 8.0
"""The tool is at its plane: the stop margin, and what age and errors of the poses add to it."""

PUSH_N = 3.0
FROM_THE_SIDE = """trame.state.get('look') === 'Side' && trame.state.get('orientation').letters
    .some((each) => each.letter === 'R' && Math.hypot(each.x, each.y) < 0.05)"""
LIMIT_S = 240.0


class Judge(Operator):
    """The operator, who re-arms what stands, and the true poses and forces, as bytes."""

    def __init__(self, ros):
        super().__init__(ros)
        self.truth, self.wrenches = [], []
        ros.subscribe(Topic("/tf", TFMessage, STREAM), self._take_tf, raw=True)
        topic = Topic("/arm/body/measured_cf", WrenchStamped, STREAM)
        ros.subscribe(topic, self.wrenches.append, raw=True)
        surfaces = Surfaces.shipped()
        self._surfaces = surfaces
        self._engine = ProximityEngine(surfaces.tumor, surfaces.tool)

    def distances_mm(self, since=0):
        """True distance of tool and tumour at each pose."""
        poses = [tumor_from_tool(data) for data in self.truth[since:]]
        return np.array([self._engine.evaluate(pose).signed_distance_mm for pose in poses])

    def by_libigl_mm(self, index):
        """The same at one pose, by libigl from the vertices of both surfaces: an upper bound."""
        return self._surfaces.lowest_vertex_mm([tumor_from_tool(self.truth[index])])

    def force_n(self, last=1):
        """Largest force of the hand in its last messages."""
        found = [deserialize_message(each, WrenchStamped).wrench for each in self.wrenches[-last:]]
        return max(np.linalg.norm([w.force.x, w.force.y, w.force.z]) for w in found)

    def _take_tf(self, data):
        if b"truth/tumor" in data:
            self.truth.append(data)


def tumor_from_tool(data):
    names = {"truth/tumor": "tumor", "truth/cautery": "tool"}
    poses = {
        names[each.child]: Transform.from_quaternion(
            each.pose[3:], each.pose[:3], target="world", source=names[each.child]
        )
        for each in TfMessageReader()(data)
        if each.child in names
    }
    return poses["tumor"].inverse() @ poses["tool"]


class Mouse:
    """The mouse of a person who looks at the page from the side, and pulls the tip to a place."""

    def __init__(self, page):
        self.page = page
        page.locator("button", has_text="Side").click()
        self._wait_for(FROM_THE_SIDE)  # the tip above, the tumour below it
        self.box = page.locator("main.view").bounding_box()
        while page.evaluate("trame.state.get('look') === 'Side'"):  # a covered page has no mouse
            page.mouse.click(*self._pixel((90.0, 50.0)))  # the camera no longer follows the tip
            page.wait_for_timeout(200)
        self._target = self._pixel((50.0, 77.0))  # on the tumour

    def press_on(self):
        """Grip the tool where it is not held, and pull its tip to the tumour.

        A press may miss: a picture may be older than the tool, and a busy page may have been silent
        for longer than a hand may be.
        """
        hand = self.page.evaluate("() => trame.state.get('hand')")
        if hand is None or hand["pulled"] is not None:
            return
        self.page.mouse.up()
        self.page.mouse.move(*self._pixel(hand["tip"]))
        self.page.mouse.down()
        self.page.mouse.move(*self._target, steps=5)
        with suppress(PlaywrightTimeout):
            held = "() => (trame.state.get('hand') || {}).pulled"
            self.page.wait_for_function(held, timeout=3000)

    def _wait_for(self, value):
        """Wait until the value in the page is true, and return it."""
        return self.page.wait_for_function(f"() => {value}", timeout=60_000).json_value()

    def _pixel(self, percent):
        x, y = percent
        return (
            self.box["x"] + x / 100.0 * self.box["width"],
            self.box["y"] + y / 100.0 * self.box["height"],
        )


@pytest.fixture
def judge(domain_id):
    with RosNode("judge", domain_id=domain_id) as ros:
        yield Judge(ros)


@pytest.fixture
def world(project_root, tmp_path):
    """The shipped world, for two cores that also draw a page and run a browser: coarser steps of
    the physics, and poses that may be 300 ms old, which the margin counts."""
    folder = Path(shutil.copytree(project_root / "data" / "worlds" / "lumpectomy", tmp_path / "w"))
    file = folder / "world.yaml"
    file.write_text(file.read_text().replace("seed: 20\n", "seed: 20\nphysics: {timestep_ms: 2}\n"))
    live = folder / "live.yaml"
    live.write_text(live.read_text().replace("stale_after_ms: 100", "stale_after_ms: 300"))
    return folder


def test_mouse_drags_the_tool_to_the_plane_and_not_further(start, browser, can_draw, judge, world):
    words = ("simulate", str(world), "--with", "live", "--with", "control", "--view")
    group = start("-m", "app.cli", *words)
    url = group.line(lambda line: line.startswith("view: http")).removeprefix("view: ")
    group.line(lambda line: line.startswith("SIMULATION"))
    context = browser.new_context(viewport=SIZE)
    page = context.new_page()
    page.goto(url)
    page.wait_for_selector("body:not([data-lost]) #grip", timeout=60_000)
    choose(page, "operate")
    mouse = Mouse(page)
    distances, pressed = np.zeros(0), 0
    end_s = time.monotonic() + LIMIT_S
    while pressed < 20:  # the hand presses on at the plane
        assert time.monotonic() < end_s, (distances[-20:], judge.texts())
        judge.rearm()
        mouse.press_on()
        page.wait_for_timeout(100)
        distances = np.append(distances, judge.distances_mm(len(distances)))
        if len(distances) and distances[-1] < NEAR_MM and judge.force_n() > PUSH_N:
            pressed += 1
            if pressed == 10:
                capture(page, "hand_page")
    page.mouse.up()
    sent = len(judge.wrenches)
    while len(judge.wrenches) < sent + 100 or judge.force_n(20) > 0.0:
        assert time.monotonic() < end_s + LIMIT_S
        page.wait_for_timeout(50)
    distances = judge.distances_mm()
    lowest = int(np.argmin(distances))
    assert distances[0] > 30.0
    assert distances[lowest] >= STOP_MM
    assert judge.by_libigl_mm(lowest) > distances[lowest] - 0.05
    context.close()
    assert group.end(signal.SIGINT) == 130
