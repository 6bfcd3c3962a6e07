"""Frame names and their conversion to SlicerIGT and IGSIO names."""

import re

import pytest
from hypothesis import strategies as st

from app.geometry import (
    FrameError,
    camel_case,
    check_frame,
    join_transform_name,
    snake_case,
    split_transform_name,
)
from tests.geometry.few_examples import given

# "to" alone or before a digit is excluded: it would make a second place to split.
words = st.builds(
    str.__add__, st.sampled_from("abotz"), st.text("abotz01", min_size=1, max_size=6)
).filter(lambda word: not re.match(r"to(?:[0-9]|$)", word))
frames = st.lists(words, min_size=1, max_size=3).map("_".join)


@pytest.mark.parametrize(
    ("name", "source", "target"),
    [
        ("StylusTipToStylus", "stylus_tip", "stylus"),
        ("ReferenceToTracker", "reference", "tracker"),
        ("ReferenceToRAS", "reference", "ras"),
        ("RASToReference", "ras", "reference"),
        ("Probe1ToTracker", "probe1", "tracker"),
        ("ToolToTracker", "tool", "tracker"),
        ("TotalToTorso", "total", "torso"),
    ],
)
def test_igsio_name_is_source_to_target(name, source, target):
    assert split_transform_name(name) == (source, target)


def test_name_without_to_gives_none_and_ambiguous_name_is_rejected():
    assert split_transform_name("Stylus") is None
    assert split_transform_name("Tool") is None
    with pytest.raises(FrameError, match="2 places"):
        split_transform_name("AToBToC")
    with pytest.raises(FrameError, match="2 places"):
        split_transform_name(join_transform_name("a0", "to0"))


@given(frames, frames)
def test_joining_and_splitting_a_name_round_trips(source, target):
    assert split_transform_name(join_transform_name(source, target)) == (source, target)


@given(frames)
def test_camel_case_round_trips(frame):
    assert snake_case(camel_case(frame)) == frame


@pytest.mark.parametrize("name", ["", "/a", "a/", "a//b", "a b", "a:b", "ä", "a\n", None, 3])
def test_invalid_tf_name_is_rejected(name):
    with pytest.raises(FrameError, match="not allowed"):
        check_frame(name)


@pytest.mark.parametrize("name", ["robot1/tool_tip", "link_9.0", "left-arm"])
def test_ros_style_name_is_accepted(name):
    assert check_frame(name) == name
