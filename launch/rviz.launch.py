"""What the launch files of this folder have in common: RViz, and one discovery range for all."""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.conditions import IfCondition
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

ROOT = Path(__file__).resolve().parents[1]


def generate_launch_description():
    """RViz unless ``rviz:=false``; ``use_sim_time:=true`` has it on the time of a replay."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("rviz", default_value="true", description="start RViz"),
            DeclareLaunchArgument(
                "use_sim_time", default_value="false", description="follow the replay's time"
            ),
            # The user's choice wins, as it does for the command.
            SetEnvironmentVariable(
                "ROS_AUTOMATIC_DISCOVERY_RANGE",
                EnvironmentVariable("ROS_AUTOMATIC_DISCOVERY_RANGE", default_value="LOCALHOST"),
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", str(ROOT / "rviz" / "margin.rviz")],
                parameters=[{"use_sim_time": LaunchConfiguration("use_sim_time")}],
                condition=IfCondition(LaunchConfiguration("rviz")),
            ),
        ]
    )
