"""Whether this process listens for ROS nodes of other machines: asked of the kernel."""

from pathlib import Path

_DISCOVERY_BASE, _PORTS_OF_A_DOMAIN = 7400, 250
"""RTPS 2.3, 9.6.1.1: where all participants of a domain listen to the multicast of discovery."""


def hears_other_machines(domain_id: int) -> bool:
    """True when a socket of this process is open to the discovery of all in ``domain_id``.

    False also where there is no ``/proc`` (Linux has it).
    """
    table = Path("/proc/self/net/udp")
    if not table.is_file():
        return False
    wanted = _DISCOVERY_BASE + _PORTS_OF_A_DOMAIN * domain_id
    ours = _sockets_of_this_process()
    for line in table.read_text(encoding="ascii").splitlines()[1:]:
        fields = line.split()
        port = int(fields[1].rpartition(":")[2], base=16)
        if port == wanted and f"socket:[{fields[9]}]" in ours:
            return True
    return False


def _sockets_of_this_process() -> frozenset[str]:
    found = set()
    for descriptor in Path("/proc/self/fd").iterdir():
        try:
            found.add(str(descriptor.readlink()))
        except FileNotFoundError:  # closed meanwhile, as is the listing's own
            continue
    return frozenset(found)
