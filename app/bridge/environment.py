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

DISCOVERY_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
_HOOK_VARIABLES = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")


def prepare_environment(environment: MutableMapping[str, str] | None = None) -> str:
    """Keep discovery on this machine unless the user chose a range; return one line for the log.

    Messages go by UDP alone, unless the user chose otherwise. With Fast DDS 2.14's shared memory a
    peer that is killed can crash the others when they close: the thread that listens makes a
    damaged port anew while the one that closes waits for its old mutex.

    Must be called before the first `app.bridge.node.RosNode` of the process, because ROS reads the
    variables when a context starts. An empty variable counts as unset, as it does for ROS.
    """
    variables = os.environ if environment is None else environment
    if not variables.get(TRANSPORTS, ""):
        variables[TRANSPORTS] = "UDPv4"
    chosen = variables.get(DISCOVERY_RANGE, "")
    if chosen:
        return f"ROS discovery range is {chosen}, as {DISCOVERY_RANGE} asks"
    variables[DISCOVERY_RANGE] = "LOCALHOST"
    return f"ROS discovery stays on this machine: set {DISCOVERY_RANGE}=SUBNET to open it"


def without_bootstrap(environment: Mapping[str, str]) -> dict[str, str]:
    """A copy of ``environment`` for a child that belongs to another Python environment."""
    return {name: value for name, value in environment.items() if name not in _HOOK_VARIABLES}
