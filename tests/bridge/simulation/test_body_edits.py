"""Edits of bodies over ROS against a world that the test steps."""

import math
import time

import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

from app.bridge.simulation import NODE_NAME
from app.bridge.simulation.world_bodies import MAX_MOVES
from app.bridge.tf_poses import TfMessageReader
from app.bridge.topics import STREAM, Topic
from app.bridge.world_client import TRUTH, WORLD, WorldEditor
from app.files.meshes import write_mesh
from app.geometry import NS_PER_S, Stamp, SurfaceMesh, Transform
from app.simulation import open_world
from tests.bridge.nodes import ros_nodes
from tests.bridge.simulation.stepped_world import SteppedWorld, at, cube
from tests.waiting import wait_until

pytestmark = pytest.mark.slow

CUBE = cube("cube")


class Edited(SteppedWorld):
    """The shipped world with its node, and a scene's node that edits it."""

    def __init__(self, ros, scene, description, body="tumor"):
        super().__init__(ros, description, use_hand=False)
        self.refused, self.truth = [], {}
        self.editor = WorldEditor(scene, NODE_NAME, self.refused.append)
        read = TfMessageReader()

        def take(data):
            self.truth |= {each.child: each.pose for each in read(data)}

        scene.subscribe(Topic("/tf", TFMessage, STREAM), take, raw=True)
        self.until(self.editor.is_connected)
        self.until(self.refusals_are_received)
        self.until(lambda: TRUTH + body in self.truth)

    def until(self, condition):
        """Step the world until the condition holds."""
        wait_until(
            condition, self.step, pause_s=0.001, describe=lambda: (self.refused, sorted(self.truth))
        )


def world_of_cubes(folder, count):
    write_mesh(folder / "cube.stl", CUBE)
    bodies = "".join(
        f"  - {{name: body{number}, motion: fixed, position_mm: [0, {60 * number}, 0], "
        "mesh: {path: cube.stl, units: mm}}\n"
        for number in range(count)
    )
    (folder / "world.yaml").write_text(f"schema: 1\nname: edits\nseed: 1\nbodies:\n{bodies}")
    return open_world(folder)


def now():
    return Stamp(time.time_ns())


@pytest.fixture
def edited(domain_id, project_root):
    description = open_world(project_root / "data" / "worlds" / "lumpectomy")
    with ros_nodes(domain_id, NODE_NAME, "scene") as (ros, scene):
        yield Edited(ros, scene, description)


def test_moved_body_comes_back_as_truth_and_the_arm_goes_on(edited):
    edited.editor.move([at("chest_wall", 205, 0, 40)], now())
    edited.until(lambda: edited.truth[f"{TRUTH}chest_wall"][2] == pytest.approx(40.0))
    assert edited.world.state().bodies["chest_wall"].translation_mm[2] == pytest.approx(40.0)
    assert edited.arm.fault == ""
    assert edited.refused == []


def test_added_body_appears_and_can_be_moved_and_removed(edited):
    edited.editor.add(cube("clip"), at("clip", 205, 200, 80), now())
    edited.until(lambda: f"{TRUTH}clip" in edited.truth)
    assert edited.arm.fault == "body 'clip' was added"
    edited.editor.move([at("clip", 215, 200, 80)], now())
    edited.until(lambda: edited.truth[f"{TRUTH}clip"][0] == pytest.approx(215.0))
    edited.editor.remove("clip", now())
    edited.until(lambda: "clip" not in edited.world.state().bodies)
    assert edited.arm.fault == "body 'clip' was removed"
    assert edited.refused == []


REFUSED = (
    (lambda e: e.move([at("tumor", 0)], now()), "set_tumor alone"),
    (lambda e: e.move([at("cautery", 0)], now()), "an arm moves it"),
    (lambda e: e.move([at("ghost", 0)], now()), "'ghost': no such body"),
    (lambda e: e.move([at("chest_wall", 0, frame="tracker")], now()), "frame 'tracker'"),
    (lambda e: e.move([at("chest_wall", 2e4)], now()), "at most 10000 mm from the origin"),
    (lambda e: e.move([at("chest_wall", 1)], Stamp(time.time_ns() - 3 * NS_PER_S)), "old"),
    (lambda e: e.move([at("chest_wall", 1)], Stamp(time.time_ns() + 3 * NS_PER_S)), "future"),
    (lambda e: e.move([at("chest_wall", 1)] * 2, now()), "named twice"),
    (
        lambda e: e.move([at(f"b{n}", 1) for n in range(MAX_MOVES + 1)], now()),
        f"{MAX_MOVES + 1} places; expected 1 to {MAX_MOVES}",
    ),
    (lambda e: e.add(cube("tumor"), at("tumor", 0), now()), "the name is in use"),
    (lambda e: e.add(cube("x"), at("x", 0, frame="y"), now()), "frame 'y'"),
    (
        lambda e: e.add(
            SurfaceMesh("x", CUBE.vertices_mm, np.tile(CUBE.faces, (500, 1))),
            at("x", 0, 300),
            now(),
        ),
        "18000 points; expected three for each of 1 to 5000 triangles",
    ),
    (lambda e: e.remove("tumor", now()), "'tumor' cannot be removed"),
)
"""Requests, and a part of the reason why each is refused."""


