"""The promise of the recorder, kept at twenty kills at random times."""

import random

import pytest

from tests.recorder.kills import run_kill
from tests.ros_domain import domain_id as domain_id

pytestmark = pytest.mark.exhaustive


@pytest.mark.parametrize("number", range(20))
def test_killed_recorder_loses_no_more_than_promised(domain_id, tmp_path, number):
    kill = run_kill(tmp_path, random.Random(number).uniform(1.0, 5.0))
    assert kill.is_good, kill
