"""Compare paths and products with powers of the adjacency matrix and with poses in one world."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.geometry import Transform, chain_to_root, poses_in, product_along, shortest_path

FRAMES = [f"frame_{number}" for number in range(8)]


def placed(frame, rng):
    """A random pose in the world."""
    turn, place_mm = rng.normal(size=(2, 3))
    return Transform.from_rotation_vector(turn, place_mm, target="world", source=frame)


@given(st.lists(st.tuples(st.integers(0, 7), st.integers(0, 7)), max_size=12), st.data())
def test_path_has_the_fewest_edges_and_connects_its_ends(pairs, data):
    pairs = [pair for pair in pairs if pair[0] != pair[1]]
    near = np.eye(8, dtype=int)
    for target, source in pairs:
        near[target, source] = near[source, target] = 1
    start, goal = data.draw(st.integers(0, 7)), data.draw(st.integers(0, 7))
    reach = (count for count in range(8) if np.linalg.matrix_power(near, count)[start, goal])
    path = shortest_path([(FRAMES[a], FRAMES[b]) for a, b in pairs], FRAMES[start], FRAMES[goal])
    assert (None if path is None else len(path)) == next(reach, None)
    at = FRAMES[start]
    for edge in path or ():
        assert at in edge
        at = edge[1] if edge[0] == at else edge[0]
    assert path is None or at == FRAMES[goal]


def test_of_equal_paths_the_one_with_the_first_edges_is_used():
    edges = [("b", "a"), ("a", "c"), ("d", "c"), ("b", "d"), ("a", "b")]
    assert shortest_path(edges, "a", "d") == (("b", "a"), ("b", "d"))
    assert shortest_path(edges[1:], "a", "d") == (("a", "c"), ("d", "c"))


@given(st.integers(0, 2**16), st.lists(st.booleans(), max_size=7))
def test_product_walks_edges_in_both_directions(seed, turned):
    rng = np.random.default_rng(seed)
    world = [placed(frame, rng) for frame in FRAMES]
    path = []
    for number, backwards in enumerate(turned):
        edge = world[number].inverse() @ world[number + 1]
        path.append(edge.inverse() if backwards else edge)
    found = product_along(FRAMES[0], path)
    expected = world[0].inverse() @ world[len(turned)]
    assert (found.target, found.source) == (FRAMES[0], FRAMES[len(turned)])
    assert np.allclose(found.matrix, expected.matrix, atol=1e-9)


@given(st.lists(st.integers(0, 6), min_size=7, max_size=7), st.integers(0, 2**16), st.data())
def test_poses_of_a_tree_equal_the_products_of_its_edges(parents, seed, data):
    rng = np.random.default_rng(seed)
    world = [placed(frame, rng) for frame in FRAMES]
    edges = []
    for child, parent in enumerate(parents, start=1):
        edge = world[parent % child].inverse() @ world[child]
        edges.append(edge.inverse() if data.draw(st.booleans()) else edge)
    order = data.draw(st.permutations(edges))
    root = data.draw(st.sampled_from(FRAMES))
    poses = poses_in(root, order)
    assert set(poses) == set(FRAMES)
    for frame, pose in poses.items():
        expected = world[FRAMES.index(root)].inverse() @ world[FRAMES.index(frame)]
        assert (pose.target, pose.source) == (root, frame)
        assert np.allclose(pose.matrix, expected.matrix, atol=1e-9)


def test_unconnected_frame_has_no_pose():
    edges = [Transform.identity("a", "b"), Transform.identity("c", "d")]
    assert set(poses_in("a", edges)) == {"a", "b"}
    assert set(poses_in("nowhere", edges)) == {"nowhere"}


@pytest.mark.parametrize("later", [("a", "b"), ("b", "a")])
def test_later_of_two_edges_between_the_same_frames_is_used(later):
    first = Transform("a", "b", np.eye(3), np.array([1.0, 0.0, 0.0]))
    second = Transform(*later, np.eye(3), np.array([5.0, 0.0, 0.0]))
    expected = 5.0 if later == ("a", "b") else -5.0
    assert poses_in("a", [first, second])["b"].translation_mm[0] == expected


def test_chain_ends_at_the_root():
    assert chain_to_root("c", {"c": "b", "b": "a"}.get) == ["c", "b", "a"]
    assert chain_to_root("x", {}.get) == ["x"]
