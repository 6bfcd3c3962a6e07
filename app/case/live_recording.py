"""Writes a case folder for a live recording: everything but the recording, before it starts."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import yaml

from app.case.convert import copy_named_files
from app.case.live_file import IgtlSourceEntry, LiveCase, TopicSourceEntry
from app.case.live_keys import ONLY_LIVE
from app.case.manifest.case_file import MANIFEST_NAME
from app.case.messages.ros_messages import TRACKED_TRANSFORMS_TOPIC
from app.case.readers.rosbag2 import CHANGES_NAME
from app.files.atomic_io import new_folder, write_file
from app.files.yaml_file import load_yaml
from app.geometry import InputError

RECORDING_FOLDER = "tracking"

IGTL_IMAGES_TOPIC = "/marginguard/images"
"""Topic in a recording of the images that came over the session's OpenIGTLink connection."""


@dataclass(frozen=True, slots=True)
class SessionChange:
    """Tumour and registration of a session from the time ``received_ns`` (since 1970) on.

    ``replaced`` names the parts that are not those of the case.
    """

    received_ns: int
    model_id: str
    registration_id: str
    replaced: str


def write_changes(changes: Sequence[SessionChange], recording: Path) -> None:
    """Write ``changes.yaml`` to the folder ``recording``; `InputError` where that fails."""
    text = yaml.safe_dump({"changes": [asdict(change) for change in changes]}, sort_keys=False)
    write_file(recording / CHANGES_NAME, text.encode())


def begin_case(live: LiveCase, folder: Path) -> None:
    """Write ``case.yaml`` and the files that it names, except the recording, to ``folder``.

    ``folder`` must not exist. The recording is expected in the rosbag2 folder ``tracking``. Raises
    `InputError` for a source that a case cannot hold.
    """
    source = live.source
    if isinstance(source, TopicSourceEntry) and source.topic != TRACKED_TRANSFORMS_TOPIC:
        raise InputError(
            f"{live.case.manifest.file}: source.tracked_transforms.topic is {source.topic!r}; "
            f"expected {TRACKED_TRANSFORMS_TOPIC}, the topic of a case"
        )
    with new_folder(folder) as partial:
        _write(live, partial)


def _write(live: LiveCase, folder: Path) -> None:
    copy_named_files(live.case, folder)
    # Not parsed again: it was checked when it was opened.
    path = live.case.folder / live.case.manifest.file
    values = load_yaml(path)
    for name in ONLY_LIVE:
        values.pop(name, None)
    if live.case.manifest.images is not None:
        values["images"].pop("device", None)
        if isinstance(live.source, IgtlSourceEntry):
            values["images"].setdefault("topic", IGTL_IMAGES_TOPIC)
    robot = live.case.manifest.robot
    if live.joints_of_host and not live.stamps_of_host and robot and robot.joint_states:
        values["clock"] = {"estimate": True}  # the offset of the two clocks is unknown
    values["recording"] = {"path": RECORDING_FOLDER}
    text = yaml.safe_dump(values, sort_keys=False, allow_unicode=True)
    (folder / MANIFEST_NAME).write_text(text, encoding="utf-8")
