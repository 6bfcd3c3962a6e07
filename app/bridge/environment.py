"""Environment variables, security and sockets of a process on a ROS graph.

This module does not import ROS.

The ROS 2 wheels install a start-up hook (a ``.pth`` file) that re-executes the Python process
once, with ``LD_LIBRARY_PATH`` set to the libraries of the wheels. Consequences:

* Process id, arguments and standard streams stay the same. The start takes 50 to 100 ms longer.
* Child processes inherit ``LD_LIBRARY_PATH`` and the variable that marks the re-execution. A child
  in the same environment is not re-executed. A child in *another* environment with ROS wheels
  would load the libraries of this one: start it without the two variables.
* ``python -S`` skips the hook, and the hook replaces a program that embeds Python. Both must set
  the two variables themselves.

The Fast DDS of the ROS 2 wheels is compiled without its security plugins. Then ROS itself stops
with an internal error in some configurations, and runs unprotected in others: it reads no other
value of ``ROS_SECURITY_ENABLE`` than ``true``, and without ``ROS_SECURITY_STRATEGY=Enforce`` a
participant without keys joins unprotected. `check_security` refuses to run unprotected.

Nor does it destroy a participant safely by itself: `finish_discovery`.
"""

import ctypes
import os
import re
from collections.abc import Iterable, Mapping, MutableMapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from app.bridge.ros_errors import BridgeError

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


ENABLE = "ROS_SECURITY_ENABLE"
STRATEGY = "ROS_SECURITY_STRATEGY"
KEYSTORE = "ROS_SECURITY_KEYSTORE"

_ENFORCE = "Enforce"
_WITHOUT_PLUGINS = b"doesn't have the security libraries"
"""Text of rmw_fastrtps that it contains only if it was compiled without security."""

_LOADED = os.RTLD_NOLOAD | os.RTLD_NOW
_PARTICIPANT = "_ZN16rmw_fastrtps_cpp22get_domain_participantEP10rmw_node_s"
_SET_LISTENER = (
    "_ZN8eprosima7fastdds3dds17DomainParticipant12set_listenerEPNS1_25DomainParticipantListenerE"
    "NSt6chrono8durationIlSt5ratioILl1ELl1EEEE"
)
"""``DomainParticipant::set_listener(DomainParticipantListener *, std::chrono::seconds)``."""

_FAST_DDS = re.compile(r"librmw_fastrtps_shared_cpp\.so")
_MAPPED = Path("/proc/self/maps")

_DISCOVERY_BASE, _PORTS_PER_DOMAIN = 7400, 250
"""Port of the discovery multicast of a domain (RTPS 2.3, 9.6.1.1)."""


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
    names = " and ".join(user_configuration)
    unless = f", unless {names} configures otherwise" if names else ""
    return f"ROS discovery stays on this machine{unless}; set {DISCOVERY_RANGE}=SUBNET to extend it"


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


def domain_of() -> int:
    """The ROS domain, 0 by default; raises `BridgeError` for a text that is no number."""
    text = os.environ.get(DOMAIN) or "0"
    try:
        return int(text)
    except ValueError as error:
        raise BridgeError(f"{DOMAIN} is {text!r}; expected a number") from error


class SecurityError(BridgeError):
    """Security is asked for and cannot be had, or not as asked for."""


def check_security(*, required: bool = False, environment: Mapping[str, str] = os.environ) -> None:
    """Raise `SecurityError` if security is asked for and this process would not have it.

    It is asked for by ``ROS_SECURITY_ENABLE`` with any value but ``false``, and by ``required``
    (``security: required`` in live.yaml), which then needs the variables as well. Call it before
    the first node. Loads the middleware.
    """
    enable = environment.get(ENABLE, "")
    if enable in ("", "false") and not required:
        return
    problem = _problem_of_settings(environment)
    if problem:
        asked = "security: required" if enable in ("", "false") else f"{ENABLE}={enable}"
        raise SecurityError(f"ROS security: asked for by {asked}, but {problem}")
    library = library_without_security()
    if library is not None:
        raise SecurityError(
            f"ROS security: asked for, but {library.name} is compiled without it, as all ROS 2 "
            "wheels are; expected a desktop installation of ROS (docs/security_ros.md), or "
            f"{ENABLE}=false to run unprotected"
        )


