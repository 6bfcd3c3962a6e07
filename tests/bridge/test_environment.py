"""Discovery stays on this machine by default, and the wheels' start-up hook does no harm."""

import os
import subprocess
import sys

import pytest

from app.bridge.environment import prepare_environment, without_bootstrap

WITHOUT_HOOK_VARIABLES = without_bootstrap(os.environ)


@pytest.mark.parametrize("given", [{}, {"ROS_AUTOMATIC_DISCOVERY_RANGE": ""}])
def test_discovery_stays_on_this_machine_by_default(given):
    line = prepare_environment(given)
    assert given["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert "this machine" in line
    assert "SUBNET" in line


@pytest.mark.parametrize("choice", ["SUBNET", "OFF", "SYSTEM_DEFAULT", "LOCALHOST"])
def test_the_choice_of_the_user_wins(choice):
    variables = {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": choice,
        "FASTDDS_BUILTIN_TRANSPORTS": "DEFAULT",
    }
    given = dict(variables)
    line = prepare_environment(variables)
    assert variables == given
    assert choice in line


@pytest.mark.parametrize("given", [{}, {"FASTDDS_BUILTIN_TRANSPORTS": ""}])
def test_a_killed_peer_shares_no_memory_with_us_by_default(given):
    prepare_environment(given)
    assert given["FASTDDS_BUILTIN_TRANSPORTS"] == "UDPv4"


def test_the_environment_of_the_process_is_the_default(monkeypatch):
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)
    monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    prepare_environment()
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"


def test_the_start_up_hook_keeps_process_arguments_and_streams():
    program = "import os, sys; print(os.getpid(), sys.argv[1:], sys.stdin.read())"
    process = subprocess.Popen(
        [sys.executable, "-c", program, "replay", "a b", ""],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=WITHOUT_HOOK_VARIABLES,
    )
    out, _ = process.communicate("given")
    assert out.strip() == f"{process.pid} ['replay', 'a b', ''] given"


def test_a_process_that_never_saw_the_hook_can_still_start_ros():
    program = "import rclpy.context as c; x = c.Context(); x.init(); x.shutdown(); print('up')"
    result = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        env=WITHOUT_HOOK_VARIABLES,
        check=True,
    )
    assert result.stdout.strip() == "up"
