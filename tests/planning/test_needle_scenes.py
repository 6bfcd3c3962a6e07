"""Planned corridors against an exhaustive search with coal, on random scenes."""

import pytest

from tests.planning.needle_scenes import judged

pytestmark = pytest.mark.slow


def test_corridors_keep_their_distance_and_score_as_the_best_of_an_exhaustive_search():
    verdicts = [judged(seed) for seed in range(2)]
    assert sum(each.corridors for each in verdicts) > 0
    assert sum(each.violations for each in verdicts) == 0
    assert sum(each.wrong_entries for each in verdicts) == 0
    assert min(each.score_ratio for each in verdicts) >= 0.98
