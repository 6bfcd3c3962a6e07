"""Process that sends goals with Eclipse Cyclone DDS, without ROS.

    cyclone_goal_sender.py NAME ACTION JSON ...

NAME serves ``marginguard_msgs/action/ACTION``. Each JSON is an object with the goal's fields;
"cancel" cancels the goal at its first feedback. Prints ``ready``, then the replies and messages of
each goal as a line of JSON. It imports neither the project nor ROS.
"""

import json
import sys
import uuid
from dataclasses import asdict

from cyclone_peers import LATCHED, Service, next_sample, participant, reader, wait_for_publisher
from cyclone_types import (
    ACTIONS,
    UUID,
    CancelGoalRequest,
    CancelGoalResponse,
    GoalInfo,
    GoalStatusArray,
    Time,
)

ENDED = (4, 5, 6)  # succeeded, cancelled, aborted: action_msgs/GoalStatus


class Action:
    """The three services and two topics of an action."""

    def __init__(self, participant, action, types):
        self._participant = participant
        self._types = types
        name = f"{action.removeprefix('/')}/_action"
        self._status = reader(participant, f"rt/{name}/status", GoalStatusArray, LATCHED)
        self._feedback = reader(participant, f"rt/{name}/feedback", types.feedback)
        self._goal = Service(participant, f"{name}/send_goal", *types.send_goal)
        self._cancel = Service(
            participant, f"{name}/cancel_goal", CancelGoalRequest, CancelGoalResponse
        )
        self._result = Service(participant, f"{name}/get_result", *types.get_result)

    def wait_for_server(self):
        """Wait for the feedback publisher, then request an unknown result until a reply arrives.

        Endpoints are announced in the order of their creation. A server that has discovered our
        last service has discovered all of them. It creates its topics after its services, so its
        services are discovered once its topics are.
        """
        wait_for_publisher(self._participant, self._feedback)
        self._result.first_reply(self._result_request(UUID(bytes(16))))

    def send(self, fields, cancel):
        key, goal = UUID(uuid.uuid4().bytes), self._types.goal(**fields)
        goal_request, _ = self._types.send_goal
        if not self._goal.call(goal_request(key, goal)).accepted:
            raise ValueError(f"rejected: {goal}")
        first = next_sample(self._feedback, lambda message: message.goal_id == key)
        cancelled = None
        if cancel:
            reply = self._cancel.call(CancelGoalRequest(GoalInfo(key, Time(0, 0))))
            own = [info.goal_id == key for info in reply.goals_canceling]
            cancelled = {"return_code": reply.return_code, "own": own}
        self._result.send(self._result_request(key))
        # Late replies to `wait_for_server` have status 0, unknown.
        result = self._result.reply(lambda reply: reply.status != 0)
        return {
            "first": asdict(first.feedback),
            "cancel": cancelled,
            "states": self._states(key),
            "status": result.status,
            "result": asdict(result.result),
        }

    def _result_request(self, key):
        request, _ = self._types.get_result
        return request(key)

    def _states(self, key):
        """All states of the goal up to a terminal one."""
        states = []

        def has_ended(message):
            new = [each.status for each in message.status_list if each.goal_info.goal_id == key]
            states.extend(new)
            return new and new[-1] in ENDED

        next_sample(self._status, has_ended)
        return states


def main(name, kind, *goals):
    action = Action(participant(), name, ACTIONS[kind])
    print("ready", flush=True)
    action.wait_for_server()
    for text in goals:
        fields = json.loads(text)
        cancel = fields.pop("cancel", False)
        print(json.dumps(action.send(fields, cancel)), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