def _problem_of_settings(environment: Mapping[str, str]) -> str:
    enable, strategy = environment.get(ENABLE, ""), environment.get(STRATEGY, "")
    if enable != "true":
        return f"{ENABLE} is {enable!r}; expected 'true', the only value that ROS reads"
    if strategy != _ENFORCE:
        return (
            f"{STRATEGY} is {strategy!r}; expected {_ENFORCE!r}: with any other value ROS runs "
            "unprotected without keys"
        )
    keystore = environment.get(KEYSTORE, "")
    if not keystore or not Path(keystore, "enclaves").is_dir():
        return f"{KEYSTORE} is {keystore!r}; expected the folder of a keystore with 'enclaves'"
    return ""


def library_without_security(libraries: Iterable[Path] | None = None) -> Path | None:
    """The loaded middleware if it is compiled without security; None if it has it or is unknown.

    Another middleware than Fast DDS is not recognised: with ``Enforce`` ROS itself refuses to start
    where its security is missing. ``libraries`` replaces the shared libraries of this process.
    """
    for library in _loaded_libraries() if libraries is None else libraries:
        if _FAST_DDS.match(library.name) and _WITHOUT_PLUGINS in library.read_bytes():
            return library
    return None


def _loaded_libraries() -> list[Path]:
    """Shared libraries of this process after the middleware was loaded."""
    from rclpy.utilities import get_rmw_implementation_identifier

    get_rmw_implementation_identifier()
    try:
        lines = _MAPPED.read_text().splitlines()
    except OSError:
        return []
    names = {line.split(maxsplit=5)[5] for line in lines if line.count("/")}
    return sorted(Path(name) for name in names if name.startswith("/"))


def listens_to_other_machines(domain_id: int) -> bool:
    """True if this process has a socket on the multicast discovery port of ``domain_id``.

    False on systems without ``/proc``.
    """
    table = Path("/proc/self/net/udp")
    if not table.is_file():
        return False
    discovery_port = _DISCOVERY_BASE + _PORTS_PER_DOMAIN * domain_id
    own_sockets = _sockets_of_this_process()
    for line in table.read_text(encoding="ascii").splitlines()[1:]:
        fields = line.split()
        port = int(fields[1].rpartition(":")[2], base=16)
        if port == discovery_port and f"socket:[{fields[9]}]" in own_sockets:
            return True
    return False


def finish_discovery(rcl_node: int) -> None:
    """Wait until Fast DDS is in no discovery callback for a node, 5 s at most, and end them.

    ``rcl_node`` is the address of the ``rcl_node_t``, which must be the only one of its context and
    is destroyed next. Fast DDS itself waits for a callback without a limit: the deadline overflows,
    it spins with the lock that the callback needs, and the process hangs for good, with Python's
    lock (Fast-DDS issue 6513). Another middleware is left alone.
    """
    with suppress(AttributeError, OSError):
        if participant := fast_dds_participant(rcl_node):
            fast_dds(_SET_LISTENER)(ctypes.c_void_p(participant), None, ctypes.c_int64(5))


def fast_dds_participant(rcl_node: int) -> int | None:
    """Address of the ``DomainParticipant`` of the ``rcl_node_t`` at ``rcl_node``.

    None of another middleware; raises as `fast_dds`.
    """
    rmw_node = ctypes.CDLL("librcl.so", mode=_LOADED).rcl_node_get_rmw_handle
    participant = fast_dds(_PARTICIPANT)
    rmw_node.restype = participant.restype = ctypes.c_void_p
    address: int | None = participant(ctypes.c_void_p(rmw_node(ctypes.c_void_p(rcl_node))))
    return address


def fast_dds(name: str) -> Any:
    """A function of the loaded libraries of Fast DDS by its C++ ``name``.

    Raises `OSError` or `AttributeError` if this process has none.
    """
    return getattr(ctypes.CDLL("librmw_fastrtps_cpp.so", mode=_LOADED), name)


def _sockets_of_this_process() -> frozenset[str]:
    found = set()
    for descriptor in Path("/proc/self/fd").iterdir():
        try:
            found.add(str(descriptor.readlink()))
        except FileNotFoundError:  # closed since the listing, as is the listing's own descriptor
            continue
    return frozenset(found)
