import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.geometry import Transform
from app.scene.frames.frame_graph import poses_in
from tests.scene.conftest import posed

pytestmark = pytest.mark.slow

FRAMES = [f"frame_{number}" for number in range(8)]


@given(st.lists(st.integers(0, 6), min_size=7, max_size=7), st.integers(0, 2**16), st.data())
def test_poses_of_a_tree_equal_the_products_of_its_edges(parents, seed, data):
    rng = np.random.default_rng(seed)
    world = [posed("world", f, rng.normal(size=3), rng.normal(size=3)) for f in FRAMES]
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
