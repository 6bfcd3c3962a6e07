from dataclasses import dataclass

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.cli.scene_log import KeyframeSelector
from app.fixture import MarginState

STATES = st.lists(st.sampled_from(MarginState), min_size=1, max_size=400)


@dataclass(frozen=True)
class DecisionDouble:
    """Test double of a decision: the selector reads only its state."""

    state: MarginState


@dataclass(frozen=True)
class StepDouble:
    """Test double of a step."""

    number: int
    decision: DecisionDouble


def selected(states: list[MarginState], max_count: int) -> list[StepDouble]:
    selector = KeyframeSelector(max_count)
    for number, state in enumerate(states):
        selector.add(StepDouble(number, DecisionDouble(state)))  # type: ignore[arg-type]
    return selector.steps()  # type: ignore[return-value]


@given(states=STATES, max_count=st.integers(1, 50))
def test_intervals_are_even_and_each_gives_first_step_of_its_worst_state(states, max_count):
    numbers = [step.number for step in selected(states, max_count)]
    assert len(numbers) == min(len(states), max_count)
    assert numbers == sorted(set(numbers))
    # The first step in the worst state of all is in every interval that could hold it.
    assert states.index(max(states)) in numbers
    uniform = [step.number for step in selected([MarginState.NEGATIVE] * len(states), max_count)]
    gaps = np.diff([*uniform, len(states)])
    length = len(states) / len(uniform)
    assert np.all(np.abs(gaps - length) <= max(1.0, 0.25 * length))
    for start, end, number in zip(uniform, [*uniform[1:], len(states)], numbers, strict=True):
        part = states[start:end]
        assert number == start + part.index(max(part))
