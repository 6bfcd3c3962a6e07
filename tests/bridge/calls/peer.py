"""Independent ROS process with parameters, services and an action, with plain rclpy.

    peer.py

Prints ``ready``, then a line of JSON for each event; serves until it is killed or ``/peer/leave``
is called. It does not import the project.

    /peer parameters    gain (0 to 10), names, table, level (read only)
    /peer/echo          SetBool: replies the value of the request
    /peer/slow          Trigger: replies after /peer/go is called
    /peer/go            Trigger
    /peer/leave         Trigger: ends the process without a reply
    /peer/lookup        tf2_msgs LookupTransform: source_frame selects the outcome; prints "found"
                        when it has discovered a client, whose replies would be lost before
"""

import contextlib
import json
import os
import sys
import threading

import rclpy
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from std_srvs.srv import SetBool, Trigger
from tf2_msgs.action import LookupTransform


def report(**values):
    print(json.dumps(values), flush=True)


def main() -> int:
    rclpy.init()
    node = rclpy.create_node("peer")
    group = ReentrantCallbackGroup()
    go = threading.Event()

    node.declare_parameter(
        "gain",
        1.5,
        ParameterDescriptor(
            description="of the loop",
            floating_point_range=[FloatingPointRange(from_value=0.0, to_value=10.0)],
        ),
    )
    node.declare_parameter("names", ["a", "b"])
    node.declare_parameter("table", [1, 2, 3])
    node.declare_parameter("arm.reach", 0.75)
    node.declare_parameter("level", 3, ParameterDescriptor(read_only=True))
    node.declare_parameter("blank", descriptor=ParameterDescriptor(dynamic_typing=True))

    def accept(parameters):
        for parameter in parameters:
            if parameter.name == "gain" and parameter.value == 6.0:
                return SetParametersResult(successful=False, reason="six is too loud")
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(accept)

    def echo(request, response):
        response.success, response.message = request.data, "echoed"
        return response

    def slow(_, response):
        report(slow="waits")
        go.wait(30.0)
        response.success, response.message = True, "at last"
        return response

    def release(_, response):
        go.set()
        response.success = True
        return response

    def leave(_, response):
        node.destroy_node()
        os._exit(0)

    node.create_service(SetBool, "~/echo", echo, callback_group=group)
    node.create_service(Trigger, "~/slow", slow, callback_group=group)
    node.create_service(Trigger, "~/go", release, callback_group=group)
    node.create_service(Trigger, "~/leave", leave, callback_group=group)

    cancelled = threading.Event()

    def take_goal(goal):
        rejected = goal.source_frame == "reject"
        return GoalResponse.REJECT if rejected else GoalResponse.ACCEPT

    def take_cancel(handle):
        if handle.request.source_frame == "stubborn":
            return CancelResponse.REJECT
        cancelled.set()
        return CancelResponse.ACCEPT

    def run(handle):
        outcome = handle.request.source_frame
        for _ in range(3):
            handle.publish_feedback(LookupTransform.Feedback())
        result = LookupTransform.Result()
        result.transform.child_frame_id = outcome
        if outcome == "cancel":
            report(goal="waits")
            cancelled.wait(30.0)
            # The cancel callback returns before the state of the goal changes.
            while not handle.is_cancel_requested:
                cancelled.wait(0.001)
            handle.canceled()
            report(goal="cancelled")
        elif outcome == "abort":
            handle.abort()
        elif outcome == "stubborn":
            go.wait(30.0)
            handle.succeed()
        else:
            handle.succeed()
        return result

    ActionServer(
        node,
        LookupTransform,
        "~/lookup",
        run,
        goal_callback=take_goal,
        cancel_callback=take_cancel,
        callback_group=group,
    )

    def look_for_client():
        # A client creates this reader last, and readers are discovered in order of creation.
        if node.count_subscribers("/peer/lookup/_action/status"):
            timer.cancel()
            report(lookup="found")

    timer = node.create_timer(0.02, look_for_client)
    executor = MultiThreadedExecutor(6)
    executor.add_node(node)
    print("ready", flush=True)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()
    return 0


if __name__ == "__main__":
    sys.exit(main())
