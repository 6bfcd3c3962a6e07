"""Samples of joints, and the state of the cautery: unknown, and never off, without a fresh word."""

from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.case import Activation, ActivationTrail, JointSample
from app.case.messages.message_values import JointValues
from app.geometry import InputError, Stamp

LIMIT_NS = 1000


def test_unchecked_sample_equals_a_constructed_one():
    names, positions, stamp = ("a", "b"), (0.5, 1.5), Stamp(7)
    made = JointSample.unchecked(names, positions, stamp)
    checked = JointSample(names, positions, stamp)
    for field in fields(JointSample):
        assert getattr(made, field.name) == getattr(checked, field.name)
    assert made.as_mapping() == {"a": 0.5, "b": 1.5}


def test_names_without_a_position_and_repeated_joints_are_refused():
    with pytest.raises(InputError, match="2 names and 1 positions"):
        JointSample(("a", "b"), (0.5,), Stamp(7))
    names, positions = ("turn", "push", "turn"), (0.1, 0.2, 0.3)
    with pytest.raises(InputError, match="joint 'turn' is repeated"):
        JointSample(names, positions, Stamp(7))
    with pytest.raises(InputError, match="joint 'turn' is repeated"):
        JointValues(names, positions, 7).sample(offset_ns=0)


@given(on=st.booleans(), age_ns=st.integers(-5 * LIMIT_NS, 5 * LIMIT_NS))
def test_state_of_the_cautery_is_what_was_said_while_it_is_fresh(on, age_ns):
    trail = ActivationTrail(LIMIT_NS)
    assert trail.at(0) is Activation.UNKNOWN
    trail.hear(on, 10**9)
    known = Activation.ON if on else Activation.OFF
    expected = known if abs(age_ns) <= LIMIT_NS else Activation.UNKNOWN
    assert trail.at(10**9 + age_ns) is expected


def test_last_word_counts_and_a_forgotten_one_is_unknown():
    trail = ActivationTrail(LIMIT_NS)
    trail.hear(True, 100)
    trail.hear(False, 200)
    assert trail.at(300) is Activation.OFF
    trail.forget()
    assert trail.at(300) is Activation.UNKNOWN


def test_states_of_the_cautery_differ_by_sign_and_label_and_are_written_as_words():
    assert len({state.symbol for state in Activation}) == len(Activation)
    assert [state.label for state in Activation] == ["OFF", "UNKNOWN", "ON"]
    assert max(Activation, key=lambda state: state.rank) is Activation.ON
    assert all(Activation(str(state)) is state for state in Activation)
