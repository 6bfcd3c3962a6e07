"""Markers of other nodes as bodies: larger than the ideal shapes, or a reason to plan nothing."""

import math

import numpy as np
import pytest
import trimesh
from geometry_msgs.msg import Point, Quaternion
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from app.bridge import RosNode
from app.bridge.message_origin import Origin
from app.bridge.obstacles import MAX_OBSTACLES, Obstacles, obstacle_of
from app.bridge.tf_topics import tf_message
from app.bridge.topics import INCOMING_TF, LATCHED, STATIC_TF, STREAM, TF, TF_STATIC, Topic
from app.geometry import (
    NS_PER_MS,
    FrameError,
    InputError,
    MarginGuardError,
    Stamp,
    SurfaceMesh,
    Transform,
)
from tests.bridge.nodes import ros_nodes
from tests.waiting import wait_until

pytestmark = pytest.mark.slow


def marker(kind=Marker.CUBE, number=0, scale=(0.02, 0.03, 0.04), points=(), **changes):
    made = Marker(ns="box", id=number, type=kind, action=Marker.ADD)
    made.header.frame_id = "tracker"
    made.pose.position.x = 0.1
    made.pose.orientation = Quaternion(w=math.sqrt(0.5), z=math.sqrt(0.5))
    made.scale.x, made.scale.y, made.scale.z = scale
    made.points = [Point(x=x, y=y, z=z) for x, y, z in points]
    for name, value in changes.items():
        setattr(made, name, value)
    return made


def corners(shape):
    return np.asarray(shape.triangles).reshape(-1, 3).tolist()


def ideal_points(kind, rng):
    """Points of the shape of size 1, (n, 3)."""
    directions = rng.normal(size=(2000, 3))
    if kind == Marker.SPHERE:
        return 0.5 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    if kind == Marker.CUBE:
        return rng.uniform(-0.5, 0.5, size=(2000, 3))
    sides = directions[:, :2] / np.linalg.norm(directions[:, :2], axis=1, keepdims=True)
    return np.column_stack([0.5 * sides, rng.uniform(-0.5, 0.5, 2000)])


@pytest.mark.parametrize("kind", [Marker.SPHERE, Marker.CUBE, Marker.CYLINDER])
def test_surface_contains_the_ideal_shape_and_little_more(kind):
    name, surface, _ = obstacle_of("box/0", marker(kind))
    assert (name, surface.frame) == ("box/0", "tracker")
    size_mm = np.array([20.0, 30.0, 40.0])
    x, y, z = (ideal_points(kind, np.random.default_rng(2)) * size_mm).T
    placed = np.column_stack([100.0 - y, x, z])  # by a quarter turn
    first, second, third = np.moveaxis(surface.triangles_mm, 1, 0)
    normals = np.cross(second - first, third - first)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    heights = placed @ normals.T - (normals * first).sum(axis=1)
    assert heights.max() < 1e-9
    ideal_mm3 = {Marker.SPHERE: math.pi / 6.0, Marker.CUBE: 1.0, Marker.CYLINDER: math.pi / 4.0}
    assert 1.0 <= surface.signed_volume_mm3 / (ideal_mm3[kind] * size_mm.prod()) + 1e-9 < 1.01


def test_triangles_are_placed_and_scaled():
    ball = trimesh.creation.icosphere(2, 0.01)
    _, surface, _ = obstacle_of(
        "a", marker(Marker.TRIANGLE_LIST, scale=(1, 1, 2), points=corners(ball))
    )
    assert surface.signed_volume_mm3 == pytest.approx(2.0 * ball.volume * 1e9)
    np.testing.assert_allclose(surface.vertices_mm.mean(axis=0), [100.0, 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"scale": (0.1, math.nan, 0.1)}, r"scale is .*nan.* m; expected numbers above 0"),
        ({"scale": (0.1, 0.0, 0.1)}, "expected numbers above 0"),
        ({"scale": (1e300, 1.0, 1.0)}, "expected numbers above 0"),
        ({"scale": (30.0, 1.0, 1.0)}, "is farther than 10 m from its frame"),
        ({"kind": Marker.ARROW}, "type is 0; expected SPHERE, CUBE, CYLINDER or TRIANGLE_LIST"),
        ({"action": 7}, "action is 7; expected ADD, DELETE or DELETEALL"),
        ({"kind": Marker.TRIANGLE_LIST}, "has 0 points; expected finite corners"),
        (
            {"kind": Marker.TRIANGLE_LIST, "points": [[0.0, 0.0, math.inf]] * 3},
            "expected finite corners",
        ),
        (
            {"kind": Marker.TRIANGLE_LIST, "points": corners(trimesh.creation.box())[3:]},
            "is not closed",
        ),
        (
            {"kind": Marker.TRIANGLE_LIST, "points": corners(trimesh.creation.box())[::-1]},
            "expected a positive volume",
        ),
    ],
)
def test_marker_that_is_no_body_is_refused(changes, problem):
    with pytest.raises(MarginGuardError, match=problem):
        obstacle_of("box/0", marker(**changes))


