"""Run a live session with RViz: ``ros2 launch launch/live.launch.py config:=FILE``.

``record:=FOLDER`` also records the case. ``command`` can be the ``marginguard`` of a virtual
environment. The nodes of the tracker and of the robot are started separately.
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PythonExpression

from launch import LaunchDescription

RVIZ = str(Path(__file__).resolve().with_name("rviz.launch.py"))


def generate_launch_description():
    """Describe the session, the optional recording, and RViz unless ``rviz:=false``."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("config", description="live.yaml"),
            DeclareLaunchArgument(
                "record", default_value="", description="folder to record to; empty: none"
            ),
            DeclareLaunchArgument(
                "command", default_value="marginguard", description="the command to run"
            ),
            IncludeLaunchDescription(PythonLaunchDescriptionSource(RVIZ)),
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
        ]
    )
