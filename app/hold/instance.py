"""Identity of the live session that a lock and a record belong to, and the errors of both."""

import hashlib
import platform
import re
from dataclasses import dataclass
from pathlib import Path

from app.geometry import MarginGuardError

_MACHINE_ID = Path("/etc/machine-id")
_MAX_NAME_CHARS = 40


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
