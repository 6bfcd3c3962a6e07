"""Converts a case to MCAP, and copies the messages of a recording to a complete MCAP file.

Stamps and statuses are kept, of a bag all messages of all topics, byte for byte.
"""

import os
import shutil
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath

import yaml
from mcap.writer import CompressionType, Writer

from app.case.case import Case
from app.case.frames_recorder import write_recording
from app.case.manifest.case_file import MANIFEST_NAME
from app.case.manifest.structures import as_schema_2
from app.case.messages.ros_messages import JOINT_STATES_TOPIC, ros_types
from app.case.readers.recording_format import Connection, RawMessage, format_of, note_to
from app.files.atomic_io import atomic_file, new_folder
from app.files.paths import PACKAGE_SCHEME, resolve_inside, sha256_of
from app.files.yaml_file import load_yaml
from app.geometry import InputError

_CHUNK_BYTES = 1024 * 1024


def write_messages(path: Path, messages: Iterable[RawMessage]) -> dict[str, int]:
    """Write ``messages`` in their order to the new file ``path``; returns their number by topic.

    Topics, types, definitions, metadata of channels, times and sequence numbers are kept. A type
    without a definition in the recording gets that of ROS 2 Jazzy, an unknown one none. The same
    messages give the same bytes. Raises `OSError`.
    """
    counts: Counter[str] = Counter()
    with path.open("xb") as file:
        writer = Writer(file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="marginguard")
        channels = _Channels(writer)
        for message in messages:
            writer.add_message(
                channels.number_of(message.connection), message.log_ns, message.data,
                message.publish_ns, message.sequence,
            )  # fmt: skip
            counts[message.connection.topic] += 1
        writer.finish()  # type: ignore[no-untyped-call]
    return dict(counts)


def recover_recording(source: Path, path: Path) -> tuple[Mapping[str, int], tuple[str, ...]]:
    """Copy all intact messages of ``source``, an MCAP file or rosbag2 folder, to the file ``path``.

    ``path`` must not exist; ``source`` is not changed. Returns the number of messages by topic, and
    notes about skipped parts. Raises `InputError` for another format, a recording without an intact
    message, and a file that cannot be written; no file is left then.
    """
    if os.path.lexists(path):
        raise InputError(f"{path} already exists; refusing to overwrite it")
    messages = format_of(source).messages
    if messages is None:
        raise InputError(f"{source} has no messages to recover; expected .mcap or a rosbag2 folder")
    notes: list[str] = []
    with atomic_file(path) as partial:
        counts = write_messages(partial, messages(source, note_to(notes)))
        if not counts:
            raise InputError(f"{source} holds no intact message")
    return counts, tuple(notes)


class _Channels:
    """The channels of the file that ``writer`` writes."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        # The parts of a split bag repeat its channels.
        self._channels: dict[tuple[object, ...], int] = {}
        self._numbers: dict[Connection, int] = {}

    def number_of(self, connection: Connection) -> int:
        """Number of the channel of ``connection``; written before its first message."""
        number = self._numbers.get(connection)
        if number is None:
            number = self._numbers[connection] = self._channel(connection)
        return number

    def _channel(self, connection: Connection) -> int:
        schema = self._schema(connection)
        metadata = dict(connection.metadata)
        key = (
            connection.topic, schema, connection.message_encoding, tuple(sorted(metadata.items()))
        )  # fmt: skip
        if key not in self._channels:
            self._channels[key] = self._writer.register_channel(
                connection.topic, connection.message_encoding, schema, metadata
            )
        return self._channels[key]

    def _schema(self, connection: Connection) -> int:
        encoding, data = connection.schema_encoding, connection.schema
        if not data and connection.message_type in ros_types().fielddefs:
            text, _ = ros_types().generate_msgdef(connection.message_type, ros_version=2)
            encoding, data = "ros2msg", text.encode()
        if not (connection.message_type or data):
            return 0  # a channel without a schema
        key = (connection.message_type, encoding, data)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(*key)
        return self._schemas[key]


RECORDING_NAME = "tracking.mcap"


def convert_case(case: Case, folder: Path, *, schema: int = 1) -> tuple[str, ...]:
    """Write ``case`` to the new folder ``folder`` with its recording as MCAP.

    Copies the files that the manifest names, except those of packages. With ``schema`` 2 the
    manifest of schema 1 is written in schema 2. Returns the notes of the reader. Raises
    `InputError` when ``folder`` exists or cannot be written; no folder is left after an error.
    """
    with new_folder(folder) as partial:
        _write(case, partial, schema)
    return case.notes()


def _write(case: Case, folder: Path, schema: int) -> None:
    copy_named_files(case, folder)
    recording = folder / RECORDING_NAME
    robot = case.manifest.robot
    messages = case.recorded_messages()
    if messages is None:
        write_recording(
            recording,
            case.recorded_frames(),
            robot_to_tracker_offset_ns=case.manifest.clock.offset_robot_to_tracker_ns,
            joint_states_topic=(robot and robot.joint_states) or JOINT_STATES_TOPIC,
        )
    else:
        write_messages(recording, messages)
        # Refuse a recording that cannot be replayed, and note what a replay skips.
        for _ in case.copied_frames(recording):
            pass
    # Not parsed again: it was checked when the case was opened, and stays but for the recording.
    manifest = load_yaml(case.folder / MANIFEST_NAME)
    manifest["recording"] = {"path": RECORDING_NAME, "sha256": sha256_of(recording)}
    if schema == 2 and manifest["schema"] == 1:
        manifest = as_schema_2(manifest)
    text = yaml.safe_dump(manifest, sort_keys=False, allow_unicode=True)
    (folder / MANIFEST_NAME).write_text(text, encoding="utf-8")


def copy_named_files(case: Case, folder: Path, *, with_tumor: bool = True) -> None:
    """Copy the files that the manifest names, except the recording, to ``folder``."""
    for name in _named_files(case, with_tumor=with_tumor):
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        source = resolve_inside(case.folder, name, name)
        if source.is_dir():
            shutil.copytree(source, target, dirs_exist_ok=True)
        else:
            shutil.copyfile(source, target)


def _named_files(case: Case, *, with_tumor: bool) -> list[str]:
    """Files of the case folder other than the recording, relative to it."""
    manifest = case.manifest
    names = [manifest.tumor.shape.path] if with_tumor else []
    names += [each.shape.path for each in manifest.structures]
    arms = [(each.tool, each.robot) for each in manifest.arms] or [(manifest.tool, manifest.robot)]
    names += [tool.mesh.path for tool, _ in arms if tool.mesh is not None]
    names += [model.path for _, model, _ in manifest.item_models]
    if manifest.expected is not None:
        names.append(manifest.expected)
    if manifest.images is not None:
        names += [each.path for each in manifest.images.calibrations if each.path is not None]
    for _, robot in arms:
        if robot is None or robot.urdf.startswith(PACKAGE_SCHEME):
            continue
        # A URDF names its meshes relative to itself, so its folder is copied.
        parent = str(PurePosixPath(robot.urdf).parent)
        if parent == ".":
            raise InputError(
                f"case.yaml: robot.urdf is {robot.urdf!r}; "
                "expected a file in a folder of its own, which can be copied"
            )
        names.append(parent)
    return [name for name in names if not name.startswith(PACKAGE_SCHEME)]
