"""Processor time to read the frames of a recording, beside rosbags' decoding of its messages."""

import time
from collections.abc import Callable
from pathlib import Path

from app.case import open_case
from app.case.messages.ros_messages import ros_types
from app.geometry import InputError

ROUNDS = 3


def read_ms_per_frame(case_folder: Path) -> tuple[float, float | None]:
    """Milliseconds of processor time per frame: ours, and rosbags'; the fastest of `ROUNDS`.

    Ours is from the file to the assembled frames. That of rosbags is its decoding of the same
    topics alone, from bytes in memory to its messages; None for a recording without ROS messages.
    Both take turns. Raises `InputError` for a recording without frames.
    """
    case = open_case(case_folder)
    robot = case.manifest.robot
    topics = {"/tracked_transforms", "/tf", robot.joint_states if robot else None}
    recorded = case.recorded_messages()
    kept = [each for each in recorded or () if each.connection.topic in topics]
    messages = [(each.data, each.connection.message_type) for each in kept]
    types = ros_types()

    def decode() -> int:
        for data, kind in messages:
            types.deserialize_cdr(data, kind)
        return len(messages)

    ours, theirs, frames = [], [], 0
    for _ in range(ROUNDS):
        seconds, frames = _timed(lambda: sum(1 for _ in case.recorded_frames()))
        ours.append(seconds)
        theirs.append(_timed(decode)[0])
    if not frames:
        raise InputError(f"{case_folder}: its recording has 0 frames; expected 1 or more")
    peer = 1000.0 * min(theirs) / frames if messages else None
    return 1000.0 * min(ours) / frames, peer


def _timed(work: Callable[[], int]) -> tuple[float, int]:
    start_s = time.process_time()
    count = work()
    return time.process_time() - start_s, count
