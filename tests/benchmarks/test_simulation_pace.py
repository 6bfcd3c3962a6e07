"""The pace of the shipped world against the clock of the host."""

import json

import pytest

pytest.importorskip("mujoco")
pytest.importorskip("rclpy")

from benchmarks.simulation.__main__ import main
from tests.ros_domain import domain_id as domain_id

pytestmark = pytest.mark.long


def test_pace_of_the_shipped_world_in_a_process_of_its_own(domain_id, tmp_path):
    path = tmp_path / "figures.json"
    main(["--steps", "100", "--minutes", "0.1", "--json", str(path)])
    pace = json.loads(path.read_text())["pace"]
    assert pace["seconds"] > 1.0
    assert 0.0 < pace["median_ms"] <= pace["max_ms"]
    assert pace["missing_s"] >= -1e-6
