"""The state of the cautery: never said, and said too long ago, is unknown and never off."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.case import CauteryState, CauteryTrail

LIMIT_NS = 1000


def test_source_that_has_said_nothing_is_unknown() -> None:
    assert CauteryTrail(LIMIT_NS).at(0) is CauteryState.UNKNOWN


@given(on=st.booleans(), age_ns=st.integers(-5 * LIMIT_NS, 5 * LIMIT_NS))
def test_state_is_what_was_said_while_it_is_fresh(on: bool, age_ns: int) -> None:
    trail = CauteryTrail(LIMIT_NS)
    trail.hear(on, 10**9)
    known = CauteryState.ON if on else CauteryState.OFF
    expected = known if abs(age_ns) <= LIMIT_NS else CauteryState.UNKNOWN
    assert trail.at(10**9 + age_ns) is expected


def test_last_word_counts_and_a_forgotten_one_is_unknown() -> None:
    trail = CauteryTrail(LIMIT_NS)
    trail.hear(True, 100)
    trail.hear(False, 200)
    assert trail.at(300) is CauteryState.OFF
    trail.forget()
    assert trail.at(300) is CauteryState.UNKNOWN


def test_states_differ_by_sign_and_by_label() -> None:
    assert len({state.symbol for state in CauteryState}) == len(CauteryState)
    assert [state.label for state in CauteryState] == ["OFF", "UNKNOWN", "ON"]
    assert max(CauteryState, key=lambda state: state.rank) is CauteryState.ON


@pytest.mark.parametrize("state", CauteryState)
def test_state_is_written_as_a_word(state: CauteryState) -> None:
    assert CauteryState(str(state)) is state
