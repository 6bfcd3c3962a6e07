from dataclasses import dataclass

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.cli.keyframes import KeyframeSelector
from app.fixture import MarginState

STATES = st.lists(st.sampled_from(MarginState), min_size=1, max_size=400)


@dataclass(frozen=True)
class DecisionDouble:
    """Stands for a decision: a reel asks for its state alone."""

    state: MarginState


@dataclass(frozen=True)
class StepDouble:
    """Stands for a step."""

    number: int
    decision: DecisionDouble


def kept(states: list[MarginState], most: int) -> list[StepDouble]:
    reel = KeyframeSelector(most)
    for number, state in enumerate(states):
        reel.add(StepDouble(number, DecisionDouble(state)))  # type: ignore[arg-type]
    return reel.steps()  # type: ignore[return-value]


@given(states=STATES, most=st.integers(1, 50))
def test_intervals_are_even_and_each_gives_its_first_step_in_its_worst_state(
    states: list[MarginState], most: int
) -> None:
    numbers = [step.number for step in kept(states, most)]
    assert len(numbers) == min(len(states), most)
    assert numbers == sorted(set(numbers))
    # The first step in the worst state of all is in every interval that could hold it.
    assert states.index(max(states)) in numbers
    calm = [step.number for step in kept([MarginState.NEGATIVE] * len(states), most)]
    gaps = np.diff([*calm, len(states)])
    length = len(states) / len(calm)
    assert np.all(np.abs(gaps - length) <= max(1.0, 0.25 * length))
    for start, end, number in zip(calm, [*calm[1:], len(states)], numbers, strict=True):
        part = states[start:end]
        assert number == start + part.index(max(part))


def test_few_steps_are_all_kept() -> None:
    assert [step.number for step in kept([MarginState.NEGATIVE] * 7, 7)] == list(range(7))


def test_a_breach_of_one_frame_is_in_the_movie() -> None:
    states = [MarginState.NEGATIVE] * 5000
    states[3333] = MarginState.POSITIVE
    steps = kept(states, 50)
    assert len(steps) == 50
    assert [s.number for s in steps if s.decision.state is MarginState.POSITIVE] == [3333]
