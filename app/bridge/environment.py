"""What a process must have in its environment before it joins a ROS graph.

Imports no ROS itself.

The wheels of ROS 2 bring a start-up hook (a ``.pth`` file) that replaces the Python process by
itself once, with ``LD_LIBRARY_PATH`` set to the wheels' libraries. What follows from it:

* Nothing is lost for ``marginguard``: same process id, same arguments, same standard streams; a
  start costs one more interpreter start-up, some 50 to 100 ms.
* Children inherit ``LD_LIBRARY_PATH`` and the guard variable. A child of the same environment does
  not start twice; a child of *another* environment with ROS wheels does not bootstrap at all and
  would load this one's libraries: start it with `without_bootstrap`.
* ``python -S`` and embedding programs skip the hook or are replaced by it: they must set both
  variables themselves.
"""

import os
from collections.abc import Mapping, MutableMapping, Sequence
from pathlib import Path

DISCOVERY_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
UDP_ON_THIS_MACHINE = Path(__file__).with_name("udp_on_this_machine.xml")
"""What ROS means by ``LOCALHOST``, without shared memory."""

_SKIP_PROFILES_HERE = "SKIP_DEFAULT_XML_FILE"
_PROFILES_HERE = Path("DEFAULT_FASTRTPS_PROFILES.xml")
"""Fast DDS reads it from the folder that a program runs in, after the file of `PROFILES`."""

_OF_THE_USER: dict[str, tuple[str, ...]] = {
    PROFILES: (),
    "FASTDDS_DEFAULT_PROFILES_FILE": (),
    "RMW_IMPLEMENTATION": ("rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp"),
    "ROS_DISCOVERY_SERVER": (),
    "ROS_LOCALHOST_ONLY": ("0",),
    "ROS_STATIC_PEERS": (),
}
"""Who sets one of these, but for the values beside it, has an arrangement of his own, which a
profile of ours would undo."""

_HOOK_VARIABLES = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")


def prepare_environment(environment: MutableMapping[str, str] | None = None) -> str:
    """Keep discovery on this machine unless the user chose a range; return one line for the log.

    Messages go by UDP alone, unless the user chose otherwise. With Fast DDS 2.14's shared memory a
    peer that is killed can crash the others when they close: the thread that listens makes a
    damaged port anew while the one that closes waits for its old mutex. In the range ``LOCALHOST``
    ROS adds shared memory whatever `TRANSPORTS` asks for, so that the same range is asked for by a
    profile of Fast DDS. Should Fast DDS not read it, the whole network would hear of us: a
    `RosNode` looks after that (`promises_this_machine`).

    Must be called before the first `app.bridge.node.RosNode` of the process, because ROS reads the
    variables when a context starts. An empty variable counts as unset, as it does for ROS.
    """
    variables = os.environ if environment is None else environment
    chosen = variables.get(DISCOVERY_RANGE, "")
    if promises_this_machine(variables):  # by a process before this one
        del variables[PROFILES]
        chosen = "" if chosen == "SYSTEM_DEFAULT" else chosen
    if not variables.get(TRANSPORTS, ""):
        variables[TRANSPORTS] = "UDPv4"
    if chosen not in ("", "LOCALHOST"):
        return f"ROS discovery range is {chosen}, as {DISCOVERY_RANGE} asks"
    arranged = _arranged_by_the_user(variables)
    # Without its file the profile would be the whole network.
    if (
        variables[TRANSPORTS] == "UDPv4"
        and not arranged
        and os.access(UDP_ON_THIS_MACHINE, os.R_OK)
    ):
        variables[DISCOVERY_RANGE] = "SYSTEM_DEFAULT"  # what the profile says, and no more
        variables[PROFILES] = str(UDP_ON_THIS_MACHINE)
        variables[_SKIP_PROFILES_HERE] = "1"  # a child, or we later, may run in another folder
    else:
        variables[DISCOVERY_RANGE] = "LOCALHOST"
    return _on_this_machine(arranged)


def promises_this_machine(environment: Mapping[str, str] | None = None) -> bool:
    """Whether discovery is to stay on this machine because a profile of ours says so."""
    variables = os.environ if environment is None else environment
    return Path(variables.get(PROFILES, "")).name == UDP_ON_THIS_MACHINE.name


def _arranged_by_the_user(variables: Mapping[str, str]) -> list[str]:
    arranged = [
        name
        for name, harmless in _OF_THE_USER.items()
        if variables.get(name, "") not in ("", *harmless)
    ]
    if not variables.get(_SKIP_PROFILES_HERE, "").startswith("1") and _PROFILES_HERE.exists():
        arranged.append(str(_PROFILES_HERE))
    return arranged


def _on_this_machine(arranged: Sequence[str] = ()) -> str:
    but = f", but for what {' and '.join(arranged)} may say" if arranged else ""
    return f"ROS discovery stays on this machine{but}: set {DISCOVERY_RANGE}=SUBNET to open it"


def without_bootstrap(environment: Mapping[str, str]) -> dict[str, str]:
    """A copy of ``environment`` for a child that belongs to another Python environment."""
    return {name: value for name, value in environment.items() if name not in _HOOK_VARIABLES}