def test_marker_without_a_place_is_refused():
    for change, problem in (
        (lambda made: setattr(made.header, "frame_id", ""), "has no frame_id"),
        (lambda made: setattr(made.pose, "orientation", Quaternion(w=0.0)), "quaternion"),
        (lambda made: setattr(made.pose.position, "x", math.nan), "finite"),
    ):
        made = marker()
        change(made)
        with pytest.raises(MarginGuardError, match=problem):
            obstacle_of("box/0", made)


@pytest.fixture
def nodes(domain_id):
    with ros_nodes(domain_id, "marginguard_plan", "camera") as (ros, peer):
        yield ros, peer


def sender(peer, qos, count):
    publisher = peer.publisher(Topic("/marginguard_plan/obstacles", MarkerArray, qos))
    wait_until(lambda: publisher.get_subscription_count() >= count)
    return lambda *markers: publisher.publish(MarkerArray(markers=list(markers)))


def names(obstacles):
    return [each.name for each in obstacles.current()]


def test_obstacles_change_until_they_are_deleted(nodes):
    ros, peer = nodes
    obstacles = Obstacles(ros)
    send = sender(peer, INCOMING_TF, 1)
    send(marker(), marker(number=1))
    wait_until(lambda: names(obstacles) == ["box/0", "box/1"])
    revision = obstacles.revision
    later = marker()
    later.header.stamp.sec = 7
    send(later)  # the same body
    send(marker(number=1, action=Marker.DELETE))
    wait_until(lambda: names(obstacles) == ["box/0"])
    assert obstacles.revision == revision + 1
    send(marker(scale=(0.1, 0.1, 0.1)))
    wait_until(lambda: np.ptp(obstacles.current()[0].surface.vertices_mm[:, 2]) > 99.0)
    send(marker(number=2, scale=(0.0, 1.0, 1.0)))
    wait_until(lambda: obstacles.revision == revision + 3)
    with pytest.raises(InputError, match=r"obstacle 'box/2': scale is .*; expected numbers above"):
        obstacles.current()
    send(marker(number=2, scale=(0.0, 1.0, 1.0)))  # changes nothing
    send(marker(number=2))
    wait_until(lambda: obstacles.revision == revision + 4)
    assert names(obstacles) == ["box/0", "box/2"]
    send(*[marker(number=each) for each in range(MAX_OBSTACLES + 1)])
    wait_until(lambda: obstacles.revision == revision + 5)
    with pytest.raises(InputError, match=f"are more than {MAX_OBSTACLES}; expected fewer"):
        obstacles.current()
    send(Marker(action=Marker.DELETEALL))
    wait_until(lambda: obstacles.revision == revision + 6)
    assert obstacles.current() == []


def test_deletion_is_of_its_namespace_and_sender(nodes, domain_id):
    ros, peer = nodes
    obstacles = Obstacles(ros)
    send = sender(peer, STREAM, 1)
    send(marker(ns="spine"), marker(ns="table"), Marker(ns="spine", action=Marker.DELETEALL))
    wait_until(lambda: names(obstacles) == ["table/0"])
    with RosNode("second", domain_id=domain_id) as second:
        other = sender(second, STREAM, 1)
        other(marker(ns="table", scale=(0.1, 0.1, 0.1)), marker(ns="other"))
        wait_until(lambda: names(obstacles) == ["table/0", "table/0 (2)", "other/0"])
        first, replaced, _ = obstacles.current()
        assert np.ptp(first.surface.vertices_mm[:, 2]) == pytest.approx(40.0)
        assert np.ptp(replaced.surface.vertices_mm[:, 2]) == pytest.approx(100.0)
        send(marker(ns="other", action=Marker.DELETE))
        send(Marker(action=Marker.DELETEALL), marker(number=1))
        wait_until(lambda: names(obstacles) == ["table/0", "other/0", "box/1"])


def test_obstacles_of_a_sender_that_has_left_stay_until_another_deletes_them(nodes, domain_id):
    ros, peer = nodes
    obstacles = Obstacles(ros)
    with RosNode("second", domain_id=domain_id) as second:
        sender(second, STREAM, 1)(marker(), marker(ns="other"))
        wait_until(lambda: names(obstacles) == ["box/0", "other/0"])
    wait_until(lambda: ros.node.count_publishers("/marginguard_plan/obstacles") == 0)
    send = sender(peer, STREAM, 1)
    send(marker(), marker(ns="other", action=Marker.DELETE))
    wait_until(lambda: names(obstacles) == ["box/0", "box/0 (2)"])
    send(Marker(action=Marker.DELETEALL))
    wait_until(lambda: names(obstacles) == [])


def test_burst_is_received_by_a_busy_node(nodes):
    ros, peer = nodes
    obstacles = Obstacles(ros)
    send = sender(peer, STREAM, 1)
    with obstacles._lock:
        for number in range(MAX_OBSTACLES):
            send(marker(number=number))
    wait_until(lambda: len(names(obstacles)) == MAX_OBSTACLES)


