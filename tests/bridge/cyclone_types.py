"""Hand-written ROS 2 types for Cyclone DDS, without ROS.

Names and layouts follow ROS 2's mapping to DDS: ``package::msg::dds_::Type_``. A request without
fields has one unused field. An action consists of three services and two topics, whose types
contain the action's goal, result and feedback and the id of the goal.
"""

from dataclasses import dataclass

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, int8, int32, int64, sequence, uint8, uint32


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point
    orientation: Quaternion


@dataclass
class PoseArray(IdlStruct, typename="geometry_msgs::msg::dds_::PoseArray_"):
    header: Header
    poses: sequence[Pose]


@dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: sequence[TransformStamped]


@dataclass
class TriggerRequest(IdlStruct, typename="std_srvs::srv::dds_::Trigger_Request_"):
    structure_needs_at_least_one_member: uint8


@dataclass
class TriggerResponse(IdlStruct, typename="std_srvs::srv::dds_::Trigger_Response_"):
    success: bool
    message: str


@dataclass
class ParameterValue(IdlStruct, typename="rcl_interfaces::msg::dds_::ParameterValue_"):
    type: uint8
    bool_value: bool
    integer_value: int64
    double_value: float64
    string_value: str
    byte_array_value: sequence[uint8]
    bool_array_value: sequence[bool]
    integer_array_value: sequence[int64]
    double_array_value: sequence[float64]
    string_array_value: sequence[str]


@dataclass
class GetParametersRequest(IdlStruct, typename="rcl_interfaces::srv::dds_::GetParameters_Request_"):
    names: sequence[str]


@dataclass
class GetParametersResponse(
    IdlStruct, typename="rcl_interfaces::srv::dds_::GetParameters_Response_"
):
    values: sequence[ParameterValue]


@dataclass
class UUID(IdlStruct, typename="unique_identifier_msgs::msg::dds_::UUID_"):
    uuid: array[uint8, 16]


@dataclass
class GoalInfo(IdlStruct, typename="action_msgs::msg::dds_::GoalInfo_"):
    goal_id: UUID
    stamp: Time


@dataclass
class GoalStatus(IdlStruct, typename="action_msgs::msg::dds_::GoalStatus_"):
    goal_info: GoalInfo
    status: int8


@dataclass
class GoalStatusArray(IdlStruct, typename="action_msgs::msg::dds_::GoalStatusArray_"):
    status_list: sequence[GoalStatus]


@dataclass
class CancelGoalRequest(IdlStruct, typename="action_msgs::srv::dds_::CancelGoal_Request_"):
    goal_info: GoalInfo


@dataclass
class CancelGoalResponse(IdlStruct, typename="action_msgs::srv::dds_::CancelGoal_Response_"):
    return_code: int8
    goals_canceling: sequence[GoalInfo]


@dataclass
class ReplayGoal(IdlStruct, typename="marginguard_msgs::action::dds_::Replay_Goal_"):
    case_folder: str
    rate: float64
    start: float64
    end: float64


@dataclass
class ReplayResult(IdlStruct, typename="marginguard_msgs::action::dds_::Replay_Result_"):
    success: bool
    message: str
    frames: uint32
    breaches: uint32
    min_signed_distance: float64


@dataclass
class ReplayFeedback(IdlStruct, typename="marginguard_msgs::action::dds_::Replay_Feedback_"):
    time: float64
    duration: float64
    frames: uint32
    state: uint8
    signed_distance: float64


@dataclass
class CalibrateGoal(IdlStruct, typename="marginguard_msgs::action::dds_::Calibrate_Goal_"):
    method: uint8
    frame: str
    parent_frame: str
    samples: uint32
    timeout: float64


@dataclass
class CalibrateResult(IdlStruct, typename="marginguard_msgs::action::dds_::Calibrate_Result_"):
    success: bool
    message: str
    transform: TransformStamped
    residual: float64
    samples: uint32


@dataclass
class CalibrateFeedback(IdlStruct, typename="marginguard_msgs::action::dds_::Calibrate_Feedback_"):
    samples: uint32
    variation: float64
    hint: str


class ActionTypes:
    """Types of an action's services and topics, made from its goal, result and feedback types."""

    def __init__(self, name, goal_type, result_type, feedback_type):
        scope = f"marginguard_msgs::action::dds_::{name}_"

        @dataclass
        class SendGoalRequest(IdlStruct, typename=f"{scope}SendGoal_Request_"):
            goal_id: UUID
            goal: goal_type

        @dataclass
        class SendGoalResponse(IdlStruct, typename=f"{scope}SendGoal_Response_"):
            accepted: bool
            stamp: Time

        @dataclass
        class GetResultRequest(IdlStruct, typename=f"{scope}GetResult_Request_"):
            goal_id: UUID

        @dataclass
        class GetResultResponse(IdlStruct, typename=f"{scope}GetResult_Response_"):
            status: int8
            result: result_type

        @dataclass
        class FeedbackMessage(IdlStruct, typename=f"{scope}FeedbackMessage_"):
            goal_id: UUID
            feedback: feedback_type

        self.goal = goal_type
        self.send_goal = (SendGoalRequest, SendGoalResponse)
        self.get_result = (GetResultRequest, GetResultResponse)
        self.feedback = FeedbackMessage


ACTIONS = {
    "Replay": ActionTypes("Replay", ReplayGoal, ReplayResult, ReplayFeedback),
    "Calibrate": ActionTypes("Calibrate", CalibrateGoal, CalibrateResult, CalibrateFeedback),
}
