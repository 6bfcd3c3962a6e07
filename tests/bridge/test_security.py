"""A request for ROS security that this process cannot meet is refused with one line."""

import os

import pytest

from app.bridge.environment import SecurityError, check_security, library_without_security
from app.cli.main import main
from tests.python_process import run_python

pytestmark = pytest.mark.slow

ASKED = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"}


@pytest.fixture
def keystore(tmp_path):
    (tmp_path / "enclaves").mkdir()
    return {**ASKED, "ROS_SECURITY_KEYSTORE": str(tmp_path)}


@pytest.mark.parametrize("environment", [{}, {"ROS_SECURITY_ENABLE": "false"}])
def test_without_a_request_nothing_is_checked(environment):
    check_security(environment=environment)


@pytest.mark.parametrize(
    ("environment", "message"),
    [
        ({"ROS_SECURITY_ENABLE": "1"}, "ROS_SECURITY_ENABLE is '1'; expected 'true'"),
        ({"ROS_SECURITY_ENABLE": "TRUE"}, "ROS_SECURITY_ENABLE is 'TRUE'; expected 'true'"),
        ({"ROS_SECURITY_ENABLE": "true"}, "ROS_SECURITY_STRATEGY is ''; expected 'Enforce'"),
        ({**ASKED, "ROS_SECURITY_STRATEGY": "Permissive"}, "expected 'Enforce'"),
        (ASKED, "ROS_SECURITY_KEYSTORE is ''; expected the folder of a keystore"),
        ({**ASKED, "ROS_SECURITY_KEYSTORE": "/"}, "expected the folder of a keystore"),
    ],
)
def test_settings_with_which_ros_would_run_unprotected_are_refused(environment, message):
    with pytest.raises(SecurityError, match=message):
        check_security(environment=environment)


def test_required_security_without_variables_is_refused():
    with pytest.raises(SecurityError, match="asked for by security: required, but"):
        check_security(required=True, environment={})


def test_library_without_security_is_recognised_by_its_content(tmp_path):
    library = tmp_path / "librmw_fastrtps_shared_cpp.so.1"
    library.write_bytes(b"\x7fELF This Fast DDS version doesn't have the security libraries\0")
    assert library_without_security([library]) == library
    library.write_bytes(b"\x7fELF dds.sec.auth.plugin")
    assert library_without_security([library]) is None
    other = tmp_path / "librmw_cyclonedds_cpp.so"
    other.write_bytes(b"doesn't have the security libraries")
    assert library_without_security([other]) is None


def test_loaded_middleware_agrees_with_an_attempt_to_start_a_node(keystore):
    """The check of the file says what the middleware itself does when it is asked for security."""
    code = "import rclpy; rclpy.init(); rclpy.create_node('secure')"
    tried = run_python("-c", code, status=None, env={**os.environ, **keystore}, timeout=60)
    without = "doesn't have the security libraries" in tried.stderr
    assert (library_without_security() is not None) is without
    if without:
        with pytest.raises(SecurityError, match="compiled without it, as all ROS 2 wheels are"):
            check_security(environment=keystore)


@pytest.mark.parametrize(
    "command",
    [
        ["live", "--config", "package://marginguard/live_example/live.yaml"],
        ["rearm", "--yes"],
        ["tracker", "package://marginguard/recorded_case"],
        ["record", "-o", "OUTPUT"],
        ["tracker", "igtl", "--host", "localhost"],
        ["serve", "--cases", "."],
    ],
    ids=lambda command: " ".join(command[:2]),
)
def test_every_ros_command_refuses_to_start(monkeypatch, capsys, tmp_path, command):
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    output = tmp_path / "case"
    assert main([str(output) if each == "OUTPUT" else each for each in command]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert "ROS security: asked for by ROS_SECURITY_ENABLE=true, but" in lines[-1]
    assert not output.exists()
