"""Replay a recorded case and watch it in RViz: ``ros2 launch launch/replay.launch.py``.

``command`` may name the ``marginguard`` of a virtual environment; RViz runs on the replay's time.
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, ExecuteProcess, SetEnvironmentVariable
from launch.conditions import IfCondition
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

ROOT = Path(__file__).resolve().parents[1]


def generate_launch_description():
    """The replay, and RViz unless ``rviz:=false``."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "case",
                default_value=str(ROOT / "data" / "recorded_case"),
                description="folder of the recorded case",
            ),
            DeclareLaunchArgument(
                "rate", default_value="1.0", description="recording seconds per second"
            ),
            DeclareLaunchArgument(
                "command", default_value="marginguard", description="the command to run"
            ),
            DeclareLaunchArgument("rviz", default_value="true", description="start RViz"),
            # One discovery range for both; the user's choice wins, as it does for the command.
            SetEnvironmentVariable(
                "ROS_AUTOMATIC_DISCOVERY_RANGE",
                EnvironmentVariable("ROS_AUTOMATIC_DISCOVERY_RANGE", default_value="LOCALHOST"),
            ),
            ExecuteProcess(
                cmd=[
                    LaunchConfiguration("command"),
                    "replay",
                    LaunchConfiguration("case"),
                    "--rate",
                    LaunchConfiguration("rate"),
                ],
                output="screen",
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", str(ROOT / "rviz" / "margin.rviz")],
                parameters=[{"use_sim_time": True}],
                condition=IfCondition(LaunchConfiguration("rviz")),
            ),
        ]
    )