def test_refused_edits_are_answered_and_change_nothing(edited):
    before = edited.world.state().bodies["chest_wall"].matrix
    for send, problem in REFUSED:
        edited.refused.clear()
        send(edited.editor)
        edited.until(lambda: edited.refused)
        assert problem in edited.refused[0]
    after = edited.world.state().bodies
    assert set(after) == {"cautery", "chest_wall", "tumor"}
    np.testing.assert_allclose(after["chest_wall"].matrix, before, atol=1e-9)
    assert edited.arm.fault == ""


def test_body_may_not_be_placed_in_the_tool(edited):
    tip = edited.world.state().bodies["cautery"].translation_mm
    edited.editor.add(cube("x"), at("x", *tip), now())
    edited.until(lambda: edited.refused)
    assert "body 'x' overlaps 'cautery'" in edited.refused[0]
    assert "x" not in edited.world.state().bodies


def test_numbers_that_are_not_finite_are_refused(edited):
    """`Transform` refuses them, so the message is written without it."""
    from app.bridge.tf_poses import TfSample, write_tf_message

    for place in ((math.nan, 0, 0, 0, 0, 0, 1), (0, 0, 0, 0, 0, 0, 0), (0, 0, 0, 1, 1, 1, 1)):
        count = len(edited.refused)
        message = write_tf_message([TfSample("world", "chest_wall", time.time_ns(), place)])
        edited.editor._moves.publish(message)
        edited.until(lambda count=count: len(edited.refused) > count)
    assert edited.x("chest_wall") == pytest.approx(205.0)


def test_edit_that_is_not_later_than_the_last_one_is_refused(edited):
    stamp = now()
    edited.editor.move([at("chest_wall", 205, 0, 45)], stamp)
    edited.until(lambda: edited.truth[f"{TRUTH}chest_wall"][2] == pytest.approx(45.0))
    edited.editor.move([at("chest_wall", 205, 0, 30)], stamp)
    edited.until(lambda: edited.refused)
    assert "not later than the last one" in edited.refused[0]
    assert edited.world.state().bodies["chest_wall"].translation_mm[2] == pytest.approx(45.0)


def test_flood_of_requests_is_refused(edited):
    sent = iter(range(10**6))

    def is_refused():
        for _ in range(40):
            edited.editor.move([at("chest_wall", 205, 0, 50 + 1e-5 * next(sent))], now())
        return any("too many" in each or "wait" in each for each in edited.refused)

    edited.until(is_refused)
    assert edited.arm.fault == ""


def test_nodes_of_26_bodies_that_a_user_moves_come_back_from_the_physics(domain_id, tmp_path):
    import slicer

    from app.scene.convert import vtk_matrix
    from app.scene.simulated_bodies import EditedWorld

    count = 26
    with ros_nodes(domain_id, NODE_NAME, "scene") as (ros, node):
        edited = Edited(ros, node, world_of_cubes(tmp_path, count), "body0")
        scene = EditedWorld(
            slicer.vtkMRMLScene(),
            WORLD,
            edited.editor.move,
            edited.refused.append,
            clock_ns=time.time_ns,
        )

        def has_shown(x):
            """Show what has arrived; True if the physics has every body there."""
            poses = [
                Transform.from_quaternion(
                    pose[3:], pose[:3], target=WORLD, source=child.removeprefix(TRUTH)
                )
                for child, pose in edited.truth.copy().items()
                if child.startswith(TRUTH)
            ]
            scene.show(poses, time.time_ns())
            places = [pose.translation_mm[0] for pose in poses]
            return len(places) == count and places == pytest.approx([x] * count, abs=1e-6)

        edited.until(lambda: has_shown(0.0))
        for number in range(1, 11):
            for body in range(count):
                pose = at(f"body{body}", 0.1 * number, 60.0 * body, frame=WORLD)
                scene.node(f"body{body}").SetMatrixTransformToParent(vtk_matrix(pose))
            assert scene.send() == count
            edited.until(lambda x=0.1 * number: has_shown(x))
        assert edited.refused == []
