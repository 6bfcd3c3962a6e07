"""A step as a message: the display computes with exactly the numbers of the guard."""

import math
from array import array
from dataclasses import fields, replace
from itertools import islice

import numpy as np
import pytest
from marginguard_msgs.msg import SessionStep
from rclpy.serialization import deserialize_message, serialize_message

import marginguard as mg
from app.bridge import BridgeError
from app.bridge.constraint_message import ConstraintBuilder
from app.bridge.displays.step_message import StepOrigin, step_message, step_of
from app.geometry import TrackedTransform
from app.hold import SeenHold
from app.runtime import ToolContent
from app.session import Session, ToolDistance
from tests.cut_case import recorded_frames, write_cut_case, write_cut_structures
from tests.session.test_step_pickle import assert_same

pytestmark = pytest.mark.slow

ORIGIN = StepOrigin("run 1", "content 1", SeenHold(3, 2**64 - 1), 17, "{}", "", "no image")


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """Parts of the recorded case: a breach, and a dropout of the tracker."""
    parts = [*recorded_frames(95.5, 0.8), *recorded_frames(138.8, 0.7)]
    folder = tmp_path_factory.mktemp("cut") / "case"
    return mg.open_case(write_cut_case(folder, 0.0, 0.0, lambda _: parts))


@pytest.fixture(scope="module")
def steps(case):
    return list(mg.replay(case))


def sent(step):
    """The message as a subscriber gets it."""
    raw = serialize_message(step_message(step, ORIGIN))
    return deserialize_message(raw, SessionStep)


def as_shown(step):
    """``step`` without what no display uses: the joint samples of its frame."""
    return replace(step, frame=replace(step.frame, joints=(), unfiltered_stamp=None))


def test_displayed_step_has_every_number_of_the_step(steps, case):
    for step in steps:
        found, others = step_of(sent(step), case.content)
        assert others == []
        for field in fields(step):
            if field.name not in ("edges", "links"):
                assert_same(
                    getattr(as_shown(found), field.name), getattr(as_shown(step), field.name)
                )
        assert list(found.links) == list(step.links)
        for name, pose in step.links.items():
            np.testing.assert_array_equal(found.links[name].matrix, pose.matrix)
    assert any(sample.transform is None for step in steps for sample in step.frame.poses)
    assert any(step.decision.proximity and step.decision.proximity.contact for step in steps)


def test_structures_that_are_off_are_displayed_with_their_reasons(steps, case):
    off = {"chest_wall": "not in the field", "nerve": "ä"}
    found, _ = step_of(sent(replace(steps[0], off=off)), case.content)
    assert found.off == off


def test_far_structure_is_displayed_with_a_lower_bound_of_its_distance(tmp_path):
    case = mg.open_case(write_cut_structures(tmp_path / "case", 0.0, 1.0))
    session, content = Session(case.setup, skip_far=True), case.content
    _, step = (session.step(frame) for frame in islice(case.case.frames(), 2))
    assert [each.at_least_mm is None for each in step.structures] == [True, False, True]
    found, _ = step_of(sent(step), content)
    for shown, each in zip(found.structures, step.structures, strict=True):
        assert shown.at_least_mm == each.at_least_mm
        assert shown.decision.state is each.decision.state
        assert_same(shown.decision.proximity, each.decision.proximity)
    message = ConstraintBuilder(content).message(step.decision, structures=step.structures)
    bounds = [each.lower_bound for each in message.structures]
    _, far, wall = step.structures
    assert bounds[1:] == [far.at_least_mm / 1000.0, wall.decision.proximity.lower_bound_mm / 1000.0]
    assert [math.isnan(each.signed_distance) for each in message.structures] == [False, True, False]


def test_edges_lead_to_the_same_poses_in_other_frames(steps, case):
    for step in steps[::7]:
        found = step_of(sent(step), case.content)[0].edges
        assert found.frames() == step.edges.frames()
        for target, source in (("reference", "cautery"), ("robot_base", "needle")):
            try:
                pose, oldest = step.edges.between(target, source)
            except mg.MarginGuardError as error:
                with pytest.raises(type(error)):
                    found.between(target, source)
                continue
            shown, shown_oldest = found.between(target, source)
            np.testing.assert_array_equal(shown.matrix, pose.matrix)
            assert shown_oldest == oldest


def test_poses_that_the_step_does_not_use_come_with_it(steps, case):
    pose = mg.Transform("tracker", "probe", np.eye(3), [1.0, 2.0, 3.0])
    probe = TrackedTransform.valid(pose, steps[0].frame.stamp)
    raw = serialize_message(step_message(steps[0], ORIGIN, [probe]))
    found, (other,) = step_of(deserialize_message(raw, SessionStep), case.content)
    assert_same(other, probe)
    assert_same(found.frame.poses, steps[0].frame.poses)
    assert ("tracker", "probe") not in found.edges.measured


def test_hold_of_the_step_is_that_of_its_message(steps):
    message = sent(steps[0])
    assert (message.hold_seq, message.hold_nonce) == (3, 2**64 - 1)


def turned(message):
    message.transforms[0] += 0.1


def not_finite(message):
    message.tumor_from_tip[9] = np.nan


def zeros(message):
    message.transforms[:12] = array("d", [0.0] * 12)


def too_few(message):
    message.stamps_ns = array("q", message.stamps_ns[:-1])


def unknown_reason(message):
    message.reasons = ["bored"]


def unknown_index(message):
    message.known = array("I", [99] * len(message.known))


def later(message):
    message.version = 2


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (turned, "a transform is not rigid"),
        (zeros, "a transform is not rigid"),
        (not_finite, "a transform has numbers that are not finite"),
        (too_few, "shorter than"),
        (unknown_reason, "'bored' is not a valid Reason"),
        (unknown_index, "list index out of range"),
        (later, "version 2; expected 1"),
    ],
)
def test_message_of_no_guard_is_refused_in_one_line(steps, case, change, problem):
    message = sent(steps[0])
    change(message)
    with pytest.raises(BridgeError, match=problem) as refused:
        step_of(message, case.content)
    assert "\n" not in str(refused.value)


def test_other_tools_are_displayed_with_their_distances(steps, case):
    tip = mg.Transform("left", "left_tip", np.eye(3), [0.0, 0.0, 50.0])
    tool = case.content.tool
    surface = mg.SurfaceMesh("left_tip", tool.vertices_mm, tool.faces)
    content = replace(case.content, tools=(ToolContent("left", surface, tip),))
    proximity = steps[0].decision.proximity
    near = ToolDistance("left", mg.MarginState.WARNING, (mg.Reason.WARNING_DISTANCE,), proximity)
    far = ToolDistance("left", mg.MarginState.NEGATIVE, (mg.Reason.CLEAR,), None, 52.5)
    lost = ToolDistance("left", mg.MarginState.UNKNOWN, (mg.Reason.STALE,))
    for tool in (near, far, lost):
        found, _ = step_of(sent(replace(steps[0], tools=(tool,))), content)
        assert_same(found.tools, (tool,))
        assert found.structures == ()
        assert found.warnings == ((tool.warning,) if tool.warning else ())
