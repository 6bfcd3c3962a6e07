"""Requests of operators, as messages and as arguments of ``caller.py``."""

import json
from pathlib import Path

from geometry_msgs.msg import Point
from marginguard_msgs.srv import Register, SetStructure, SetTumor, SwitchStructure
from shape_msgs.msg import MeshTriangle

from tests.bridge.peers import as_plain

CALLER = Path(__file__).with_name("caller.py")
CORNERS = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
VALUES = {bool: (1, "bool"), int: (2, "integer"), float: (3, "double"), str: (4, "string")}
"""Type and field of a parameter's value in rcl_interfaces/ParameterValue."""


KINDS = {
    "SetTumor_Request": ("SetTumor", "set_tumor"),
    "SetStructure_Request": ("SetStructure", "set_structure"),
    "SwitchStructure_Request": ("SwitchStructure", "switch_structure"),
    "Register_Request": ("Register", "register"),
}
"""Name and service of each request."""


def tumor(size, frame="needle", is_open=False, request=None):
    """Request with a tetrahedron of ``size`` m; ``is_open`` omits one of its faces."""
    request = request or SetTumor.Request()
    request.header.frame_id = frame
    request.pose.orientation.w = 1.0
    request.pose.position.x = 0.001
    request.mesh.vertices = [Point(x=size * x, y=size * y, z=size * z) for x, y, z in CORNERS]
    faces = FACES[1:] if is_open else FACES
    request.mesh.triangles = [MeshTriangle(vertex_indices=list(face)) for face in faces]
    return request


def structure(size=0.03, frame="needle", is_open=False, **values):
    """Request to guard a vessel of the shape of `tumor`, with 1 and 3 mm as distances."""
    given = {"name": "vessel", "role": "forbidden", "stop_distance": 0.001, "warn_distance": 0.003}
    return tumor(size, frame, is_open, SetStructure.Request(**given | values))


def switch(on, reason="", name="vessel"):
    """Request to guard a structure no more, or again."""
    return SwitchStructure.Request(name=name, on=on, reason=reason)


def pairs(noise):
    """Request with points of the base and their images 0.5 m along x, off by +-``noise`` m in y."""
    moving = [(0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1), (0.1, 0.1, 0.1), (0.05, 0.0, 0.1)]
    request = Register.Request(fixed_frame="reference", moving_frame="robot_base")
    request.moving_points = [Point(x=x, y=y, z=z) for x, y, z in moving]
    request.fixed_points = [
        Point(x=x + 0.5, y=y + noise * (-1) ** k, z=z) for k, (x, y, z) in enumerate(moving)
    ]
    return request


def call_of(request, node="/marginguard"):
    """The argument of ``caller.py`` for a request of an operator."""
    kind, name = KINDS[type(request).__name__]
    return f"{node}/{name}:marginguard_msgs/srv/{kind}:{json.dumps(as_plain(request))}"


def setting(values, node="/marginguard"):
    """The argument of ``caller.py`` that sets parameters of a node atomically."""
    parameters = []
    for name, value in values.items():
        is_list = isinstance(value, list)
        number, kind = VALUES[type(value[0] if is_list else value)]
        field = f"{kind}_array_value" if is_list else f"{kind}_value"
        entry = {"type": number + 5 * is_list, field: value}
        parameters.append({"name": name, "value": entry})
    request = json.dumps({"parameters": parameters})
    return f"{node}/set_parameters_atomically:rcl_interfaces/srv/SetParametersAtomically:{request}"


def asking(name, node="/marginguard"):
    """The two arguments of ``caller.py`` that read a parameter and its description."""
    request = json.dumps({"names": [name]})
    kinds = {"get_parameters": "GetParameters", "describe_parameters": "DescribeParameters"}
    return [f"{node}/{each}:rcl_interfaces/srv/{kind}:{request}" for each, kind in kinds.items()]


def transition(name):
    """The argument of ``caller.py`` for a transition of the lifecycle, or for ``state``."""
    if name == "state":
        return "/marginguard/get_state:lifecycle_msgs/srv/GetState:{}"
    what = {"id": int(name)} if name.isdigit() else {"label": name}
    request = json.dumps({"transition": what})
    return f"/marginguard/change_state:lifecycle_msgs/srv/ChangeState:{request}"


def transitions(start_receiver, *names):
    """The results of these requests: True or False, and the label of a state."""
    replies = start_receiver(*map(transition, names), script=CALLER).messages()
    return [
        each["current_state"]["label"] if "current_state" in each else each["success"]
        for each in replies
    ]
