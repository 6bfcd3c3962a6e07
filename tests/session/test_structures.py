"""Several structures in one session: each as alone, together the worst, planes for all of them."""

import numpy as np
import pytest
import trimesh

from tests.fixture.control.guarded_loop import Guard
from tests.session.structure_worlds import check_jumps, compare_with_single_sessions, judge_planes
from tests.session.vessel_pushes import LOSS_MM, STOP_MM, push

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("seed", "structures"), [(0, 1), (1, 2), (2, 3), (3, 5), (4, 9), (5, 20)])
def test_each_structure_is_decided_as_by_a_session_of_its_own(seed, structures):
    compare_with_single_sessions(np.random.default_rng(seed), structures, 300 // structures + 40)


def test_planes_of_all_structures_permit_no_motion_into_one():
    rng = np.random.default_rng(1)
    judged = [judge_planes(rng, motions=60) for _ in range(12)]
    assert sum(each.motions for each in judged) > 200
    assert any(each.left_out for each in judged)


def test_jump_of_one_frame_makes_all_structures_unknown():
    assert check_jumps(np.random.default_rng(8), structures=4, frames=150) > 3


@pytest.mark.parametrize("seed", [1, 6])
def test_tool_does_not_enter_a_vessel_beside_the_tumour(project_root, seed):
    cautery = trimesh.load(project_root / "data" / "recorded_case" / "cautery.stl")
    assert push(seed, cautery) >= STOP_MM - LOSS_MM
    assert push(seed, cautery, Guard) < 0.0  # knows the tumour alone
