"""Reads ``live.yaml``: the keys of ``case.yaml`` with a live ``source`` instead of a recording."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from app.case.case import Case
from app.case.manifest.entries import CaseManifest, ClockEntry, RegistrationEntry, RobotEntry
from app.case.manifest.sections import (
    check_schema,
    read_clock,
    read_frame,
    read_margins,
    read_provenance,
    read_registration,
    read_robot,
    read_tool,
    read_topic,
    read_tumor,
)
from app.case.messages.ros_messages import TRACKED_TRANSFORMS_TOPIC
from app.files.document import Section
from app.geometry import InputError


@dataclass(frozen=True, slots=True)
class TfSourceEntry:
    """The tracker's poses are on ``/tf``, as ``edges`` (parent, child); empty finds them there."""

    edges: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class TopicSourceEntry:
    """The tracker's poses are on ``topic``, as ``marginguard_msgs/TrackedTransform``."""

    topic: str


@dataclass(frozen=True, slots=True)
class IgtlSourceEntry:
    """The tracker's poses come over OpenIGTLink from a server such as PLUS."""

    host: str
    port: int


LiveSourceEntry = TfSourceEntry | TopicSourceEntry | IgtlSourceEntry

ONLY_LIVE = ("source", "guidance", "limiter", "tumor_motion")
"""Sections that ``case.yaml`` does not have."""

_GUIDANCE = ("force_n", "range_mm", "rate_n_s", "period_ms", "delay_ms", "damping_n_s_m")
_TUMOR_MOTION = ("swing_mm", "swing_deg", "rate_hz", "jitter_mm", "jitter_deg")
_LIMITER = ("tau_ms", "lever_mm", "retreat_mm_s", "most_mm_s", "most_rad_s")

_MAX_PORT = 65_535
_SOURCES = ("tf", "tracked_transforms", "igtl")


@dataclass(frozen=True, slots=True, eq=False)
class LiveCase:
    """The configuration of a live session. ``case`` has everything but a recording.

    ``stamps_of_host``: whether the source stamps by the clock of this machine; otherwise the offset
    of its clock is estimated as samples arrive. ``joints_of_host``: whether the robot does;
    otherwise its stamps plus ``clock.offset_robot_to_tracker_ms`` are times on the source's clock,
    as in a case. ``guidance``: all values of a guidance force, None without one. ``limiter``: the
    given values of the twist limiter. ``tumor_motion``: all values of the tumour's expected motion,
    None for a tumour at rest. Values are by name, in seconds and radians.
    """

    case: Case
    source: LiveSourceEntry
    stamps_of_host: bool
    joints_of_host: bool
    guidance: Mapping[str, float] | None
    limiter: Mapping[str, float]
    tumor_motion: Mapping[str, float] | None


def open_live(path: Path, *, package_dirs: Sequence[Path] = ()) -> LiveCase:
    """Read ``live.yaml`` and check that the files that it names exist beside it.

    Raises `InputError` for the first fault.
    """
    if not path.is_file():
        found = "it is a folder" if path.is_dir() else "no such file"
        raise InputError(f"{path} is not a live configuration: {found}")
    document = Section.load(
        path,
        (
            "schema",
            "name",
            "provenance",
            "clock",
            "tool",
            "tumor",
            "robot",
            "registration",
            "margins",
            *ONLY_LIVE,
        ),
    )
    check_schema(document)
    robot, tool = read_robot(document), read_tool(document)
    source, stamps_of_host = _source(document)
    case = Case(
        path.parent,
        CaseManifest(
            file=path.name,
            name=document.text("name"),
            provenance=read_provenance(document),
            recording=None,
            clock=_clock(document),
            tool=tool,
            tumor=read_tumor(document, tool),
            robot=robot,
            registration=_registration(document, robot),
            margins=read_margins(document),
            expected=None,
        ),
        None,
        tuple(package_dirs),
    )
    case.check_files()
    return LiveCase(
        case,
        source,
        stamps_of_host,
        joints_of_host="clock" not in document,
        guidance=_all_of(document, "guidance", _GUIDANCE),
        limiter=_given(document, "limiter", _LIMITER, partly=True)
        if "limiter" in document
        else MappingProxyType({}),
        tumor_motion=_all_of(document, "tumor_motion", _TUMOR_MOTION),
    )


def _all_of(document: Section, name: str, keys: Sequence[str]) -> Mapping[str, float] | None:
    return _given(document, name, keys) if name in document else None


def _given(
    document: Section, name: str, keys: Sequence[str], *, partly: bool = False
) -> Mapping[str, float]:
    """Read the numbers of a section, 0 or more; their consumers check their upper limits."""
    block = document.section(name, keys)
    found = {}
    for key in keys:
        if partly and key not in block:
            continue
        value = block.number(key, minimum=0.0)
        if key.endswith("_ms"):
            key, value = key.removesuffix("_ms") + "_s", value / 1000.0
        if key.endswith("_deg"):
            key, value = key.removesuffix("_deg") + "_rad", math.radians(value)
        found[key] = value
    return MappingProxyType(found)


def _source(document: Section) -> tuple[LiveSourceEntry, bool]:
    block = document.section("source", (*_SOURCES, "clock"))
    given = [name for name in _SOURCES if name in block]
    if len(given) != 1:
        raise InputError(
            f"{document.place('source')} has {' and '.join(given) or 'none'} of "
            f"{', '.join(_SOURCES)}; expected one of them"
        )
    of_host = block.choice("clock", ("host", "estimate")) == "host"
    if "tf" in block:
        return TfSourceEntry(_edges(block.section("tf", ("edges",)))), of_host
    if "igtl" in block:
        return _server(block.section("igtl", ("host", "port"))), of_host
    topic_block = block.section("tracked_transforms", ("topic",))
    topic = TRACKED_TRANSFORMS_TOPIC
    if "topic" in topic_block:
        topic = read_topic(topic_block, "topic")
    return TopicSourceEntry(topic), of_host


def _server(igtl: Section) -> IgtlSourceEntry:
    port = igtl.integer("port", minimum=1)
    if port > _MAX_PORT:
        raise InputError(f"{igtl.place('port')} is {port}; expected 1 to {_MAX_PORT}")
    return IgtlSourceEntry(igtl.text("host"), port)


def _edges(tf: Section) -> tuple[tuple[str, str], ...]:
    if "edges" not in tf:
        return ()
    edges = tf.sections("edges", ("parent", "child"))
    if not edges:
        raise InputError(
            f"{tf.place('edges')} is empty; leave it out to use all edges on the topic"
        )
    return tuple((read_frame(edge, "parent"), read_frame(edge, "child")) for edge in edges)


def _clock(document: Section) -> ClockEntry:
    clock = read_clock(document)
    if clock.estimate:
        raise InputError(
            f"{document.place('clock')}.estimate needs a recording: estimate the offset with "
            "'marginguard calibrate time' and give it as offset_robot_to_tracker_ms"
        )
    return clock


def _registration(document: Section, robot: RobotEntry | None) -> RegistrationEntry | None:
    entry = read_registration(document, robot)
    if entry is not None and entry.dwells:
        raise InputError(
            f"{document.place('registration')}.dwells needs a recording: register one with "
            "'marginguard register' and give the result as method: given"
        )
    return entry
