from dataclasses import dataclass

from hypothesis import given
from hypothesis import strategies as st

from app.cli.reel import Reel
from app.fixture import MarginState

STATES = st.lists(st.sampled_from(MarginState), min_size=1, max_size=200)


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
    reel = Reel(most)
    for number, state in enumerate(states):
        reel.add(StepDouble(number, DecisionDouble(state)))  # type: ignore[arg-type]
    return reel.steps  # type: ignore[return-value]


@given(states=STATES, most=st.integers(2, 50))
def test_each_interval_gives_its_first_step_in_its_worst_state(
    states: list[MarginState], most: int
) -> None:
    steps = kept(states, most)
    length = 1
    while -(-len(states) // length) > most:
        length *= 2
    intervals = [states[start : start + length] for start in range(0, len(states), length)]
    wanted = [
        place * length + interval.index(max(interval)) for place, interval in enumerate(intervals)
    ]
    assert [step.number for step in steps] == wanted


def test_few_steps_are_all_kept() -> None:
    assert [step.number for step in kept([MarginState.NEGATIVE] * 7, 7)] == list(range(7))


def test_a_breach_of_one_frame_is_in_the_movie() -> None:
    states = [MarginState.NEGATIVE] * 5000
    states[3333] = MarginState.POSITIVE
    steps = kept(states, 50)
    assert len(steps) <= 50
    assert [s.number for s in steps if s.decision.state is MarginState.POSITIVE] == [3333]
