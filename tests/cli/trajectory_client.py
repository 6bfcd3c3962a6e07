"""Process with plain rclpy that sends a goal to ``/marginguard_plan/follow_joint_trajectory``.

``python trajectory_client.py`` waits for the server and prints ``ready``; then each line of its
input is ``{"joints": [...], "points": [[seconds, positions, velocities], ...], "cancel": 0.2}`` in
JSON. It cancels after ``cancel`` s of the motion, or before it for a negative one, and prints the
feedback and the result as JSON.
"""

import json
import sys

import rclpy
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from trajectory_msgs.msg import JointTrajectoryPoint


def main():
    rclpy.init()
    node = rclpy.create_node("trajectory_client")
    name = "/marginguard_plan/follow_joint_trajectory"
    client = ActionClient(node, FollowJointTrajectory, name)
    client.wait_for_server()
    print("ready", flush=True)
    for line in sys.stdin:
        print(json.dumps(execute(node, client, json.loads(line))), flush=True)


def execute(node, client, request):
    goal = FollowJointTrajectory.Goal()
    goal.trajectory.joint_names = request["joints"]
    for seconds, positions, velocities in request["points"]:
        point = JointTrajectoryPoint(positions=positions, velocities=velocities)
        point.time_from_start.sec, point.time_from_start.nanosec = divmod(
            round(seconds * 1e9), 10**9
        )
        goal.trajectory.points.append(point)
    feedback, cancels = [], []

    def take(message):
        seen = message.feedback
        at = seen.desired.time_from_start
        at_s = at.sec + 1e-9 * at.nanosec
        rows = [list(each.positions) for each in (seen.desired, seen.actual, seen.error)]
        feedback.append([at_s, list(seen.joint_names), *rows])
        if request["cancel"] is not None and at_s > request["cancel"] and not cancels:
            cancels.append(handle.cancel_goal_async())

    sent = client.send_goal_async(goal, feedback_callback=take)
    rclpy.spin_until_future_complete(node, sent)
    handle = sent.result()
    if not handle.accepted:
        return {"status": "rejected"}
    if request["cancel"] is not None and request["cancel"] < 0.0:
        handle.cancel_goal_async()
    ended = handle.get_result_async()
    rclpy.spin_until_future_complete(node, ended)
    result = ended.result()
    return {
        "status": result.status,
        "code": result.result.error_code,
        "text": result.result.error_string,
        "feedback": feedback,
    }


if __name__ == "__main__":
    main()
