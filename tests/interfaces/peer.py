"""ROS process that returns messages and serves a service and an action.

Prints ``ready`` when everything is created, and ends when its standard input is closed.
"""

import sys
import threading

import rclpy
from geometry_msgs.msg import Transform
from marginguard_msgs.action import Replay
from marginguard_msgs.msg import FixtureConstraint
from marginguard_msgs.srv import Register
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.task import Future
from tf2_msgs.msg import TFMessage

FEEDBACK_PERIOD_S = 0.05
ending = threading.Event()


def register(request: Register.Request, response: Register.Response) -> Register.Response:
    """Reply with a translation whose x is the sum of the moving points' x."""
    response.success = len(request.fixed_points) == len(request.moving_points)
    response.message = f"{request.fixed_frame} from {request.moving_frame}"
    response.transform = Transform()
    response.transform.translation.x = sum(point.x for point in request.moving_points)
    return response


def replay(goal: ServerGoalHandle) -> Replay.Result:
    """Publish feedback until the goal is cancelled or ``goal.request.end`` s have passed.

    Feedback published before discovery is complete is lost, so the client cancels when it has some.
    """
    for frames in range(int(goal.request.end / FEEDBACK_PERIOD_S)):
        if goal.is_cancel_requested:
            goal.canceled()
            return Replay.Result(success=False, message=goal.request.case_folder, frames=frames)
        goal.publish_feedback(
            Replay.Feedback(
                time=goal.request.start,
                duration=goal.request.end,
                frames=frames,
                state=FixtureConstraint.WARNING,
                signed_distance=float("nan"),
            )
        )
        if ending.wait(FEEDBACK_PERIOD_S):
            break
    goal.abort()
    return Replay.Result(success=False, message="never cancelled")


def main() -> None:
    """Serve until the standard input ends."""
    rclpy.init()
    node = rclpy.create_node("peer")
    for name, kind in (("tf", TFMessage), ("constraint", FixtureConstraint)):
        back = node.create_publisher(kind, f"{name}_back", 10)
        node.create_subscription(kind, f"{name}_out", back.publish, 10)
    node.create_service(Register, "register", register)
    action = ActionServer(
        node,
        Replay,
        "replay",
        replay,
        cancel_callback=lambda goal: CancelResponse.ACCEPT,
        callback_group=ReentrantCallbackGroup(),
    )

    executor = MultiThreadedExecutor(6)  # a goal whose acceptance was lost keeps its thread
    executor.add_node(node)
    ended = Future()

    def end_with_input() -> None:
        sys.stdin.read()
        ending.set()
        ended.set_result(None)
        executor.wake()

    threading.Thread(target=end_with_input, daemon=True).start()
    print("ready", flush=True)
    executor.spin_until_future_complete(ended)
    # Finish the pending replies before the context is shut down.
    executor.shutdown()
    action.destroy()
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
