"""Steps that are passed to another process."""

import pickle
from dataclasses import fields, is_dataclass, replace
from itertools import islice

import numpy as np
import pytest

from app.geometry import TrackedTransform, TrackingStatus
from app.robot.kinematic_tree import LinkPoses
from app.session import Session, setup_from_case
from app.session.step_result import NO_EDGES, pickled_steps

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def pickled(case):
    """Steps of the recorded case with the tumour at the tool's tip, the last ones without it.

    Each with its pickle from before the next step.
    """
    setup = setup_from_case(case)
    frames = list(islice(case.frames(), 40))
    needle, cautery = (
        next(pose.transform for pose in frames[20].poses if pose.source == name)
        for name in ("needle", "cautery")
    )
    at_tip = (needle.inverse() @ cautery @ setup.tool_from_tip).renamed(source="tumor")
    session = Session(replace(setup, frame_from_tumor=at_tip))
    lost = [replace(frame, poses=tuple(map(without_pose, frame.poses))) for frame in frames[30:]]
    steps = (session.step(frame) for frame in (*frames[:30], *lost))
    return [(step, pickled_steps([step])) for step in steps]


@pytest.fixture(scope="module")
def steps(pickled):
    return [step for step, _ in pickled]


def without_pose(pose):
    return TrackedTransform.lost(pose.target, pose.source, pose.stamp, TrackingStatus.INVALID)


def assert_same(found: object, expected: object) -> None:
    assert type(found) is type(expected)
    if isinstance(expected, np.ndarray):
        assert found.dtype == expected.dtype
        np.testing.assert_array_equal(found, expected)
        assert not found.flags.writeable
    elif isinstance(expected, LinkPoses):
        assert list(found) == list(expected)
        for name in expected:
            assert_same(found[name], expected[name])
    elif isinstance(expected, (tuple, list)):
        assert len(found) == len(expected)
        for ours, theirs in zip(found, expected, strict=True):
            assert_same(ours, theirs)
    elif is_dataclass(expected):
        for field in fields(expected):
            if field.name not in ("edges", "contact"):
                assert_same(getattr(found, field.name), getattr(expected, field.name))
    else:
        assert found == expected or (found != found and expected != expected)


def test_steps_are_equal_in_the_other_process(steps):
    found = pickle.loads(pickled_steps(steps))
    assert len(found) == len(steps)
    for ours, theirs in zip(found, steps, strict=True):
        assert_same(ours, theirs)
        assert ours.edges is NO_EDGES
        if theirs.decision.proximity is not None:
            assert ours.decision.proximity.contact == theirs.decision.proximity.contact
    assert any(sample.transform is None for step in steps for sample in step.frame.poses)
    assert any(step.links for step in steps)
    assert any(step.decision.proximity and step.decision.proximity.contact for step in steps)


def test_no_step_is_changed_by_the_next_ones(pickled):
    for step, before in pickled:
        assert_same(pickle.loads(pickled_steps([step])), pickle.loads(before))


def test_the_pickle_is_smaller_than_that_of_pickle(steps):
    assert len(pickled_steps(steps)) < len(pickle.dumps(steps, pickle.HIGHEST_PROTOCOL))


def test_step_without_a_robot_passes_to_a_process_that_draws_it(case):
    session = Session(replace(setup_from_case(case), robot=None))
    step = session.step(next(iter(case.frames())))
    edges = pickle.loads(pickle.dumps(step)).edges
    assert edges.links == {} and edges.measured.keys() == step.edges.measured.keys()
