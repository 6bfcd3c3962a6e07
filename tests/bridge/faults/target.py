"""Process with all our listeners other than a live session's source.

Prints a line of JSON for each line of standard input: counts of received and refused messages,
failures, and the peak memory in kB.
"""

import json
import re
import sys
from pathlib import Path

from app.bridge import RosNode
from app.bridge.live.sources import listen_to_joints
from app.bridge.robot_description import DescriptionListener, DescriptionSource, RobotSettings
from app.bridge.ros_errors import TfError
from app.bridge.tf import TransformBuffer
from app.bridge.tf_topics import TfListener


def main() -> None:
    joints: list[str] = []
    robots: list[str] = []
    buffer = TransformBuffer()
    with RosNode("target") as ros:
        tf = TfListener(ros, buffer)
        states = listen_to_joints(
            ros,
            "/joint_states",
            0,
            deliver=lambda sample: joints.append("good"),
            accepts=lambda *_: True,
            is_complete=lambda names: True,
        )
        description = DescriptionListener(
            ros,
            RobotSettings("robot"),
            DescriptionSource(topic="/robot_description"),
            lambda robot: robots.append(robot.root_link),
        )
        print("listening", flush=True)
        for _ in sys.stdin:
            try:
                buffer.lookup("good", "better")
                found = True
            except TfError:
                found = False
            memory = re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())
            assert memory is not None
            answer = {
                "tf": dict(tf.refused),
                "tf_messages": tf.messages,
                "found": found,
                "joints": dict(states.counts()),
                "good_joints": len(joints),
                "robots": robots,
                "descriptions_refused": description.refused,
                "problem": description.problem,
                "failures": ros.failures,
                "memory_kb": int(memory[1]),
            }
            print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
