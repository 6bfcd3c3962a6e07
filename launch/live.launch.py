"""Guard the margin live and watch it in RViz: ``ros2 launch launch/live.launch.py config:=FILE``.

``record:=FOLDER`` records the case too. ``command`` may name the ``marginguard`` of a virtual
environment. The tracker's and the robot's own nodes are started elsewhere.
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PythonExpression

from launch import LaunchDescription

RVIZ = str(Path(__file__).resolve().with_name("rviz.launch.py"))


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
