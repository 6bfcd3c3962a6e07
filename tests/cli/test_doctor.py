"""Checks of the installation, on this machine and with missing parts."""

import shutil
import sys
from pathlib import Path

import pytest

from app.cli import installation_checks

pytestmark = pytest.mark.slow


def test_each_remedy_belongs_to_something_missing():
    checks = installation_checks.check_environment(probe=lambda code: (True, sys.prefix))
    names = [check.name for check in checks]
    assert len(names) == len(set(names))
    assert {"python", "compiler", "egl", "ROS interfaces", "3D Slicer scene"} <= set(names)
    assert {"shipped case", "shipped robots", "page", "RViz", "Foxglove"} <= set(names)
    for check in checks:
        assert check.found
        assert bool(check.remedy) is not check.ok


def test_failed_probe_is_reported_with_its_output():
    checks = installation_checks.check_environment(
        probe=lambda code: (False, "ImportError: no such thing")
    )
    failed = {check.name: check for check in checks if check.found == "ImportError: no such thing"}
    assert set(failed) == {"rclpy imports", "ROS interfaces", "3D Slicer scene"}
    assert "apt" not in failed["rclpy imports"].remedy
    assert "./interfaces" in failed["ROS interfaces"].remedy
    assert "[scene]" in failed["3D Slicer scene"].remedy


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("raise ImportError('no such thing')", "ImportError: no such thing"),
        ("import os; os.abort()", "killed by signal 6"),
    ],
)
def test_failed_or_crashed_probe_is_a_result(code, found):
    assert installation_checks.run_probe(code) == (False, found)


def test_missing_distribution_is_named():
    (check,) = installation_checks.check_packages("no-such-distribution")
    assert not check.ok
    assert check.name == "no-such-distribution"


def test_requirements_are_checked_without_those_of_tests(monkeypatch):
    required = ["numpy", "no-such-core", 'no-such-ros[extra]==1; extra == "ros"']
    required.append('no-such-test<5; extra == "test"')
    monkeypatch.setattr(installation_checks.metadata, "requires", lambda name: required)
    checks = {check.name: check for check in installation_checks.check_packages()}
    assert set(checks) == {"numpy", "no-such-core", "no-such-ros"}
    assert checks["numpy"].ok
    assert "'.'" in checks["no-such-core"].remedy
    assert "'.[ros]'" in checks["no-such-ros"].remedy


def test_tf2_msgs_that_is_earlier_on_path_is_named(tmp_path, monkeypatch):
    tf2_msgs = pytest.importorskip("tf2_msgs", reason="the ROS interfaces are not installed")
    # As after sourcing a ROS 2 installation: a folder on PYTHONPATH with a tf2_msgs that works.
    sourced = tmp_path / "tf2_msgs"
    shutil.copytree(Path(tf2_msgs.__file__).parent, sourced)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    check = installation_checks.check_interfaces(installation_checks.run_probe)
    assert check.ok
    assert str(sourced) in check.found
    assert "ahead of" in check.found
