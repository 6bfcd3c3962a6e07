"""Records a session's topics, kills the recorder, and compares its file with what was sent."""

import struct
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from app.case.readers.rosbag2.bag import read_bag
from app.geometry import NS_PER_MS, NS_PER_S
from tests.forking import COMMAND, forked
from tests.recorder.streams import Stream, streams

PROMISED_MS = 100.0
_STAMP = struct.Struct("<iI")


@dataclass(frozen=True, slots=True)
class Kill:
    """Losses of one killed recording.

    ``recorded``: messages in the file. ``lost``: messages sent after the last recorded one of their
    topic and before the kill, by topic. ``lost_ms``: time from the oldest of these to the kill, 0
    without any. ``missed``: messages that did not arrive before later ones did, as on an overloaded
    machine. ``in_mcap``: messages that the MCAP library reads from the file.
    """

    recorded: int
    lost: dict[str, int]
    lost_ms: float
    missed: int
    in_mcap: int

    @property
    def is_good(self) -> bool:
        """True if the promise was kept and the MCAP library reads the whole file."""
        return self.lost_ms <= PROMISED_MS and self.in_mcap == self.recorded > 0


def run_kill(folder: Path, seconds: float) -> Kill:
    """Record in ``folder`` for ``seconds`` after the first messages, then send SIGKILL."""
    case, sent_file = folder / "case", folder / "sent.npz"
    topics = [stream.topic.name for stream in streams()]
    record = ("-m", "app.cli", "record", "-o", case, "--topics", *topics)
    with (
        forked(*record, modules=COMMAND) as recorder,
        forked("-m", "tests.recorder.sender", sent_file, modules=COMMAND) as sender,
    ):
        assert sender.stdout.readline() == "sending\n"
        time.sleep(seconds)
        killed_ns = time.time_ns()
        recorder.kill()
        recorder.wait()
        sender.stdin.close()
        sender.wait(60.0)
    with np.load(sent_file) as arrays:
        sent = {name.replace("|", "/"): arrays[name] for name in arrays.files}
    return compared(case / "tracking" / "tracking_0.mcap", sent, killed_ns)


def compared(path: Path, sent: dict[str, np.ndarray], killed_ns: int) -> Kill:
    """Compare the messages in ``path`` with the stamps ``sent`` until ``killed_ns``."""
    stamps: dict[str, list[int]] = {name: [] for name in sent}
    of_topic = {stream.topic.name: stream for stream in streams()}
    for connection, data, *_ in read_bag(path, _refuse_note):
        stamps[connection.topic].append(_stamp_ns(data, of_topic[connection.topic]))
    lost, missed, oldest_ns = {}, 0, killed_ns
    for name, times in sent.items():
        recorded = np.array(stamps[name] or [killed_ns], dtype=np.int64)
        before = times[(times >= recorded.min()) & (times < killed_ns)]
        tail = before[before > recorded.max()]
        lost[name] = len(tail)
        missed += len(np.setdiff1d(before, recorded)) - len(tail)
        oldest_ns = min([oldest_ns, *tail[:1].tolist()])
    with path.open("rb") as file:
        in_mcap = sum(1 for _ in make_reader(file).iter_messages())
    total = sum(map(len, stamps.values()))
    return Kill(total, lost, (killed_ns - oldest_ns) / NS_PER_MS, missed, in_mcap)


def _stamp_ns(data: bytes, stream: Stream) -> int:
    sec, nanosec = _STAMP.unpack_from(data, stream.stamp_at)
    return int(sec) * NS_PER_S + int(nanosec)


def _refuse_note(note: str) -> None:
    if "has no index" not in note:
        raise RuntimeError(note)
