"""Samples of joints."""

from dataclasses import fields

import pytest

from app.case import JointSample
from app.case.messages.values import JointValues
from app.geometry import InputError, Stamp


def test_unchecked_sample_equals_a_constructed_one() -> None:
    names, positions, stamp = ("a", "b"), (0.5, 1.5), Stamp(7)
    made = JointSample.unchecked(names, positions, stamp)
    checked = JointSample(names, positions, stamp)
    for field in fields(JointSample):
        assert getattr(made, field.name) == getattr(checked, field.name)
    assert made.as_mapping() == {"a": 0.5, "b": 1.5}


def test_names_without_a_position_are_refused() -> None:
    with pytest.raises(InputError, match="2 names and 1 positions"):
        JointSample(("a", "b"), (0.5,), Stamp(7))


def test_repeated_joint_is_refused() -> None:
    names, positions = ("turn", "push", "turn"), (0.1, 0.2, 0.3)
    with pytest.raises(InputError, match="joint 'turn' is repeated"):
        JointSample(names, positions, Stamp(7))
    with pytest.raises(InputError, match="joint 'turn' is repeated"):
        JointValues(names, positions, 7).sample(offset_ns=0)
