"""A simulated world as a user sees it: its places, and what becomes of requests."""

import numpy as np
import pytest

from app.geometry import InputError, SurfaceMesh, Transform
from app.runtime import BodyKind, RequestOutcome, SimulatedWorld, WorldBody
from app.runtime.simulated_world import ANSWER_NS
from tests.manual_clock import ManualClock

EYE = np.eye(3)
MESH = SurfaceMesh("box", np.eye(3), np.array([[0, 1, 2]]))
MS = 1_000_000


class Owner:
    """A simulation that records the requests."""

    def __init__(self):
        self.requests, self.connected = [], True

    def is_connected(self):
        return self.connected

    def move(self, poses, stamp):
        self.requests.append(("move", *poses, stamp))

    def add(self, mesh, world_from_body, stamp):
        self.requests.append(("add", mesh, world_from_body, stamp))

    def remove(self, name, stamp):
        self.requests.append(("remove", name, stamp))


@pytest.fixture
def clock():
    return ManualClock(10 * ANSWER_NS)


@pytest.fixture
def owner():
    return Owner()


@pytest.fixture
def world(owner, clock):
    world = SimulatedWorld("world", "tracker", clock)
    world.connect(owner)
    kinds = {"wall": BodyKind.FIXED, "stone": BodyKind.FREE, "box": BodyKind.ADDED}
    world.set_bodies([WorldBody(name, kind, MESH) for name, kind in kinds.items()])
    world.set_places(places(), clock.ns)
    return world


def places(**moved):
    found = {name: (10.0 * n, 0, 0, 0, 0, 0, 1) for n, name in enumerate(("wall", "stone", "box"))}
    return found | moved


def outcome(world):
    return world.moment().request.outcome


def test_move_is_relative_to_the_pose_and_has_the_time_of_the_request(world, owner, clock):
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    world.move("stone", np.array([1.0, 2.0, 3.0]), quarter)
    kind, pose, stamp = owner.requests[0]
    assert (kind, pose.target, pose.source, stamp.ns) == ("move", "world", "stone", clock.ns)
    np.testing.assert_allclose(pose.translation_mm, [11, 2, 3])
    np.testing.assert_allclose(pose.rotation, quarter)
    assert outcome(world) is RequestOutcome.WAITING


def test_second_move_before_the_answer_begins_where_the_first_ends(world, owner):
    for _ in range(2):
        world.move("wall", np.array([5.0, 0.0, 0.0]), EYE)
    (_, first, before), (_, second, after) = owner.requests
    assert (first.translation_mm[0], second.translation_mm[0]) == (5.0, 10.0)
    assert after.ns > before.ns


def test_move_is_done_when_the_body_is_there(world, clock):
    world.move("wall", np.array([0.0, 0.0, 2.0]), EYE)
    for z_mm, expected in ((1.9, RequestOutcome.WAITING), (2.0, RequestOutcome.DONE)):
        world.set_places(places(wall=(0.0, 0.0, z_mm, 0, 0, 0, 1)), clock.ns)
        assert outcome(world) is expected


def test_late_refusal_of_a_move_that_is_too_small_to_be_seen_counts(world, clock):
    world.move("stone", np.array([0.0, 0.0, 0.1]), EYE)
    world.set_places(places(), clock.ns + 1)
    assert outcome(world) is RequestOutcome.DONE
    world.refused("body 'stone' overlaps 'wall' by 3.0 mm")
    assert outcome(world) is RequestOutcome.REFUSED


def test_free_body_may_fall_before_it_is_seen(world, clock):
    world.move("stone", np.array([0.0, 0.0, 50.0]), EYE)
    for x_mm, z_mm, expected in (
        (10, 0.5, RequestOutcome.WAITING),  # it has not moved
        (13, 49.0, RequestOutcome.WAITING),
        (10, 55.0, RequestOutcome.WAITING),
        (10, 30.0, RequestOutcome.DONE),
    ):
        world.set_places(places(stone=(x_mm, 0, z_mm, 0, 0, 0, 1)), clock.ns)
        assert outcome(world) is expected


@pytest.mark.parametrize("reason", ["body 'wall' overlaps 'stone'", "request: too many a second"])
def test_refusal_has_the_reason_of_the_simulation(world, reason):
    world.move("wall", np.zeros(3), EYE)
    world.refused("'tumor': tissue moves by itself")  # of another program
    assert outcome(world) is RequestOutcome.WAITING
    world.refused(reason)
    request = world.moment().request
    assert (request.outcome, request.reason) == (RequestOutcome.REFUSED, reason)


def test_request_without_effect_has_no_answer_until_it_has_one(world, clock):
    world.move("wall", np.array([5.0, 0.0, 0.0]), EYE)
    clock.ns += ANSWER_NS + 1
    assert outcome(world) is RequestOutcome.UNANSWERED
    world.refused("body 'wall' overlaps 'stone'")  # of a later request of another program
    assert outcome(world) is RequestOutcome.UNANSWERED
    world.set_places(places(wall=(5.0, 0, 0, 0, 0, 0, 1)), clock.ns)
    assert outcome(world) is RequestOutcome.DONE


def test_added_body_is_done_when_it_has_a_surface_and_a_place(world, owner, clock):
    world.add(MESH, Transform("world", "clip", EYE, np.array([1.0, 2.0, 3.0])))
    assert owner.requests[0][0] == "add"
    bodies = world.moment().bodies
    world.set_places(places(clip=(1, 2, 3, 0, 0, 0, 1)), clock.ns + 1)
    assert outcome(world) is RequestOutcome.WAITING
    world.set_bodies([*bodies, WorldBody("clip", BodyKind.ADDED, MESH)])
    assert outcome(world) is RequestOutcome.DONE


def test_only_an_added_body_is_removed(world, owner):
    with pytest.raises(InputError, match="fixed body; expected an added body"):
        world.remove("wall")
    world.remove("box")
    assert [each[:2] for each in owner.requests] == [("remove", "box")]
    world.set_bodies([each for each in world.moment().bodies if each.name != "box"])
    assert outcome(world) is RequestOutcome.DONE


def test_nothing_is_requested_without_a_simulation_or_a_place(world, owner):
    with pytest.raises(InputError, match="its place is not known"):
        world.move("ghost", np.zeros(3), EYE)
    owner.connected = False
    with pytest.raises(InputError, match="no simulation receives requests"):
        world.move("wall", np.zeros(3), EYE)
    assert owner.requests == []
    assert world.moment().request is None


def test_invalid_place_is_left_out(world, clock):
    world.set_places(places(wall=(float("nan"), 0, 0, 0, 0, 0, 1)), clock.ns)
    assert set(world.moment().poses) == {"stone", "box"}
