"""Guard the margin live and watch it in RViz: ``ros2 launch launch/live.launch.py config:=FILE``.

``record:=FOLDER`` records the case too. ``command`` may name the ``marginguard`` of a virtual
environment. The tracker's and the robot's own nodes are started elsewhere.
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, ExecuteProcess, SetEnvironmentVariable
from launch.conditions import IfCondition
from launch.substitutions import EnvironmentVariable, LaunchConfiguration, PythonExpression
from launch_ros.actions import Node

from launch import LaunchDescription

ROOT = Path(__file__).resolve().parents[1]


def generate_launch_description():
    """The session, a recording where one is asked for, and RViz unless ``rviz:=false``."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("config", description="live.yaml"),
            DeclareLaunchArgument(
                "record", default_value="", description="folder to record the case to; none: empty"
            ),
            DeclareLaunchArgument(
                "command", default_value="marginguard", description="the command to run"
            ),
            DeclareLaunchArgument("rviz", default_value="true", description="start RViz"),
            # One discovery range for all; the user's choice wins, as it does for the command.
            SetEnvironmentVariable(
                "ROS_AUTOMATIC_DISCOVERY_RANGE",
                EnvironmentVariable("ROS_AUTOMATIC_DISCOVERY_RANGE", default_value="LOCALHOST"),
            ),
            ExecuteProcess(
                cmd=[
                    LaunchConfiguration("command"),
                    "live",
                    "--config",
                    LaunchConfiguration("config"),
                ],
                output="screen",
            ),
            ExecuteProcess(
                cmd=[
                    LaunchConfiguration("command"),
                    "record",
                    "--config",
                    LaunchConfiguration("config"),
                    "-o",
                    LaunchConfiguration("record"),
                ],
                output="screen",
                condition=IfCondition(
                    PythonExpression(["'", LaunchConfiguration("record"), "' != ''"])
                ),
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", str(ROOT / "rviz" / "margin.rviz")],
                condition=IfCondition(LaunchConfiguration("rviz")),
            ),
        ]
    )
