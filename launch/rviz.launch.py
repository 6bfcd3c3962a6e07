"""Shared part of the launch files: RViz and a common discovery range."""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.conditions import IfCondition
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

ROOT = Path(__file__).resolve().parents[1]


def generate_launch_description():
    """Describe RViz, unless ``rviz:=false``; ``use_sim_time:=true`` uses the replay's clock."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("rviz", default_value="true", description="start RViz"),
            DeclareLaunchArgument(
                "use_sim_time", default_value="false", description="follow the replay's time"
            ),
            # Keep the user's choice, as the command does.
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
