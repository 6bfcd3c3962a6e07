"""Process that calls services with Eclipse Cyclone DDS, without ROS.

    cyclone_caller.py NODE PARAMETER

Calls ``NODE/ping`` (std_srvs/Trigger) and reads the node's parameter, a double, with
``NODE/get_parameters``; prints each reply as a line of JSON.
"""

import json
import sys

from cyclone_peers import Service, participant
from cyclone_types import (
    GetParametersRequest,
    GetParametersResponse,
    TriggerRequest,
    TriggerResponse,
)


def main(node, parameter):
    owner, node = participant(), node.removeprefix("/")
    print("ready", flush=True)
    ping = Service(owner, f"{node}/ping", TriggerRequest, TriggerResponse)
    pong = ping.first_reply(TriggerRequest(0))
    print(json.dumps({"success": pong.success, "message": pong.message}), flush=True)
    name = f"{node}/get_parameters"
    service = Service(owner, name, GetParametersRequest, GetParametersResponse)
    (value,) = service.first_reply(GetParametersRequest([parameter])).values
    print(json.dumps({"type": value.type, "value": value.double_value}), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
