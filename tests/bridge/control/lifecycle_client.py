"""An independent ROS process that leads a node through its life cycle, by rclpy alone.

    lifecycle_client.py NODE WORD ...

A word is a transition (``configure``, or its number) or ``state``. Prints ``ready``, then a line of
JSON for each: {"success"} or {"state"}.
"""

import json
import sys

import rclpy
from lifecycle_msgs.srv import ChangeState, GetState


def impossible() -> ChangeState.Request:
    """A transition that no state knows."""
    request = ChangeState.Request()
    request.transition.id = 200
    return request


def main() -> int:
    rclpy.init()
    node = rclpy.create_node("lifecycle_client")
    change = node.create_client(ChangeState, f"{sys.argv[1]}/change_state")
    state = node.create_client(GetState, f"{sys.argv[1]}/get_state")
    if not (change.wait_for_service(30.0) and state.wait_for_service(30.0)):
        return 1
    # A server that has not found the client's reader yet answers it in vain, so both are asked for
    # something harmless until they do.
    for client, harmless in ((state, GetState.Request()), (change, impossible())):
        for _ in range(15):
            future = client.call_async(harmless)
            rclpy.spin_until_future_complete(node, future, timeout_sec=2.0)
            if future.done():
                break
    print("ready", flush=True)
    for word in sys.argv[2:]:
        if word == "state":
            future = state.call_async(GetState.Request())
        else:
            request = ChangeState.Request()
            if word.isdigit():
                request.transition.id = int(word)
            else:
                request.transition.label = word
            future = change.call_async(request)
        rclpy.spin_until_future_complete(node, future, timeout_sec=30.0)
        reply = future.result()
        said = (
            {"state": reply.current_state.label} if word == "state" else {"success": reply.success}
        )
        print(json.dumps(said), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
