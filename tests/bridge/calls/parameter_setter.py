"""Independent ROS process that sets parameters of another node with plain rclpy.

    parameter_setter.py NODE JSON ...

Each JSON is an object of names and values, set atomically, or a name to read. Prints ``ready``,
then a line of JSON for each: {"ok", "reason"} or {"value", "text", "unit", "lowest", "highest"}.
"""

import json
import sys

import rclpy
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient


def main() -> int:
    rclpy.init()
    node = rclpy.create_node("setter")
    client = AsyncParameterClient(node, sys.argv[1])
    print("ready", flush=True)
    if not client.wait_for_services(30.0):
        return 1

    def wait(future):
        rclpy.spin_until_future_complete(node, future, timeout_sec=30.0)
        return future.result()

    for argument in sys.argv[2:]:
        request = json.loads(argument)
        if isinstance(request, str):
            value = parameter_value_to_python(wait(client.get_parameters([request])).values[0])
            described = wait(client.describe_parameters([request])).descriptors[0]
            ranges = [*described.floating_point_range, *described.integer_range]
            reply = {
                "value": value,
                "text": described.description,
                "unit": described.additional_constraints,
                "range": [[each.from_value, each.to_value] for each in ranges],
            }
        else:
            parameters = [Parameter(name, value=value) for name, value in request.items()]
            result = wait(client.set_parameters_atomically(parameters)).result
            reply = {"ok": result.successful, "reason": result.reason}
        print(json.dumps(reply), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
