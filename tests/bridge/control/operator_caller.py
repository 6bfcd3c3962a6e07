"""Independent ROS process that calls an operator's services, with plain rclpy.

    operator_caller.py SIZE_M FRAME open|closed ...   three arguments per request of ~/set_tumor
    operator_caller.py register NOISE_M ...

Sends a tetrahedron, or pairs of points. Prints ``ready``, then each reply as a line of JSON. It
does not import the project.
"""

import json
import sys

import rclpy
from geometry_msgs.msg import Point
from marginguard_msgs.srv import Register, SetTumor
from shape_msgs.msg import MeshTriangle

CORNERS = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))


def tumor(size, frame, is_open):
    """Request with a tetrahedron of ``size`` m; ``is_open`` omits one of its faces."""
    request = SetTumor.Request()
    request.header.frame_id = frame
    request.pose.orientation.w = 1.0
    request.pose.position.x = 0.001
    request.mesh.vertices = [Point(x=size * x, y=size * y, z=size * z) for x, y, z in CORNERS]
    faces = FACES[1:] if is_open else FACES
    request.mesh.triangles = [MeshTriangle(vertex_indices=list(face)) for face in faces]
    return request


def pairs(noise):
    """Request with points of the base and their images 0.5 m along x, off by +-``noise`` m in y."""
    moving = [(0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1), (0.1, 0.1, 0.1), (0.05, 0.0, 0.1)]
    request = Register.Request(fixed_frame="reference", moving_frame="robot_base")
    request.moving_points = [Point(x=x, y=y, z=z) for x, y, z in moving]
    request.fixed_points = [
        Point(x=x + 0.5, y=y + noise * (-1) ** k, z=z) for k, (x, y, z) in enumerate(moving)
    ]
    return request


def main() -> int:
    rclpy.init()
    node = rclpy.create_node("operator")
    arguments = sys.argv[1:]
    if arguments[0] == "register":
        requests = [(Register, "register", pairs(float(noise))) for noise in arguments[1:]]
    else:
        tumors = zip(arguments[::3], arguments[1::3], arguments[2::3], strict=True)
        requests = [
            (SetTumor, "set_tumor", tumor(float(size), frame, surface == "open"))
            for size, frame, surface in tumors
        ]
    print("ready", flush=True)
    for kind, name, request in requests:
        client = node.create_client(kind, f"/marginguard/{name}")
        if not client.wait_for_service(30.0):
            return 1
        future = client.call_async(request)
        rclpy.spin_until_future_complete(node, future, timeout_sec=60.0)
        reply = future.result()
        result = {"success": reply.success, "message": reply.message}
        result["id"] = reply.registration_id if kind is Register else reply.model_id
        if kind is Register:
            result["x"], result["fre"] = reply.transform.translation.x, reply.fre
        print(json.dumps(result), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
