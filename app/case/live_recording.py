"""A case folder around a live recording: all of a case but the recording, there from the start."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import yaml

from app.case.convert import copy_named_files
from app.case.live_file import ONLY_LIVE, IgtlSourceEntry, LiveCase, TopicSourceEntry
from app.case.manifest.case_file import MANIFEST_NAME
from app.case.messages.ros_messages import TRACKED_TRANSFORMS_TOPIC
from app.case.readers.rosbag2 import CHANGES_NAME
from app.files.atomic_io import new_folder, write_file
from app.files.yaml_file import load_yaml
from app.geometry import InputError

RECORDING_FOLDER = "tracking"


@dataclass(frozen=True, slots=True)
class SessionChange:
    """From a message received at ``received_ns`` (since 1970) on, these are what a session has."""

    received_ns: int
    model_id: str
    registration_id: str


def write_changes(changes: Sequence[SessionChange], recording: Path) -> None:
    """Say beside the messages of ``recording``, a folder, what was replaced while it was made."""
    text = yaml.safe_dump({"changes": [asdict(change) for change in changes]}, sort_keys=False)
    write_file(recording / CHANGES_NAME, text.encode())


def begin_case(live: LiveCase, folder: Path) -> None:
    """Write ``case.yaml`` and the files that it names to ``folder``; the recording is to follow.

    ``folder`` is made and must not be there. The recording is named as ``tracking``, a rosbag2
    folder.
    """
    source = live.source
    if isinstance(source, TopicSourceEntry) and source.topic != TRACKED_TRANSFORMS_TOPIC:
        raise InputError(
            f"{live.case.manifest.file}: source.tracked_transforms.topic is {source.topic!r}: "
            f"a case holds {TRACKED_TRANSFORMS_TOPIC}, so only that can be recorded as one"
        )
    if isinstance(source, IgtlSourceEntry):
        raise InputError(
            f"{live.case.manifest.file}: source.igtl cannot be recorded: let 'marginguard igtl' "
            "publish it, and make tracked_transforms the source"
        )
    with new_folder(folder) as partial:
        _write(live, partial)


def _write(live: LiveCase, folder: Path) -> None:
    copy_named_files(live.case, folder)
    # It was validated when it was opened; all that a case can have stays as written.
    path = live.case.folder / live.case.manifest.file
    values = load_yaml(path)
    for name in ONLY_LIVE:
        values.pop(name, None)
    robot = live.case.manifest.robot
    if live.joints_of_host and not live.stamps_of_host and robot and robot.joint_states:
        values["clock"] = {"estimate": True}  # the two clocks are as far apart as they happen to be
    values["recording"] = {"path": RECORDING_FOLDER}
    text = yaml.safe_dump(values, sort_keys=False, allow_unicode=True)
    (folder / MANIFEST_NAME).write_text(text, encoding="utf-8")
