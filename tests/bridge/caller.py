"""Independent ROS process that calls services one after the other and prints the replies.

    caller.py NAME:TYPE:{"field": value} ...

Prints ``ready``, then each reply as a line of JSON. It does not import the project.
"""

import json
import sys
from importlib import import_module

import rclpy


def main() -> int:
    rclpy.init()
    node = rclpy.create_node("caller")
    print("ready", flush=True)
    for argument in sys.argv[1:]:
        name, kind, fields = argument.split(":", 2)
        package, folder, type_name = kind.split("/")
        service = getattr(import_module(f"{package}.{folder}"), type_name)
        client = node.create_client(service, name)
        if not client.wait_for_service(timeout_sec=30.0):
            print(f"no service {name}", file=sys.stderr)
            return 1
        future = client.call_async(service.Request(**json.loads(fields)))
        rclpy.spin_until_future_complete(node, future, timeout_sec=30.0)
        if not future.done():
            print(f"no reply from {name}", file=sys.stderr)
            return 1
        reply = future.result()
        print(json.dumps({key: getattr(reply, key) for key in reply.get_fields_and_field_types()}))
    rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