def test_lost_message_forbids_plans_until_all_is_deleted(nodes):
    ros, _ = nodes
    obstacles = Obstacles(ros)

    def take(number, *markers, source=b"a", is_latched=False):
        data = serialize_message(MarkerArray(markers=list(markers)))
        obstacles._take(data, Origin(source, number), is_latched=is_latched)

    take(5, marker())
    take(6)
    for number in (4, 5, 6, 7):  # again, by the subscription for latched messages
        take(number, marker(number=number), is_latched=True)
    take(2, source=b"b")
    assert len(names(obstacles)) == 5
    take(10, marker(number=10))
    with pytest.raises(InputError, match="2 messages are lost; expected all, after a DELETEALL"):
        obstacles.current()
    take(11, Marker(ns="box", action=Marker.DELETEALL))
    with pytest.raises(InputError, match="are lost"):
        obstacles.current()
    take(12, Marker(action=Marker.DELETEALL), marker())
    assert names(obstacles) == ["box/0"]


def test_latched_deletion_of_before_keeps_later_obstacles_of_others(nodes, domain_id):
    ros, peer = nodes
    obstacles = Obstacles(ros)
    send = sender(peer, STREAM, 1)
    send(marker())
    wait_until(lambda: names(obstacles) == ["box/0"])
    with RosNode("second", domain_id=domain_id) as second:
        old = sender(second, LATCHED, 1)
        old(Marker(action=Marker.DELETEALL), marker(ns="old"))
        wait_until(lambda: names(obstacles) == ["box/0", "old/0"])
        wait_until(lambda: ros.node.count_subscribers("/marginguard_plan/obstacles") == 2)
        send(marker(number=1))
        wait_until(lambda: sorted(names(obstacles)) == ["box/0", "box/1", "old/0"])


def test_latched_obstacles_of_before_are_received(nodes):
    ros, peer = nodes
    send = sender(peer, STATIC_TF, 0)
    send(marker())
    obstacles = Obstacles(ros)
    wait_until(lambda: names(obstacles) == ["box/0"])
    send(marker(number=1))
    wait_until(lambda: names(obstacles) == ["box/0", "box/1"])


def test_sender_whose_obstacles_may_be_lost_forbids_plans(nodes):
    ros, peer = nodes
    obstacles = Obstacles(ros)
    assert obstacles.revision == 0
    qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = peer.node.create_publisher(MarkerArray, "/marginguard_plan/obstacles", qos)

    def problem():
        try:
            return obstacles.current()
        except InputError as error:
            return str(error)

    wait_until(lambda: "node /camera sends with best effort; expected reliable" in str(problem()))
    wait_until(lambda: obstacles.revision == 1)  # which a motion tests
    peer.node.destroy_publisher(publisher)
    wait_until(lambda: obstacles.revision == 2)
    assert obstacles.current() == []


def test_frame_of_a_locked_obstacle_is_the_newest_in_tf_and_never_an_old_one(nodes):
    ros, peer = nodes
    now_ns = [5_000 * NS_PER_MS]
    obstacles = Obstacles(ros, clock_ns=lambda: now_ns[0])
    stand = obstacle_of("stand/0", marker(frame_locked=True))
    assert (stand.follows_tf, obstacle_of("box/0", marker()).follows_tf) == (True, False)
    with pytest.raises(FrameError, match=r"'stand/0': .*; expected the frame in tf"):
        obstacles.tf_pose(stand, "room")

    def publish(publisher, target, source, x_mm, at_ms):
        pose = Transform(target, source, np.eye(3), [x_mm, 0.0, 0.0])
        publisher.publish(tf_message([(pose, Stamp(at_ms * NS_PER_MS))]))

    def place():
        try:
            return obstacles.tf_pose(stand, "room").translation_mm[0]
        except FrameError as error:
            return str(error)

    sender(peer, STREAM, 1)(marker(frame_locked=True))  # from then on tf is received
    moving, static = peer.publisher(TF), peer.publisher(TF_STATIC)
    wait_until(lambda: moving.get_subscription_count() and static.get_subscription_count())
    publish(static, "wall", "tracker", 1.0, 0)
    publish(moving, "room", "wall", 10.0, 4_800)
    wait_until(lambda: place() == 11.0)
    publish(moving, "room", "wall", 20.0, 4_900)
    wait_until(lambda: place() == 21.0)
    for at_ms, age_ms in ((5_101, 201), (4_899, -1)):
        now_ns[0] = at_ms * NS_PER_MS
        assert place() == (
            f"obstacle 'stand/0': frame 'tracker' is {age_ms} ms old in tf; expected 0 to 200 ms"
        )


def test_no_point_of_an_obstacle_moves_farther_than_a_corner_of_its_box():
    rng = np.random.default_rng(3)
    surface = SurfaceMesh("stand", rng.normal(size=(60, 3)), [[0, 1, 2]])
    turn = Transform.from_quaternion(
        np.array([0.1, 0.2, 0.3, 0.9]) / np.linalg.norm([0.1, 0.2, 0.3, 0.9]),
        [1.0, 0.0, 0.0],
        target="room",
        source="stand",
    )
    points, corners = surface.vertices_mm, surface.box_corners_mm
    farthest = np.linalg.norm(turn.apply(corners) - corners, axis=1).max()
    assert np.linalg.norm(turn.apply(points) - points, axis=1).max() < farthest
