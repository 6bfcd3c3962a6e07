"""The record of a run: a small JSON file that tells the next run how this one ended."""

import hashlib
import json
import platform
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from app.files.bounded_io import read_bounded
from app.geometry import NS_PER_S, MarginGuardError

_MACHINE_ID = Path("/etc/machine-id")
_MAX_NAME_CHARS = 40

VERSION = 2
MAX_BYTES = 64 * 1024
MAX_CAUSES = 16
MAX_CAUSE_CHARS = 400
_MAX_NS = 253_402_300_799 * 10**9
"""The last second of the year 9999: later times cannot be displayed."""

RESTARTED = "guard restarted"
"""Begins the first cause of a hold that an earlier run has left."""

_MAX_EARLIER = 7


class StateFileError(MarginGuardError):
    """The record of the last run cannot be used, or that of this run cannot be written."""


class SecondInstanceError(MarginGuardError):
    """Another guard has the same namespace or the same arm."""


@dataclass(frozen=True, slots=True)
class Slot:
    """Something that only one guard has at a time: a namespace or an arm, of a host and a domain.

    ``stem`` is the name of its files, without ending.
    """

    host: str
    domain: int
    kind: str
    name: str

    @property
    def stem(self) -> str:
        """A file name that people can read, made unique by a digest."""
        readable = re.sub(r"[^A-Za-z0-9]+", "_", self.name)[:_MAX_NAME_CHARS].strip("_")
        text = "\0".join((self.host, str(self.domain), self.kind, self.name))
        digest = hashlib.sha256(text.encode()).hexdigest()[:12]
        return "-".join(filter(None, (f"domain{self.domain}", self.kind, readable, digest)))

    def __str__(self) -> str:
        return f"{self.kind} {self.name!r} in ROS domain {self.domain}"


@dataclass(frozen=True, slots=True)
class InstanceKey:
    """Host, ROS domain, namespace and arm of a live session.

    ``namespace`` begins with a slash. ``arm`` names the robot; it is empty for a tool that is held
    by hand, which several guards may watch.
    """

    host: str
    domain: int
    namespace: str
    arm: str

    @property
    def slots(self) -> tuple[Slot, ...]:
        """The namespace and, with a robot, the arm."""
        namespace = Slot(self.host, self.domain, "namespace", self.namespace)
        if not self.arm:
            return (namespace,)
        return (namespace, Slot(self.host, self.domain, "arm", self.arm))


def host_id(machine_id: Path = _MACHINE_ID) -> str:
    """Identifier of this machine, which stays when its name changes.

    Home folders may be shared by several machines. A digest, because systemd asks programs not to
    publish the machine's id. Without an id: the name of the machine.
    """
    try:
        text = machine_id.read_text("utf-8").strip()
    except (OSError, UnicodeDecodeError):
        text = ""
    return hashlib.sha256(f"marginguard {text or platform.node()}".encode()).hexdigest()[:16]


def arm_name(robot: str, joint_topic: str | None) -> str:
    """Name of an arm: two arms of one model have the same URDF and different topics of joints."""
    return robot if joint_topic is None else f"{robot} {joint_topic}"


@dataclass(frozen=True, slots=True)
class HoldRecord:
    """A latched hold: the system time at which it began, and its causes."""

    since_ns: int
    causes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class RunRecord:
    """A run of a live session; times are system times in ns.

    ``ended`` is False from the start of the run to its orderly end. So the record of a killed run
    says that it did not end, whatever was written last. ``hold`` is None without a latched hold.
    ``used``: the values that the run used last (`UsedValues`).
    """

    key: InstanceKey
    pid: int
    started_ns: int
    written_ns: int
    ended: bool
    hold: HoldRecord | None
    used: Mapping[str, Any]

    @property
    def allows_start(self) -> bool:
        """True if the next run may start without hold: orderly end, no hold latched."""
        return self.ended and self.hold is None


