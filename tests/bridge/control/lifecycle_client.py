"""Independent ROS process that requests lifecycle transitions with plain rclpy.

    lifecycle_client.py NODE REQUEST ...

A request is a transition (``configure``, or its number) or ``state``. Prints ``ready``, then a line
of JSON for each: {"success"} or {"state"}.
"""

import json
import sys

import rclpy
from lifecycle_msgs.srv import ChangeState, GetState


def invalid_transition() -> ChangeState.Request:
    """Request of a transition that no state has."""
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
    # A server that has not discovered the client's reader drops its replies, so repeat a harmless
    # request until a reply arrives.
    for client, harmless in ((state, GetState.Request()), (change, invalid_transition())):
        for _ in range(15):
            future = client.call_async(harmless)
            rclpy.spin_until_future_complete(node, future, timeout_sec=2.0)
            if future.done():
                break
    print("ready", flush=True)
    for name in sys.argv[2:]:
        if name == "state":
            future = state.call_async(GetState.Request())
        else:
            request = ChangeState.Request()
            if name.isdigit():
                request.transition.id = int(name)
            else:
                request.transition.label = name
            future = change.call_async(request)
        rclpy.spin_until_future_complete(node, future, timeout_sec=30.0)
        reply = future.result()
        result = (
            {"state": reply.current_state.label} if name == "state" else {"success": reply.success}
        )
        print(json.dumps(result), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
