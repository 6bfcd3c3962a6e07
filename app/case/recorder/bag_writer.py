"""Writes a rosbag2 folder in MCAP that stays readable up to the last flush after a crash."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast

import yaml
from mcap.writer import CompressionType, Writer

from app.case.recorder.complete_file import CompleteFile
from app.files.atomic_io import write_files
from app.geometry import InputError

_CHUNK_BYTES = 256 * 1024
_METADATA_VERSION = 9


@dataclass(frozen=True, slots=True)
class BagTopic:
    """Metadata of a topic in a bag.

    ``definition`` is a ``ros2msg`` schema, ``offered_qos`` the QoS profile of each publisher with
    rosbag2's keys, ``type_hash`` the hash of the type, empty when it is not known.
    """

    name: str
    message_type: str
    definition: str
    offered_qos: tuple[dict[str, Any], ...] = ()
    type_hash: str = ""


class BagWriter:
    """Writes messages to the new rosbag2 folder ``folder``: `add_topic`, `write`, `flush`, `close`.

    ``folder`` must not exist. Messages are in ``NAME_0.mcap``, which is a complete MCAP file after
    each flush. Flushed messages survive a crash of the process, synced ones a power cut. `close`
    adds the index and ``metadata.yaml``; without them players read the file from its beginning.

    Raises `InputError` when something cannot be written, such as on a full disk. Messages written
    before remain, and every later write raises.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._path = folder / f"{folder.name}_0.mcap"
        try:
            folder.mkdir(parents=True)
            self._file = CompleteFile(self._path)
        except FileExistsError as error:
            raise InputError(f"{folder} already exists; refusing to overwrite it") from error
        except OSError as error:
            raise InputError(f"{folder} cannot be written: {error.strerror}") from error
        stream = cast(IO[bytes], self._file)
        self._writer = Writer(stream, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._topics: dict[str, tuple[BagTopic, int]] = {}
        self._schemas: dict[str, int] = {}
        self._counts: Counter[str] = Counter()
        self._first_ns: int | None = None
        self._last_ns = 0
        self._failed = False
        self._guarded(lambda: self._writer.start(profile="ros2", library="marginguard"))
        self.flush()

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages written so far, by topic."""
        return {name: self._counts[name] for name in self._topics}

    def add_topic(self, topic: BagTopic) -> None:
        """Declare ``topic``, once and before its first message."""
        schema = self._schemas.get(topic.message_type)
        if schema is None:
            schema = self._schemas[topic.message_type] = self._writer.register_schema(
                topic.message_type, "ros2msg", topic.definition.encode()
            )
        metadata = {
            "offered_qos_profiles": yaml.safe_dump(list(topic.offered_qos), sort_keys=False),
            "topic_type_hash": topic.type_hash,
        }
        channel = self._writer.register_channel(topic.name, "cdr", schema, metadata)
        self._topics[topic.name] = (topic, channel)

    def write(self, name: str, data: bytes, *, received_ns: int, published_ns: int) -> None:
        """Append a CDR message of the topic ``name``; both times are in ns since 1970."""
        _, channel = self._topics[name]
        sequence = self._counts[name]
        self._guarded(
            lambda: self._writer.add_message(
                channel, received_ns, data, publish_time=published_ns, sequence=sequence
            )
        )
        self._counts[name] += 1
        self._first_ns = received_ns if self._first_ns is None else min(self._first_ns, received_ns)
        self._last_ns = max(self._last_ns, received_ns)

    def flush(self) -> None:
        """Pass all messages to the operating system, so that they survive this process."""
        self._guarded(self._writer.flush)

    def sync(self) -> None:
        """Write flushed messages to the disk. Slow; may be called from a thread beside `write`."""
        self._guarded(self._file.sync)

    def close(self) -> None:
        """Write the index of the file and ``metadata.yaml``; a second call does nothing."""
        if self._file.closed:
            return
        try:
            if not self._failed:
                self._guarded(self._writer.finish)
                self._guarded(self._file.finish)
                self.sync()
                self._write_metadata()
        finally:
            try:
                self._file.close()
            except OSError:  # reported by the write that failed first
                self._failed = True

    def _guarded(self, act: Callable[[], object]) -> None:
        if self._failed:
            raise InputError(f"{self._path} cannot be written: an earlier write failed")
        try:
            act()
        except OSError as error:
            self._failed = True
            raise InputError(
                f"{self._path} cannot be written: {error.strerror}; "
                f"up to {sum(self._counts.values())} messages written before remain"
            ) from error

    def _write_metadata(self) -> None:
        first_ns = self._first_ns or 0
        start = {"nanoseconds_since_epoch": first_ns}
        duration = {"nanoseconds": max(0, self._last_ns - first_ns)}
        count = sum(self._counts.values())
        information = {
            "version": _METADATA_VERSION,
            "storage_identifier": "mcap",
            "duration": duration,
            "starting_time": start,
            "message_count": count,
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": topic.name,
                        "type": topic.message_type,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": list(topic.offered_qos),
                        "type_description_hash": topic.type_hash,
                    },
                    "message_count": self._counts[topic.name],
                }
                for topic, _ in self._topics.values()
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self._path.name],
            "files": [
                {
                    "path": self._path.name,
                    "starting_time": start,
                    "duration": duration,
                    "message_count": count,
                }
            ],
            "custom_data": None,
            "ros_distro": "jazzy",
        }
        document = {"rosbag2_bagfile_information": information}
        # Other readers of bags may not know YAML aliases.
        text = yaml.dump(document, Dumper=_PlainDumper, sort_keys=False)
        contents = {"metadata.yaml": text.encode()}
        self._guarded(lambda: write_files(self._folder, contents))


class _PlainDumper(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True
