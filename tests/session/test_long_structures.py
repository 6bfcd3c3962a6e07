"""Many random sessions with several structures; the suite compares fewer of the same."""

import numpy as np
import pytest
import trimesh

from tests.session.structure_worlds import compare_with_single_sessions, judge_planes
from tests.session.test_far_structures import compare
from tests.session.tool_worlds import compare_with_single_pairs
from tests.session.vessel_pushes import LOSS_MM, STOP_MM, push

pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]


@pytest.mark.parametrize("seed", range(100, 140))
def test_each_structure_is_decided_as_by_a_session_of_its_own(seed):
    """10,000 configurations in all: structures at a frame."""
    rng = np.random.default_rng(seed)
    compare_with_single_sessions(rng, int(rng.integers(1, 21)), frames=250)


@pytest.mark.parametrize("seed", range(100, 110))
def test_far_structures_change_no_decision(seed):
    assert compare(seed, structures=8, frames=400)[2] > 10


@pytest.mark.parametrize("seed", range(100, 160))
def test_random_tools_and_structures_agree_with_single_pairs(seed):
    rng = np.random.default_rng(seed)
    compare_with_single_pairs(rng, int(rng.integers(1, 4)), int(rng.integers(1, 4)), frames=200)


def test_planes_of_all_structures_permit_no_motion_into_one():
    rng = np.random.default_rng(2)
    judged = [judge_planes(rng, motions=100) for _ in range(150)]
    assert sum(each.motions for each in judged) > 5000
    assert sum(each.left_out > 0 for each in judged) > 100


def test_tool_enters_neither_tumour_nor_vessel_in_60_pushes(project_root):
    cautery = trimesh.load(project_root / "data" / "recorded_case" / "cautery.stl")
    assert min(push(seed, cautery) for seed in range(60)) >= STOP_MM - LOSS_MM
