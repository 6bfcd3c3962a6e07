"""Compare the transform buffer with a brute-force implementation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.bridge.ros_errors import (
    TfConnectivityError,
    TfExtrapolationError,
    TfInvalidError,
    TfLookupError,
)
from app.bridge.tf import TransformBuffer
from app.geometry import NS_PER_S, FrameError
from tests.oracles.transform_tree import BruteForceTree

pytestmark = pytest.mark.slow

IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def pose(rng):
    quaternion = rng.normal(size=4)
    return (*rng.normal(scale=100.0, size=3), *(quaternion / np.linalg.norm(quaternion)))


@st.composite
def trees(draw):
    """Forests of up to 8 frames with random samples in random order."""
    count = draw(st.integers(2, 8))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    edges = []
    for child in range(1, count):
        parent = draw(st.integers(-1, child - 1))
        if parent < 0:
            continue
        stamps = draw(st.lists(st.integers(0, 900_000_000), min_size=1, max_size=6))
        edges += [(f"f{parent}", f"f{child}", stamp, pose(rng)) for stamp in stamps]
    order = draw(st.permutations(range(len(edges))))
    return [edges[i] for i in order], [f"f{i}" for i in range(count)]


@settings(max_examples=80)
@given(trees(), st.data())
def test_lookup_agrees_with_brute_force(tree, data):
    edges, names = tree
    buffer, brute = TransformBuffer(), BruteForceTree()
    for edge in edges:
        buffer.insert(*edge)
        brute.insert(*edge)
    known = sorted(buffer.frames)
    for _ in range(5):
        target, source = data.draw(st.sampled_from(names)), data.draw(st.sampled_from(names))
        stamp = data.draw(st.integers(-10, 900_000_010))
        if not {target, source} <= set(known):
            with pytest.raises(TfLookupError, match="is unknown; "):
                buffer.lookup(target, source, stamp)
            continue
        try:
            expected = brute.lookup(target, source, stamp)
        except KeyError:
            with pytest.raises(TfExtrapolationError, match="outside the buffered range"):
                buffer.lookup(target, source, stamp)
            continue
        except LookupError:
            with pytest.raises(TfConnectivityError, match="no path between"):
                buffer.lookup(target, source, stamp)
            continue
        found = buffer.lookup(target, source, stamp)
        assert found.stamp_ns == stamp
        assert (found.transform.target, found.transform.source) == (target, source)
        np.testing.assert_allclose(found.transform.matrix, expected, atol=1e-6)
        if target != source:
            latest = buffer.latest_common_ns(target, source)
            path = {*brute.chain(target)} ^ {*brute.chain(source)}
            assert latest == min(max(brute.samples[child]) for child in path)


def test_edges_above_the_common_ancestor_are_not_used():
    buffer = TransformBuffer()
    buffer.insert("world", "base", 5, IDENTITY)
    buffer.insert("base", "a", 900, IDENTITY)
    buffer.insert("base", "b", 900, IDENTITY)
    assert buffer.lookup("a", "b").stamp_ns == 900


def test_oldest_edge_decides_the_latest_common_time():
    buffer = TransformBuffer()
    buffer.insert("reference", "cautery", 1_000, IDENTITY)
    buffer.insert("cautery", "tip", 0, IDENTITY, static=True)
    buffer.insert("tracker", "reference", 300, IDENTITY)
    buffer.insert("tracker", "reference", 2_000, IDENTITY)
    assert buffer.latest_common_ns("tracker", "tip") == 1_000
    assert buffer.latest_common_ns("cautery", "tip") is None
    assert buffer.lookup("cautery", "tip").stamp_ns is None


def test_invalid_pose_is_refused_and_changes_nothing():
    buffer = TransformBuffer()
    buffer.insert("a", "b", 1, IDENTITY)
    for child, bad, message in (
        ("c", (np.nan, *IDENTITY[1:]), "expected finite numbers"),
        ("c", (*IDENTITY[:6], np.inf), "expected finite numbers"),
        ("c", (*IDENTITY[:6], 0.0), "norm 0"),
        ("c", (*IDENTITY[:6], 1.01), "norm 1.01"),
        ("a", IDENTITY, "own parent"),
    ):
        with pytest.raises(TfInvalidError, match=message):
            buffer.insert("a", child, 2, bad)
    with pytest.raises(FrameError, match="not allowed"):
        buffer.insert("/a", "c", 2, IDENTITY)
    assert buffer.frames == {"a", "b"}
    assert buffer.latest_common_ns("a", "b") == 1


def test_loop_is_refused_with_its_frames():
    buffer = TransformBuffer()
    buffer.insert("a", "b", 1, IDENTITY)
    buffer.insert("b", "c", 1, IDENTITY)
    with pytest.raises(TfConnectivityError, match="c -> a would close the loop a -> b -> c -> a"):
        buffer.insert("c", "a", 1, IDENTITY)
    assert buffer.parent("a") is None


def test_new_parent_discards_the_history():
    buffer = TransformBuffer()
    buffer.insert("a", "c", 1, IDENTITY)
    buffer.insert("b", "c", 2, IDENTITY)
    assert buffer.parent("c") == "b"
    with pytest.raises(TfConnectivityError):
        buffer.lookup("a", "c")


def test_clock_jump_back_keeps_only_static_edges():
    buffer = TransformBuffer()
    assert not buffer.set_now(10)
    buffer.insert("a", "b", 9, IDENTITY)
    buffer.insert("b", "c", 0, IDENTITY, static=True)
    assert buffer.set_now(3)
    assert buffer.lookup("b", "c").stamp_ns is None
    with pytest.raises(TfConnectivityError):
        buffer.lookup("a", "b")


def test_stamps_that_jump_back_restart_the_edge():
    buffer = TransformBuffer()
    hour = 3600 * NS_PER_S
    buffer.insert("a", "b", hour, IDENTITY)
    buffer.insert("a", "b", 5, IDENTITY)
    assert buffer.latest_common_ns("a", "b") == 5


def test_buffer_is_limited_by_time_samples_and_frames():
    buffer = TransformBuffer(keep_ns=1_000, max_samples=50, max_frames=3)
    for stamp in range(5_000):
        buffer.insert("a", "b", stamp, IDENTITY)
    buffer.lookup("a", "b", 4_950)
    with pytest.raises(TfExtrapolationError, match=r"at 4949 ns: .*expected 4950 to 4999 ns"):
        buffer.lookup("a", "b", 4_949)
    assert not buffer.insert("a", "b", 3_900, IDENTITY)
    buffer.insert("a", "c", 1, IDENTITY)
    with pytest.raises(TfInvalidError, match="expected at most 3 frames"):
        buffer.insert("a", "d", 1, IDENTITY)


def test_repeated_stamp_keeps_its_first_pose():
    buffer = TransformBuffer()
    assert buffer.insert("a", "b", 1, IDENTITY)
    assert not buffer.insert("a", "b", 1, (7.0, *IDENTITY[1:]))
    assert buffer.lookup("a", "b").transform.translation_mm[0] == 0.0
