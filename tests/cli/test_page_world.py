"""A person edits a simulated world on the page, in Chromium: what is requested is what the physics
has, by its true poses, and comes back to the page."""

import signal

import numpy as np
import pytest
from playwright.sync_api import expect
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from app.bridge import RosNode
from app.bridge.calls.service_client import ServiceClient
from app.bridge.tf_poses import TfMessageReader
from app.bridge.topics import STREAM, Topic
from app.files.meshes import write_mesh
from app.geometry import SurfaceMesh, Transform
from app.robot.primitives import cone
from app.runtime import place_text
from tests.cli.edited_world import STONE_MM, TABLE_TOP_MM, write_edited_world
from tests.page_rules import violations
from tests.viewer.page_actions import press
from tests.viewer.pictures import picture
from tests.waiting import wait_until

pytestmark = pytest.mark.long

WORLD = "trame.state.get('world')"
SHELF_Z_MM, SHELF_MM = 60.0, 40.0


class Judge:
    """The true poses, as the simulation publishes them."""

    def __init__(self, ros):
        self._ros, self._read = ros, TfMessageReader()
        self.poses, self.messages = {}, 0
        ros.subscribe(Topic("/tf", TFMessage, STREAM), self._take, raw=True)

    def place(self, name):
        return self.poses[name].translation_mm

    def pause(self):
        ServiceClient(self._ros, Trigger, "/marginguard_simulation/pause").call(
            Trigger.Request(), 30.0
        )

    def _take(self, data):
        if b"truth/" not in data:
            return
        self.poses = {
            each.child.removeprefix("truth/"): Transform.from_quaternion(
                each.pose[3:], each.pose[:3], target="world", source="body"
            )
            for each in self._read(data)
        }
        self.messages += 1


class Editor:
    """The page of a person who edits the world."""

    def __init__(self, page, judge):
        self.page, self._judge = page, judge
        page.wait_for_selector("body:not([data-lost]) #world", timeout=60_000)
        self.until(lambda: len(self.rows()) == 5)
        for part in ("move", "add"):
            page.locator(f"#world-{part} summary").click()

    def rows(self):
        return {each["name"]: each for each in self.page.evaluate(f"() => {WORLD}.rows")}

    def request(self):
        return self.page.evaluate(f"() => {WORLD}.request")

    def until(self, condition):
        def state():
            return self.page.evaluate(f"() => {WORLD}"), self.answer()

        wait_until(condition, lambda: self.page.wait_for_timeout(50), describe=state)

    def answer(self):
        return self.page.locator("#world-answer").inner_text()

    def fill(self, **fields):
        for name, value in fields.items():
            self.page.fill(f"#world-{name}", str(value))

    def move(self, name, dx=0, dy=0, dz=0, turn=0):
        self.page.select_option("#world-body", name)
        self.fill(dx=dx, dy=dy, dz=dz, turn=turn)
        self.page.click("#world-move-confirm")
        self.until(lambda: self.request() is not None and f"move {name} to" in self.line())
        self.until(lambda: self.request()["outcome"] != "requested")

    def add(self, name, shape, place, **fields):
        self.page.select_option("#world-shape", shape)
        x, y, z = place
        self.fill(name=name, x=x, y=y, z=z, **fields)
        self.page.click("#world-add-confirm")
        self.until(lambda: self.line() == f"add {name} at {text_of(place)}: done")

    def line(self):
        request = self.request()
        return "" if request is None else request["line"]

    def is_at(self, name, place_mm, tolerance_mm=0.01):
        """True if a body is there in the physics and on the page."""
        rows = self.rows()
        return (
            name in self._judge.poses
            and name in rows
            and np.allclose(self._judge.place(name), place_mm, rtol=0.0, atol=tolerance_mm)
            and np.allclose(rows[name]["at"], place_mm, rtol=0.0, atol=tolerance_mm + 0.01)
        )


def text_of(place):
    return ", ".join(f"{each:.1f}" for each in place) + " mm"


@pytest.fixture
def judge(domain_id):
    with RosNode("judge", domain_id=domain_id) as ros:
        yield Judge(ros)


@pytest.fixture
def simulation(start, can_draw, project_root, tmp_path, judge):
    world = write_edited_world(project_root / "data" / "worlds" / "lumpectomy", tmp_path / "w")
    child = start("-m", "app.cli", "simulate", str(world), "--hand", "none", "--view")
    child.url = child.line(lambda line: line.startswith("view: http")).removeprefix("view: ")
    child.view_url = child.line(lambda line: "view only: " in line).rpartition("view only: ")[2]
    child.line(lambda line: line.startswith("SIMULATION"))
    return child


