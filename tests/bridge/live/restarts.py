"""Shared parts of the tests of restarts and of second instances."""

from pathlib import Path

import yaml

from tests.bridge.conftest import LIVE
from tests.bridge.conftest import TRACKED as TRACKED

REARM = ("-m", "app.cli", "rearm", "--yes")


def live(config, *options):
    """Arguments of ``marginguard live``."""
    return (*LIVE, config, *options)


def other_arm(config: Path) -> Path:
    """A copy of ``config`` whose robot has another topic of joints."""
    values = yaml.safe_load(config.read_text())
    values["robot"]["joint_states"] = "/other/joint_states"
    path = config.with_name("other_arm.yaml")
    path.write_text(yaml.safe_dump(values))
    return path


def no_arm(config: Path) -> Path:
    """A copy of ``config`` without robot."""
    values = yaml.safe_load(config.read_text())
    values = {key: values[key] for key in values.keys() - {"robot", "registration", "clock"}}
    path = config.with_name("no_arm.yaml")
    path.write_text(yaml.safe_dump(values))
    return path


def refusal(child):
    """Wait for the end of a refused guard and return its error line."""
    assert child.wait() == 2
    (line,) = [
        line for line in child.log.read_text().splitlines() if line.startswith("marginguard: error")
    ]
    assert "Traceback" not in child.log.read_text()
    return line
