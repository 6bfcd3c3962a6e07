"""Planned corridors against an exhaustive search with coal, on ten thousand random scenes."""

import pytest

from tests.planning.needle_scenes import check_scenes

pytestmark = [pytest.mark.exhaustive, pytest.mark.timeout(3600)]


@pytest.mark.parametrize("first", range(0, 10_000, 100))
def test_corridors_keep_their_distance_and_score_as_the_best_of_an_exhaustive_search(first):
    check_scenes(range(first, first + 100))