@pytest.fixture
def page(browser):
    context = browser.new_context(viewport={"width": 1100, "height": 700})
    yield context.new_page()
    context.close()


def test_edits_on_the_page_are_those_of_the_physics(simulation, page, judge, browser, tmp_path):
    page.goto(simulation.url)
    editor = Editor(page, judge)

    editor.move("chest_wall", dz=-12, turn=30)
    assert editor.request()["outcome"] == "done"
    editor.until(lambda: editor.is_at("chest_wall", (205, 0, 38)))
    turn = judge.poses["chest_wall"].rotation_vector
    np.testing.assert_allclose(np.degrees(turn), [0, 0, 30], atol=1e-6)

    for name, reason in (("tumor", "set_tumor alone"), ("cautery", "an arm moves it")):
        editor.move(name, dx=5)
        assert editor.request()["outcome"] == "refused"
        assert reason in page.locator("#world-request").inner_text()
    editor.move("stone", dz=-12)
    assert "overlaps 'table'" in editor.line()
    editor.until(lambda: editor.is_at("stone", (205, 150, TABLE_TOP_MM + STONE_MM / 2), 0.5))

    # An obstacle appears, and a stone that is let go above it comes to rest on it.
    shelf = (205, 150, SHELF_Z_MM)
    editor.add("shelf", "box", shelf, sx=SHELF_MM, sy=SHELF_MM, sz=SHELF_MM)
    editor.until(lambda: editor.is_at("shelf", shelf))
    assert editor.rows()["shelf"]["kind"] == "added body"
    editor.move("stone", dz=100)
    assert editor.request()["outcome"] == "done"
    on_shelf = (205, 150, SHELF_Z_MM + SHELF_MM / 2 + STONE_MM / 2)
    editor.until(lambda: editor.is_at("stone", on_shelf, 0.5))
    since = judge.messages
    editor.until(lambda: judge.messages > since + 200)
    assert editor.is_at("stone", on_shelf, 0.5)  # a second later
    press(page, "2")
    picture(page, "world_page", "#world")

    vertices, faces = cone(10.0, 30.0)
    write_mesh(tmp_path / "pin.stl", SurfaceMesh("pin", vertices, faces.astype(np.int32)))
    page.select_option("#world-shape", "file")
    page.set_input_files("#world-file", tmp_path / "pin.stl")
    editor.add("pin", "file", (205, -150, 30))
    editor.until(lambda: editor.is_at("pin", (205, -150, 30)))
    page.click("#world-add-confirm")
    editor.until(lambda: "the name is in use" in editor.line())

    dragged = drag_any(editor)
    assert editor.request()["outcome"] == "done"

    def is_where_asked():  # by the last line: under load an answer may come after the next drag
        asked = editor.line().partition(" to ")[2].removesuffix(": done")
        return place_text(judge.poses[dragged]) == editor.rows()[dragged]["place"] == asked

    editor.until(is_where_asked)

    # Without its shelf the stone falls to the table.
    page.select_option("#world-body", "shelf")
    page.click("#world-remove")
    editor.until(lambda: "shelf" not in judge.poses and "shelf" not in editor.rows())
    editor.until(lambda: judge.place("stone")[2] < SHELF_Z_MM - SHELF_MM / 2)

    assert violations(page) == []
    viewer = browser.new_context().new_page()
    viewer.goto(simulation.view_url)
    expect(viewer.locator("#bodies")).to_contain_text("pin")
    expect(viewer.locator(".world-tools")).to_have_count(0)

    judge.pause()
    expect(viewer.locator("#world .lamps")).to_contain_text("stale")
    viewer.context.close()
    assert simulation.end(signal.SIGINT) == 130


def drag_any(editor):
    """Drag the first fixed body in the picture that can be moved, with shift; its name."""
    page, before = editor.page, editor.line()
    box = page.locator("main.view").bounding_box()
    page.keyboard.down("Shift")
    for y in (0.55, 0.65, 0.75, 0.45, 0.85):
        for x in (0.5, 0.4, 0.6, 0.3, 0.7):
            page.mouse.move(box["x"] + x * box["width"], box["y"] + y * box["height"])
            page.mouse.down()
            page.mouse.move(box["x"] + x * box["width"], box["y"] + y * box["height"] - 20, steps=4)
            page.mouse.up()
            page.wait_for_timeout(300)
            if editor.line() == before:
                continue
            editor.until(lambda: editor.request()["outcome"] != "requested")
            name = editor.line().split()[1]
            if editor.request()["outcome"] == "done" and name != "stone":  # which falls
                page.keyboard.up("Shift")
                return name
            before = editor.line()  # the shelf under the stone cannot be raised
    raise AssertionError("no body was found in the picture")
