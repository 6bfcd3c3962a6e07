"""Independent ROS process that adds a structure to a live session, and switches it off and on.

Prints a line of JSON with what the constraint has after each request. It does not import the
project.
"""

import sys

from tests.bridge.faults.authority_peer import UNKNOWN, Peer
from tests.bridge.service_calls import structure, switch


def main() -> int:
    peer = Peer()
    if peer.until(lambda message: message.state != UNKNOWN).hold:
        peer.rearm_as_operator()

    def report(reply, *, hold):
        """The first constraint of the new setup that is known, and on hold or not."""
        message = peer.until(
            lambda each: (
                each.setup_id == reply.setup_id and each.state != UNKNOWN and each.hold == hold
            )
        )
        peer.report(
            success=reply.success,
            message=reply.message,
            structures=[each.name for each in message.structures],
            off={each.name: each.reason for each in message.off},
            causes=list(message.hold_causes),
        )

    peer.until(lambda message: message.state != UNKNOWN and not message.hold)
    report(peer.call("set_structure", structure(0.01)), hold=False)
    off = peer.call("switch_structure", switch(False, "resected\n at 10:42"))
    report(off, hold=True)
    peer.rearm_as_operator("structure 'vessel' switched off")
    report(off, hold=False)
    on = peer.call("switch_structure", switch(True, "it was the other one"))
    report(on, hold=False)
    report(peer.call("set_structure", structure(0.005)), hold=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
