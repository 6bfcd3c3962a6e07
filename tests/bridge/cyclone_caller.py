"""Process that calls services with Eclipse Cyclone DDS, without ROS.

    cyclone_caller.py NODE PARAMETER

Calls ``NODE/ping`` (std_srvs/Trigger) and reads the node's parameter, a double, with
``NODE/get_parameters``; prints each reply as a line of JSON. A service is a pair of topics,
``rq/NAMERequest`` and ``rr/NAMEReply``. The metadata of a sample identifies the request of a
reply. This reader does not see the metadata, so it has one pending request at a time.
"""

import json
import os
import sys

from cyclone_types import (
    GetParametersRequest,
    GetParametersResponse,
    TriggerRequest,
    TriggerResponse,
)
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

QOS = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.Durability.Volatile,
    Policy.History.KeepLast(10),
)
MAX_TRIES = 60


def call(participant, name, request, reply_type):
    """Return the first reply; repeats the request every second, because an early one is lost."""
    requests = Topic(participant, f"rq{name}Request", type(request), qos=QOS)
    replies = Topic(participant, f"rr{name}Reply", reply_type, qos=QOS)
    reader = DataReader(participant, replies, qos=QOS)
    writer = DataWriter(participant, requests, qos=QOS)
    for _ in range(MAX_TRIES):
        writer.write(request)
        for reply in reader.take_iter(timeout=duration(seconds=1)):
            return reply
    raise TimeoutError(f"{name} did not reply")


def main(node, parameter):
    participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    print("ready", flush=True)
    pong = call(participant, f"{node}/ping", TriggerRequest(0), TriggerResponse)
    print(json.dumps({"success": pong.success, "message": pong.message}), flush=True)
    found = call(
        participant,
        f"{node}/get_parameters",
        GetParametersRequest([parameter]),
        GetParametersResponse,
    )
    (value,) = found.values
    print(json.dumps({"type": value.type, "value": value.double_value}), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
