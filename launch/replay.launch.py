"""Replay a recorded case with RViz: ``ros2 launch launch/replay.launch.py``.

``command`` can be the ``marginguard`` of a virtual environment. RViz uses the replay's clock.
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription

ROOT = Path(__file__).resolve().parents[1]
RVIZ = str(Path(__file__).resolve().with_name("rviz.launch.py"))


def generate_launch_description():
    """Describe the replay, and RViz unless ``rviz:=false``."""
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
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(RVIZ),
                launch_arguments={"use_sim_time": "true"}.items(),
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
        ]
    )
