"""Check for open sockets that receive ROS discovery traffic of other machines."""

from pathlib import Path

_DISCOVERY_BASE, _PORTS_PER_DOMAIN = 7400, 250
"""Port of the discovery multicast of a domain (RTPS 2.3, 9.6.1.1)."""


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


def _sockets_of_this_process() -> frozenset[str]:
    found = set()
    for descriptor in Path("/proc/self/fd").iterdir():
        try:
            found.add(str(descriptor.readlink()))
        except FileNotFoundError:  # closed since the listing, as is the listing's own descriptor
            continue
    return frozenset(found)