def as_bytes(record: RunRecord) -> bytes:
    """The content of the file, with a digest over everything else."""
    values = {"version": VERSION, **asdict(record)}
    if record.hold is not None:
        causes = [cause[:MAX_CAUSE_CHARS] for cause in record.hold.causes[:MAX_CAUSES]]
        values["hold"] = {"since_ns": record.hold.since_ns, "causes": causes}
    values["sha256"] = _digest(values)
    return (json.dumps(values, indent=2) + "\n").encode()


def read_record(path: Path, slot: Slot) -> RunRecord | None:
    """Read the record of ``slot``; None if there is no file.

    Raises `StateFileError` for a file that cannot be read, is damaged, is of a newer version or
    belongs to another slot.
    """
    if not path.exists() and not path.is_symlink():
        return None
    record = read_any_record(path)
    if slot not in record.key.slots:
        raise StateFileError(f"{path.name}: the record of another session; expected {slot}")
    return record


def read_any_record(path: Path) -> RunRecord:
    """Read the record at ``path``, of whatever session; raises as `read_record` does."""
    content = read_bounded(path, MAX_BYTES, StateFileError)
    try:
        return _record(json.loads(content))
    except RecursionError as error:
        raise StateFileError(f"{path.name}: nested too deeply; expected a record") from error
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise StateFileError(f"{path.name}: damaged; expected the record of a run") from error


def _record(values: dict[str, Any]) -> RunRecord:
    version = values["version"]
    if type(version) is int and version != VERSION:
        age = "a newer" if version > VERSION else "an older"
        raise StateFileError(
            f"the record has version {version}, of {age} program; expected {VERSION}"
        )
    digest = values.pop("sha256")
    if type(version) is not int or digest != _digest(values):
        raise ValueError("digest")
    del values["version"]
    key, hold = values.pop("key"), values.pop("hold")
    record = RunRecord(
        **values,
        key=InstanceKey(**key),
        hold=None if hold is None else HoldRecord(hold["since_ns"], tuple(hold["causes"])),
    )
    times = [record.started_ns, record.written_ns, *([record.hold.since_ns] if record.hold else [])]
    if not isinstance(record.used, dict):
        raise ValueError("types")
    if type(record.ended) is not bool or not all(
        type(time) is int and 0 <= time <= _MAX_NS for time in times
    ):
        raise ValueError("types")
    if record.hold and not all(isinstance(cause, str) for cause in record.hold.causes):
        raise ValueError("types")
    return record


def _digest(values: dict[str, Any]) -> str:
    """Detects damage, not manipulation."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def causes_of_record(record: RunRecord, alive_ns: int | None) -> tuple[str, ...]:
    """Causes of the hold after the run of ``record``; empty if the next run may start without.

    ``alive_ns``: system time at which that run was last seen alive, None if it is not known.
    """
    if record.allows_start:
        return ()
    hold = record.hold
    since = "" if hold is None else f", hold since {local_time(hold.since_ns)}"
    if record.ended:
        how = f"ended on hold at {local_time(record.written_ns)}"
    else:
        last_ns = max(record.written_ns, alive_ns or 0)
        how = f"ended without a stop at about {local_time(last_ns)}"
    earlier = () if hold is None else hold.causes
    kept = [cause for cause in earlier if not cause.startswith(RESTARTED)]
    first = f"{RESTARTED}: the last run (process {record.pid}) {how}{since}"
    return (first, *kept[:_MAX_EARLIER])


def causes_of_damage(problem: object) -> tuple[str, ...]:
    """Causes of the hold if the record of the last run cannot be used."""
    return (f"{RESTARTED}: how the last run ended is not known: {problem}",)


def local_time(ns: int) -> str:
    """Local time in ISO 8601 with seconds and offset; the number where it is no time of day."""
    try:
        return datetime.fromtimestamp(ns // NS_PER_S).astimezone().isoformat(timespec="seconds")
    except (OverflowError, OSError, ValueError):
        return f"{ns} ns"
