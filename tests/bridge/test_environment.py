"""Discovery stays on this machine by default; start-up hook of the ROS wheels."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from app.bridge import RosNode
from app.bridge.environment import (
    UDP_ON_THIS_MACHINE,
    listens_to_other_machines,
    prepare_environment,
)
from tests.bridge.processes import Child
from tests.python_process import run_python

pytestmark = pytest.mark.slow

LOCALHOST = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
HOOK_VARIABLES = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
WITHOUT_HOOK_VARIABLES = {k: v for k, v in os.environ.items() if k not in HOOK_VARIABLES}


BY_UDP = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
    "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(UDP_ON_THIS_MACHINE),
    "SKIP_DEFAULT_XML_FILE": "1",
}
FAST_DDS = {"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}
NOT_LOCALHOST_ONLY = {"ROS_LOCALHOST_ONLY": "0"}
FIRST_ANNOUNCEMENTS = 6
"""Sent by Fast DDS in the first half second, whatever the period is."""

OF_ANOTHER_INSTALLATION = {**BY_UDP, "FASTRTPS_DEFAULT_PROFILES_FILE": UDP_ON_THIS_MACHINE.name}


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"ROS_AUTOMATIC_DISCOVERY_RANGE": ""},
        LOCALHOST,
        BY_UDP,
        OF_ANOTHER_INSTALLATION,
        FAST_DDS,
        NOT_LOCALHOST_ONLY,
    ],
)
def test_discovery_stays_on_this_machine_by_udp(given):
    variables = dict(given)
    line = prepare_environment(variables)
    assert variables == {**given, **BY_UDP}
    assert "this machine; set" in line
    assert "SUBNET" in line


@pytest.mark.parametrize("choice", ["SUBNET", "OFF", "SYSTEM_DEFAULT", "LOCALHOST"])
def test_user_choice_is_kept(choice):
    variables = {"ROS_AUTOMATIC_DISCOVERY_RANGE": choice, "FASTDDS_BUILTIN_TRANSPORTS": "DEFAULT"}
    given = dict(variables)
    prepare_environment(variables)
    assert variables == given


@pytest.mark.parametrize("choice", ["SUBNET", "OFF"])
def test_child_can_use_another_range(choice):
    variables = {**BY_UDP, "ROS_AUTOMATIC_DISCOVERY_RANGE": choice}
    line = prepare_environment(variables)
    assert "FASTRTPS_DEFAULT_PROFILES_FILE" not in variables
    assert variables["ROS_AUTOMATIC_DISCOVERY_RANGE"] == choice
    assert choice in line


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("FASTRTPS_DEFAULT_PROFILES_FILE", "user.xml"),
        ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp"),
        ("ROS_DISCOVERY_SERVER", "10.0.0.2:11811"),
        ("ROS_LOCALHOST_ONLY", "1"),
        ("ROS_STATIC_PEERS", "10.0.0.2"),
    ],
)
def test_user_configuration_is_kept_and_named(name, value):
    variables = {name: value}
    assert f"this machine, unless {name} configures" in prepare_environment(variables)
    assert variables == {
        name: value,
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
    }


def test_user_profile_in_working_directory_is_kept(monkeypatch, tmp_path):
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").write_text("<profiles/>")
    monkeypatch.chdir(tmp_path)
    variables = {}
    assert "DEFAULT_FASTRTPS_PROFILES.xml" in prepare_environment(variables)
    assert variables["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    skipped = {"SKIP_DEFAULT_XML_FILE": "1"}
    prepare_environment(skipped)
    assert skipped == BY_UDP


def test_discovery_stays_local_if_the_profile_is_missing(monkeypatch, tmp_path):
    monkeypatch.setattr("app.bridge.environment.UDP_ON_THIS_MACHINE", tmp_path / "gone.xml")
    variables = {}
    prepare_environment(variables)
    assert variables["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"


def test_process_environment_is_the_default(monkeypatch):
    for name in BY_UDP:
        monkeypatch.setenv(name, "")
    prepare_environment()
    assert {name: os.environ[name] for name in BY_UDP} == BY_UDP


def test_node_uses_no_shared_memory_and_no_multicast(domain_id):
    # Checked in the kernel, because Fast DDS may ignore our profile without an error.
    with RosNode("alone", domain_id=domain_id):
        assert "/dev/shm/fastrtps" not in Path("/proc/self/maps").read_text()
        assert not listens_to_other_machines(domain_id)


def test_node_announces_itself_again_soon(domain_id):
    # As a participant that missed the answer to its own announcement receives it.
    last = 31
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.bind(("127.0.0.1", 7400 + 250 * domain_id + 10 + 2 * last))
        participant.settimeout(2.0)  # 10 periods
        with RosNode("alone", domain_id=domain_id):
            for _ in range(FIRST_ANNOUNCEMENTS + 5):
                assert participant.recv(65536).startswith(b"RTPS")


STARTED = """
import sys
from app.bridge import BridgeError, RosNode
from app.bridge.environment import listens_to_other_machines
try:
    with RosNode("alone", domain_id=int(sys.argv[1])) as ros:
        print(listens_to_other_machines(int(sys.argv[1])))
except BridgeError as error:
    print(error)
"""
WHOLE_NETWORK = """<?xml version="1.0" encoding="UTF-8"?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <participant profile_name="other" is_default_profile="true"><rtps/></participant>
</profiles>
"""


def started(tmp_path: Path, domain: int, **environment: str) -> str:
    child = Child(["-c", STARTED, domain], tmp_path / "started.log", environment)
    output = "".join(child.lines())
    assert child.wait() == 0, child.log.read_text()
    child.close()
    return output.strip()


def test_node_visible_to_other_machines_is_refused(domain_id, tmp_path):
    # A profile without our settings simulates a Fast DDS that does not read ours.
    unread = tmp_path / UDP_ON_THIS_MACHINE.name
    unread.write_text(WHOLE_NETWORK)
    line = started(tmp_path, domain_id, FASTRTPS_DEFAULT_PROFILES_FILE=str(unread))
    assert "'alone' would be visible to other machines" in line
    assert "\n" not in line


def test_subnet_range_opens_discovery(domain_id, tmp_path):
    profile = tmp_path / "user.xml"
    profile.write_text(WHOLE_NETWORK)
    environment = {
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(profile),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
    }
    assert started(tmp_path, domain_id, **environment) == "True"


def test_start_up_hook_keeps_process_arguments_and_streams():
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


def test_ros_starts_without_the_start_up_hook():
    program = "import rclpy.context as c; x = c.Context(); x.init(); x.shutdown(); print('up')"
    result = run_python("-c", program, env=WITHOUT_HOOK_VARIABLES)
    assert result.stdout.strip() == "up"
