"""Process that sends goals with Eclipse Cyclone DDS, without ROS.

    cyclone_goal_sender.py NAME ACTION JSON ...

NAME serves ``marginguard_msgs/action/ACTION``. Each JSON is an object with the goal's fields;
"cancel" cancels the goal at its first feedback. Prints ``ready``, then the replies and messages of
each goal as a line of JSON. It imports neither the project nor ROS.
"""

import json
import os
import sys
import uuid
from dataclasses import asdict

from cyclone_types import (
    ACTIONS,
    UUID,
    CancelGoalRequest,
    CancelGoalResponse,
    GoalInfo,
    GoalStatusArray,
    Time,
)
from cyclonedds.core import DDSStatus, Policy, Qos, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

RELIABLE = Policy.Reliability.Reliable(duration(seconds=1))
QOS = Qos(RELIABLE, Policy.Durability.Volatile, Policy.History.KeepLast(1000))
LATCHED = Qos(RELIABLE, Policy.Durability.TransientLocal, Policy.History.KeepLast(1000))
MAX_TRIES = 60
DEADLINE_S = 80  # the first replay after a checkout compiles for up to a minute
ENDED = (4, 5, 6)  # succeeded, cancelled, aborted: action_msgs/GoalStatus


class Service:
    """Requests and replies of one service; one request at a time."""

    def __init__(self, participant, name, request_type, reply_type):
        requests = Topic(participant, f"rq/{name}Request", request_type, qos=QOS)
        replies = Topic(participant, f"rr/{name}Reply", reply_type, qos=QOS)
        self._reader = DataReader(participant, replies, qos=QOS)
        self._writer = DataWriter(participant, requests, qos=QOS)

    def send(self, request):
        self._writer.write(request)

    def reply(self, accept=lambda reply: True):
        return next_sample(self._reader, accept)

    def call(self, request):
        self.send(request)
        return self.reply()

    def is_served(self, request):
        """True if a reply arrives within a minute; repeats the request every second."""
        for _ in range(MAX_TRIES):
            self.send(request)
            for _ in self._reader.take_iter(timeout=duration(seconds=1)):
                return True
        return False


class Action:
    """The three services and two topics of an action."""

    def __init__(self, participant, action, types):
        self._participant = participant
        self._types = types
        name = f"{action.removeprefix('/')}/_action"
        self._status = DataReader(
            participant,
            Topic(participant, f"rt/{name}/status", GoalStatusArray, qos=LATCHED),
            qos=LATCHED,
        )
        self._feedback = DataReader(
            participant, Topic(participant, f"rt/{name}/feedback", types.feedback, qos=QOS), qos=QOS
        )
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
        self._feedback.set_status_mask(DDSStatus.SubscriptionMatched)
        waiting = WaitSet(self._participant)
        waiting.attach(self._feedback)
        if waiting.wait(timeout=duration(seconds=MAX_TRIES)) == 0:
            raise TimeoutError("no publisher of feedback found")
        if not self._result.is_served(self._result_request(UUID(bytes(16)))):
            raise TimeoutError("the action does not reply")

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


def next_sample(reader, accept=lambda sample: True):
    """Return the next sample that ``accept`` accepts; raises `TimeoutError`."""
    for sample in reader.take_iter(timeout=duration(seconds=DEADLINE_S)):
        if accept(sample):
            return sample
    raise TimeoutError(f"no expected sample on {reader.topic.name}")


def main(name, kind, *goals):
    participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    action = Action(participant, name, ACTIONS[kind])
    print("ready", flush=True)
    action.wait_for_server()
    for text in goals:
        fields = json.loads(text)
        cancel = fields.pop("cancel", False)
        print(json.dumps(action.send(fields, cancel)), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
