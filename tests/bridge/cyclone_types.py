"""Hand-written ROS 2 types for Cyclone DDS, without ROS.

Names and layouts follow ROS 2's mapping to DDS: ``package::msg::dds_::Type_``. A request without
fields has one unused field. An action consists of three services and two topics, whose types
contain the action's goal, result and feedback and the id of the goal.
"""

from dataclasses import dataclass
from types import SimpleNamespace, new_class

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, int8, int32, int64, sequence, uint8, uint32


def struct(name, **fields):
    """The type ``package/folder/Type`` with these fields."""
    package, folder, kind = name.split("/")
    type_name = {"typename": f"{package}::{folder}::dds_::{kind}_"}
    annotated = {"__annotations__": fields, "__module__": __name__}
    return dataclass(new_class(kind, (IdlStruct,), type_name, lambda body: body.update(annotated)))


NUMBERS = dict.fromkeys("xyz", float64)
Time = struct("builtin_interfaces/msg/Time", sec=int32, nanosec=uint32)
Header = struct("std_msgs/msg/Header", stamp=Time, frame_id=str)
Vector3 = struct("geometry_msgs/msg/Vector3", **NUMBERS)
Point = struct("geometry_msgs/msg/Point", **NUMBERS)
Quaternion = struct("geometry_msgs/msg/Quaternion", **NUMBERS, w=float64)
Pose = struct("geometry_msgs/msg/Pose", position=Point, orientation=Quaternion)
PoseArray = struct("geometry_msgs/msg/PoseArray", header=Header, poses=sequence[Pose])
Transform = struct("geometry_msgs/msg/Transform", translation=Vector3, rotation=Quaternion)
TransformStamped = struct(
    "geometry_msgs/msg/TransformStamped", header=Header, child_frame_id=str, transform=Transform
)
TFMessage = struct("tf2_msgs/msg/TFMessage", transforms=sequence[TransformStamped])
TriggerRequest = struct("std_srvs/srv/Trigger_Request", structure_needs_at_least_one_member=uint8)
TriggerResponse = struct("std_srvs/srv/Trigger_Response", success=bool, message=str)
ParameterValue = struct(
    "rcl_interfaces/msg/ParameterValue",
    type=uint8,
    bool_value=bool,
    integer_value=int64,
    double_value=float64,
    string_value=str,
    byte_array_value=sequence[uint8],
    bool_array_value=sequence[bool],
    integer_array_value=sequence[int64],
    double_array_value=sequence[float64],
    string_array_value=sequence[str],
)
GetParametersRequest = struct("rcl_interfaces/srv/GetParameters_Request", names=sequence[str])
GetParametersResponse = struct(
    "rcl_interfaces/srv/GetParameters_Response", values=sequence[ParameterValue]
)
UUID = struct("unique_identifier_msgs/msg/UUID", uuid=array[uint8, 16])
GoalInfo = struct("action_msgs/msg/GoalInfo", goal_id=UUID, stamp=Time)
GoalStatus = struct("action_msgs/msg/GoalStatus", goal_info=GoalInfo, status=int8)
GoalStatusArray = struct("action_msgs/msg/GoalStatusArray", status_list=sequence[GoalStatus])
CancelGoalRequest = struct("action_msgs/srv/CancelGoal_Request", goal_info=GoalInfo)
CancelGoalResponse = struct(
    "action_msgs/srv/CancelGoal_Response", return_code=int8, goals_canceling=sequence[GoalInfo]
)


def action(name, goal, result, feedback):
    """Types of the services and topics of an action of ours, from the fields of its parts."""
    scope = f"marginguard_msgs/action/{name}_"
    parts = {"Goal": goal, "Result": result, "Feedback": feedback}
    made = {part: struct(scope + part, **fields) for part, fields in parts.items()}
    return SimpleNamespace(
        goal=made["Goal"],
        send_goal=(
            struct(f"{scope}SendGoal_Request", goal_id=UUID, goal=made["Goal"]),
            struct(f"{scope}SendGoal_Response", accepted=bool, stamp=Time),
        ),
        get_result=(
            struct(f"{scope}GetResult_Request", goal_id=UUID),
            struct(f"{scope}GetResult_Response", status=int8, result=made["Result"]),
        ),
        feedback=struct(f"{scope}FeedbackMessage", goal_id=UUID, feedback=made["Feedback"]),
    )


ACTIONS = {
    "Replay": action(
        "Replay",
        {"case_folder": str, "rate": float64, "start": float64, "end": float64},
        {
            "success": bool,
            "message": str,
            "frames": uint32,
            "breaches": uint32,
            "min_signed_distance": float64,
        },
        {
            "time": float64,
            "duration": float64,
            "frames": uint32,
            "state": uint8,
            "signed_distance": float64,
        },
    ),
    "Calibrate": action(
        "Calibrate",
        {"method": uint8, "frame": str, "parent_frame": str, "samples": uint32, "timeout": float64},
        {
            "success": bool,
            "message": str,
            "transform": TransformStamped,
            "residual": float64,
            "samples": uint32,
        },
        {"samples": uint32, "variation": float64, "hint": str},
    ),
}
