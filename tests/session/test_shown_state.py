"""The look of a tool inside the stop margin differs from all states, also for the colour-blind."""

from itertools import combinations

import pytest

from app.session import SHOWN_STATES, STOP
from tests.fixture.control.test_state_display import VISIONS, Rgb, seen_ratio


def rgb(text: str) -> Rgb:
    red, green, blue = (int(text[n : n + 2], 16) / 255.0 for n in (1, 3, 5))
    return (red, green, blue)


@pytest.mark.parametrize("vision", VISIONS)
def test_grounds_differ_in_luminance(vision: str) -> None:
    for first, second in combinations(SHOWN_STATES.values(), 2):
        assert seen_ratio(rgb(first.ground_hex), rgb(second.ground_hex), vision) >= 1.5


@pytest.mark.parametrize("vision", VISIONS)
def test_text_is_readable_on_the_ground(vision: str) -> None:
    for shown in SHOWN_STATES.values():
        assert seen_ratio(rgb(shown.text_hex), rgb(shown.ground_hex), vision) >= 4.5


def test_symbols_and_labels_are_unique() -> None:
    assert len({shown.symbol for shown in SHOWN_STATES.values()}) == len(SHOWN_STATES)
    assert len({shown.label for shown in SHOWN_STATES.values()}) == len(SHOWN_STATES)
    assert SHOWN_STATES[STOP].label.isascii() and SHOWN_STATES[STOP].label.isupper()
