from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.report.label_layout import spread


@given(st.lists(st.floats(0.0, 300.0), max_size=6))
def test_labels_never_overlap_and_keep_their_order(places):
    moved = spread(places, 14.0, 10.0)
    order = sorted(range(len(places)), key=lambda index: places[index])
    assert all(moved[b] - moved[a] >= 14.0 - 1e-9 for a, b in pairwise(order))
    assert min(moved, default=10.0) >= 10.0


@given(st.lists(st.integers(1, 20), min_size=1, max_size=6))
def test_labels_that_have_room_stay(steps):
    places = [20.0 * sum(steps[: index + 1]) for index in range(len(steps))]
    assert spread(places, 14.0, 10.0) == places


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
def test_lowest_label_stays_and_the_others_move_up(order):
    places = [[100.0, 104.0, 106.0][index] for index in order]
    expected = [[78.0, 92.0, 106.0][index] for index in order]
    assert spread(places, 14.0, 0.0) == expected
