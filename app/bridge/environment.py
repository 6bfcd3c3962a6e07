"""Environment variables that a process needs before it joins a ROS graph.

This module does not import ROS.

The ROS 2 wheels install a start-up hook (a ``.pth`` file) that re-executes the Python process
once, with ``LD_LIBRARY_PATH`` set to the libraries of the wheels. Consequences:

* Process id, arguments and standard streams stay the same. The start takes 50 to 100 ms longer.
* Child processes inherit ``LD_LIBRARY_PATH`` and the variable that marks the re-execution. A child
  in the same environment is not re-executed. A child in *another* environment with ROS wheels
  would load the libraries of this one: start it with `without_bootstrap`.
* ``python -S`` skips the hook, and the hook replaces a program that embeds Python. Both must set
  the two variables themselves.
"""

import os
from collections.abc import Mapping, MutableMapping, Sequence
from pathlib import Path

from app.bridge.errors import BridgeError

DOMAIN = "ROS_DOMAIN_ID"
DISCOVERY_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
UDP_ON_THIS_MACHINE = Path(__file__).with_name("udp_on_this_machine.xml")
"""Fast DDS profile equivalent to the discovery range ``LOCALHOST``, without shared memory."""

_SKIP_PROFILES_HERE = "SKIP_DEFAULT_XML_FILE"
_PROFILES_HERE = Path("DEFAULT_FASTRTPS_PROFILES.xml")
"""Fast DDS reads this file from the working directory, after the file named by `PROFILES`."""

_USER_VARIABLES: dict[str, tuple[str, ...]] = {
    PROFILES: (),
    "FASTDDS_DEFAULT_PROFILES_FILE": (),
    "RMW_IMPLEMENTATION": ("rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp"),
    "ROS_DISCOVERY_SERVER": (),
    "ROS_LOCALHOST_ONLY": ("0",),
    "ROS_STATIC_PEERS": (),
}
"""Variables with which a user configures discovery, each with the values that do not. Our profile
would override such a configuration, so it is not used then."""

_HOOK_VARIABLES = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")


def prepare_environment(environment: MutableMapping[str, str] | None = None) -> str:
    """Restrict discovery to this machine unless the user chose a range; return one log line.

    The transport is UDP only, unless the user chose another. With the shared-memory transport of
    Fast DDS 2.14, killing a peer can crash other participants on close: the listening thread
    recreates a damaged port while the closing thread waits for its old mutex. In the range
    ``LOCALHOST`` ROS always adds shared memory, whatever `TRANSPORTS` is, so a Fast DDS profile
    sets the same range instead. If Fast DDS does not read the profile, the node is visible in the
    whole network; `RosNode` detects that (`keeps_to_this_machine`).

    Call this before the first `app.bridge.node.RosNode` of the process, because ROS reads the
    variables when a context starts. An empty variable counts as unset, as in ROS.
    """
    variables = os.environ if environment is None else environment
    chosen = variables.get(DISCOVERY_RANGE, "")
    if keeps_to_this_machine(variables):  # set by a parent process
        del variables[PROFILES]
        chosen = "" if chosen == "SYSTEM_DEFAULT" else chosen
    if not variables.get(TRANSPORTS, ""):
        variables[TRANSPORTS] = "UDPv4"
    if chosen not in ("", "LOCALHOST"):
        return f"ROS discovery range is {chosen}, set by {DISCOVERY_RANGE}"
    user_configuration = _user_configuration(variables)
    # If the profile file were unreadable, discovery would cover the whole network.
    if (
        variables[TRANSPORTS] == "UDPv4"
        and not user_configuration
        and os.access(UDP_ON_THIS_MACHINE, os.R_OK)
    ):
        variables[DISCOVERY_RANGE] = "SYSTEM_DEFAULT"  # use the range of the profile
        variables[PROFILES] = str(UDP_ON_THIS_MACHINE)
        variables[_SKIP_PROFILES_HERE] = "1"  # the working directory may change later
    else:
        variables[DISCOVERY_RANGE] = "LOCALHOST"
    return _log_line(user_configuration)


def keeps_to_this_machine(environment: Mapping[str, str] | None = None) -> bool:
    """True if our Fast DDS profile is configured, which restricts discovery to this machine."""
    variables = os.environ if environment is None else environment
    return Path(variables.get(PROFILES, "")).name == UDP_ON_THIS_MACHINE.name


def _user_configuration(variables: Mapping[str, str]) -> list[str]:
    """Names of the variables and files with which the user has configured discovery."""
    found = [
        name
        for name, neutral in _USER_VARIABLES.items()
        if variables.get(name, "") not in ("", *neutral)
    ]
    if not variables.get(_SKIP_PROFILES_HERE, "").startswith("1") and _PROFILES_HERE.exists():
        found.append(str(_PROFILES_HERE))
    return found


def _log_line(user_configuration: Sequence[str] = ()) -> str:
    names = " and ".join(user_configuration)
    unless = f", unless {names} configures otherwise" if names else ""
    return f"ROS discovery stays on this machine{unless}; set {DISCOVERY_RANGE}=SUBNET to extend it"


def domain_of(environment: Mapping[str, str] | None = None) -> int:
    """The ROS domain, 0 by default; raises `BridgeError` for a text that is no number."""
    text = (os.environ if environment is None else environment).get(DOMAIN) or "0"
    try:
        return int(text)
    except ValueError as error:
        raise BridgeError(f"{DOMAIN} is {text!r}; expected a number") from error


def without_bootstrap(environment: Mapping[str, str]) -> dict[str, str]:
    """Copy of ``environment`` for a child process in another Python environment."""
    return {name: value for name, value in environment.items() if name not in _HOOK_VARIABLES}
