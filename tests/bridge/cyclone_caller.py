"""A process of another DDS implementation that calls services: Eclipse Cyclone DDS, without ROS.

    cyclone_caller.py NODE PARAMETER

Calls ``NODE/ping`` (std_srvs/Trigger) and asks for the node's parameter, a double, by
``NODE/get_parameters``; prints each reply as a line of JSON. A service is a pair of topics,
``rq/NAMERequest`` and ``rr/NAMEReply``. Which request a reply belongs to stands in the metadata
of the sample, which this reader does not see: it has one request under way at a time.
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
MOST_TRIES = 60


def call(participant, name, request, reply_type):
    """The first reply; the request is sent again every second, for an early one is dropped."""
    asked = Topic(participant, f"rq{name}Request", type(request), qos=QOS)
    answered = Topic(participant, f"rr{name}Reply", reply_type, qos=QOS)
    reader = DataReader(participant, answered, qos=QOS)
    writer = DataWriter(participant, asked, qos=QOS)
    for _ in range(MOST_TRIES):
        writer.write(request)
        for reply in reader.take_iter(timeout=duration(seconds=1)):
            return reply
    raise TimeoutError(f"{name} did not answer")


def main(node, parameter):
    participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    print("ready", flush=True)
    said = call(participant, f"{node}/ping", TriggerRequest(0), TriggerResponse)
    print(json.dumps({"success": said.success, "message": said.message}), flush=True)
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
