"""Independent ROS process that sends goals to an action with plain rclpy, one after the other.

    goal_sender.py NAME TYPE JSON ...

Each JSON is an object with the goal's fields; "cancel_after" is the number of feedback messages
after which the goal is cancelled. Prints ``ready``, then a line of JSON for each goal:
{"status", "feedback" (count), "first", "last" (feedback), "result"}, or {"status": "rejected"}.
"""

import json
import sys

import rclpy
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient

from tests.bridge.peers import as_plain, interface

STATUS = {
    GoalStatus.STATUS_SUCCEEDED: "succeeded",
    GoalStatus.STATUS_ABORTED: "aborted",
    GoalStatus.STATUS_CANCELED: "cancelled",
}


def main() -> int:
    rclpy.init()
    node = rclpy.create_node("goal_sender")
    kind = interface(sys.argv[2])
    client = ActionClient(node, kind, sys.argv[1])
    print("ready", flush=True)
    if not client.wait_for_server(30.0):
        return 1

    def wait(future):
        rclpy.spin_until_future_complete(node, future, timeout_sec=60.0)
        return future.result()

    def send(fields):
        cancel_after = fields.pop("cancel_after", None)
        feedback, accepted = [], []

        def cancel_when_due():
            if accepted and cancel_after is not None and len(feedback) >= cancel_after:
                accepted.pop().cancel_goal_async()

        def on_feedback(message):
            feedback.append(as_plain(message.feedback))
            cancel_when_due()

        handle = wait(client.send_goal_async(kind.Goal(**fields), feedback_callback=on_feedback))
        if not handle.accepted:
            return {"status": "rejected"}
        accepted.append(handle)
        cancel_when_due()
        reply = wait(handle.get_result_async())
        return {
            "status": STATUS.get(reply.status, reply.status),
            "feedback": len(feedback),
            "first": feedback[0] if feedback else None,
            "last": feedback[-1] if feedback else None,
            "result": as_plain(reply.result),
        }

    for argument in sys.argv[3:]:
        print(json.dumps(send(json.loads(argument))), flush=True)
    # Leave the graph: a server may wait for an acknowledgement of this process.
    client.destroy()
    node.destroy_node()
    rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
