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
from collections.abc import Mapping, MutableMapping
from pathlib import Path

DISCOVERY_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
UDP_ON_THIS_MACHINE = Path(__file__).with_name("udp_on_this_machine.xml")
"""What ROS means by ``LOCALHOST``, without shared memory."""

_OF_THE_USER = (
    PROFILES,
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "RMW_IMPLEMENTATION",
    "ROS_LOCALHOST_ONLY",
    "ROS_STATIC_PEERS",
)
"""Who sets one of these has an arrangement of his own, which a profile of ours would undo."""

_ON_THIS_MACHINE = f"ROS discovery stays on this machine: set {DISCOVERY_RANGE}=SUBNET to open it"

_HOOK_VARIABLES = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")


def prepare_environment(environment: MutableMapping[str, str] | None = None) -> str:
    """Keep discovery on this machine unless the user chose a range; return one line for the log.

    Messages go by UDP alone, unless the user chose otherwise. With Fast DDS 2.14's shared memory a
    peer that is killed can crash the others when they close: the thread that listens makes a
    damaged port anew while the one that closes waits for its old mutex. In the range ``LOCALHOST``
    ROS adds shared memory whatever `TRANSPORTS` asks for, so that the same range is asked for by a
    profile of Fast DDS.

    Must be called before the first `app.bridge.node.RosNode` of the process, because ROS reads the
    variables when a context starts. An empty variable counts as unset, as it does for ROS.
    """
    variables = os.environ if environment is None else environment
    if variables.get(PROFILES, "") == str(UDP_ON_THIS_MACHINE):
        return _ON_THIS_MACHINE  # by a process before this one
    chosen = variables.get(DISCOVERY_RANGE, "")
    if not variables.get(TRANSPORTS, ""):
        variables[TRANSPORTS] = "UDPv4"
    if chosen in ("", "LOCALHOST") and _ours_to_arrange(variables):
        variables[DISCOVERY_RANGE] = "SYSTEM_DEFAULT"  # what the profile says, and no more
        variables[PROFILES] = str(UDP_ON_THIS_MACHINE)
    elif chosen:
        return f"ROS discovery range is {chosen}, as {DISCOVERY_RANGE} asks"
    else:
        variables[DISCOVERY_RANGE] = "LOCALHOST"
    return _ON_THIS_MACHINE


def _ours_to_arrange(variables: Mapping[str, str]) -> bool:
    # Without its file the profile would be the whole network.
    return (
        variables[TRANSPORTS] == "UDPv4"
        and not any(variables.get(name, "") for name in _OF_THE_USER)
        and UDP_ON_THIS_MACHINE.is_file()
    )


def without_bootstrap(environment: Mapping[str, str]) -> dict[str, str]:
    """A copy of ``environment`` for a child that belongs to another Python environment."""
    return {name: value for name, value in environment.items() if name not in _HOOK_VARIABLES}
