"""The other process of the round trips: sends messages back, serves a service and an action.

Says "ready" when everything is up, and ends when its standard input is closed.
"""

import sys
import threading

import rclpy
from geometry_msgs.msg import Transform
from marginguard_msgs.action import Replay
from marginguard_msgs.msg import FixtureConstraint
from marginguard_msgs.srv import Register
from rclpy.action import ActionServer
from rclpy.action.server import ServerGoalHandle
from rclpy.executors import ExternalShutdownException
from tf2_msgs.msg import TFMessage


def register(request: Register.Request, response: Register.Response) -> Register.Response:
    """Answer with a translation: the sum of the moving points."""
    response.success = len(request.fixed_points) == len(request.moving_points)
    response.message = f"{request.fixed_frame} from {request.moving_frame}"
    response.transform = Transform()
    response.transform.translation.x = sum(point.x for point in request.moving_points)
    return response


def replay(goal: ServerGoalHandle) -> Replay.Result:
    """Give feedback for each second of the part to play, then succeed."""
    seconds = int(goal.request.end - goal.request.start)
    for second in range(seconds):
        goal.publish_feedback(
            Replay.Feedback(
                time=goal.request.start + second,
                duration=goal.request.end,
                state=FixtureConstraint.WARNING,
                signed_distance=float("nan"),
            )
        )
    goal.succeed()
    return Replay.Result(success=True, message=goal.request.case_folder, frames=seconds)


def main() -> None:
    """Serve until the standard input ends."""
    rclpy.init()
    node = rclpy.create_node("peer")
    for name, kind in (("tf", TFMessage), ("constraint", FixtureConstraint)):
        back = node.create_publisher(kind, f"{name}_back", 10)
        node.create_subscription(kind, f"{name}_out", back.publish, 10)
    node.create_service(Register, "register", register)
    action = ActionServer(node, Replay, "replay", replay)

    def end_with_input() -> None:
        sys.stdin.read()
        rclpy.try_shutdown()

    threading.Thread(target=end_with_input, daemon=True).start()
    print("ready", flush=True)
    try:
        rclpy.spin(node)
    except ExternalShutdownException:
        action.destroy()
        node.destroy_node()


if __name__ == "__main__":
    main()
