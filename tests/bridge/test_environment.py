"""Discovery stays on this machine by default, and the wheels' start-up hook does no harm."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from app.bridge import RosNode
from app.bridge.environment import UDP_ON_THIS_MACHINE, prepare_environment, without_bootstrap

LOCALHOST = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
WITHOUT_HOOK_VARIABLES = without_bootstrap(os.environ)


BY_UDP = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
    "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(UDP_ON_THIS_MACHINE),
}


@pytest.mark.parametrize("given", [{}, {"ROS_AUTOMATIC_DISCOVERY_RANGE": ""}, LOCALHOST, BY_UDP])
def test_discovery_stays_on_this_machine_by_udp(given):
    variables = dict(given)
    line = prepare_environment(variables)
    assert variables == BY_UDP
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


@pytest.mark.parametrize(
    "name",
    [
        "FASTRTPS_DEFAULT_PROFILES_FILE",
        "RMW_IMPLEMENTATION",
        "ROS_LOCALHOST_ONLY",
        "ROS_STATIC_PEERS",
    ],
)
def test_an_arrangement_of_the_user_is_not_undone(name):
    variables = {name: "his own"}
    assert "this machine" in prepare_environment(variables)
    assert variables == {
        name: "his own",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
    }


def test_without_its_profile_discovery_is_not_opened(monkeypatch, tmp_path):
    monkeypatch.setattr("app.bridge.environment.UDP_ON_THIS_MACHINE", tmp_path / "gone.xml")
    variables = {}
    prepare_environment(variables)
    assert variables["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"


def test_the_environment_of_the_process_is_the_default(monkeypatch):
    for name in BY_UDP:
        monkeypatch.setenv(name, "")
    prepare_environment()
    assert {name: os.environ[name] for name in BY_UDP} == BY_UDP


def test_a_killed_peer_shares_no_memory_with_us_and_no_other_machine_hears_of_us(domain_id):
    # Asked of the kernel: Fast DDS could leave our profile out without a word.
    with RosNode("alone", domain_id=domain_id):
        assert "/dev/shm/fastrtps" not in Path("/proc/self/maps").read_text()
        table = Path("/proc/self/net/udp").read_text().splitlines()[1:]
        ports = {int(line.split()[1].partition(":")[2], 16) for line in table}
    base = 7400 + 250 * domain_id  # RTPS 2.3, 9.6.1.1: multicast at the base, unicast from + 10 on
    assert base not in ports
    assert ports & set(range(base + 10, base + 250))


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
