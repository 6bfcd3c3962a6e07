"""Writes a rosbag2 folder in MCAP that stays readable up to the last flush after a crash."""

import os
import struct
import threading
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Self, cast

import yaml
from mcap.writer import CompressionType, Writer

from app.files.atomic_io import write_files
from app.geometry import InputError, MarginGuardError

_TAIL = (
    struct.pack("<BQI", 0x0F, 4, 0)  # DataEnd without a CRC
    + struct.pack("<BQQQI", 0x02, 20, 0, 0, 0)  # Footer: no summary section, no CRC
    + b"\x89MCAP0\r\n"
)
"""Ends a file without an index. The next flush replaces it."""


class CompleteFile:
    """Collects what `mcap.writer.Writer` writes, and appends it to a new file at each `flush`.

    Each flush is one system call and ends with a footer, so that the file is valid, without an
    index, whenever the process is killed. `finish` writes without that footer: the writer has
    written its own. Raises `OSError`.
    """

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        self._pending = bytearray()
        self._written = 0
        self.closed = False

    def write(self, data: bytes) -> int:
        """Collect ``data`` until the next flush."""
        self._pending += data
        return len(data)

    def tell(self) -> int:
        """Position in the file of the next byte."""
        return self._written + len(self._pending)

    def flush(self) -> None:
        """Pass everything to the operating system, so that it survives this process."""
        self._append(_TAIL)

    def finish(self) -> None:
        """Write the last bytes, which end the file."""
        self._append(b"")

    def sync(self) -> None:
        """Write the file to the disk; may be called from a thread beside `write`."""
        os.fsync(self._descriptor)

    def close(self) -> None:
        """Close the file without a flush; a second call does nothing."""
        if not self.closed:
            self.closed = True
            os.close(self._descriptor)

    def _append(self, tail: bytes) -> None:
        if not self._pending:
            return
        data = memoryview(bytes(self._pending) + tail)
        at = 0
        try:
            while at < len(data):
                at += os.pwrite(self._descriptor, data[at:], self._written + at)
        except OSError:
            # The file ends as before; its blocks exist, so no space is needed.
            with suppress(OSError):
                os.ftruncate(self._descriptor, self._written)
                os.pwrite(self._descriptor, _TAIL, self._written)
            raise
        self._written += len(self._pending)
        self._pending.clear()


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


FLUSH_S = 0.02
"""Interval between flushes. A killed recorder loses the messages since the last one."""

SYNC_S = 1.0
"""Interval between syncs. A power cut loses the messages since the last one."""


class PeriodicFlush:
    """``with PeriodicFlush(flush, sync): ...`` calls both periodically, each in its own thread.

    ``sync`` may wait for the disk without delaying ``flush``. A `MarginGuardError` of either ends
    its thread; the functions raise it again when the owner of the recording calls them.
    """

    def __init__(self, flush: Callable[[], None], sync: Callable[[], None]) -> None:
        self._stopped = threading.Event()
        self._threads = [
            threading.Thread(target=self._repeat, args=(flush, FLUSH_S), name="flush", daemon=True),
            threading.Thread(target=self._repeat, args=(sync, SYNC_S), name="sync", daemon=True),
        ]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        for thread in self._threads:
            thread.join()

    def _repeat(self, act: Callable[[], None], interval_s: float) -> None:
        while not self._stopped.wait(interval_s):
            try:
                act()
            except MarginGuardError:
                return
