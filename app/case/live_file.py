"""Reads ``live.yaml``: the keys of ``case.yaml`` with a live ``source`` instead of a recording."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from app.case.case import Case
from app.case.live_keys import LIVE, LIVE_BLOCKS, SOURCE
from app.case.manifest.cautery import read_cautery
from app.case.manifest.entries import (
    CaseManifest,
    CauteryEntry,
    ClockEntry,
    RegistrationEntry,
    RobotEntry,
)
from app.case.manifest.images import read_images
from app.case.manifest.needle import read_needle
from app.case.manifest.plausibility import read_plausibility
from app.case.manifest.sections import (
    read_clock,
    read_margins,
    read_package_dirs,
    read_provenance,
    read_registration,
    read_robot,
    read_tool,
    read_tumor,
)
from app.case.manifest.stylus import read_stylus
from app.files.bounded_io import is_file, is_folder
from app.files.document import Section
from app.files.keys import Number
from app.geometry import NS_PER_MS, InputError


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


@dataclass(frozen=True, slots=True, eq=False)
class LiveCase:
    """The configuration of a live session. ``case`` has everything but a recording.

    ``stamps_of_host``: whether the source stamps by the clock of this machine; otherwise the offset
    of its clock is estimated as samples arrive. ``joints_of_host``: whether the robot does;
    otherwise its stamps plus ``clock.offset_robot_to_tracker_ms`` are times on the source's clock,
    as in a case. ``guidance``: all values of a guidance force, None without one. ``limiter``: the
    values of the twist limiter, ``moves_by_simulated``: whether it allows motion by recorded or
    simulated poses. ``tumor_motion``: all values of the tumour's expected motion,
    None for a tumour at rest; ``motion_frame`` is the frame in which it moves, None for the
    reference. Values are by name, in seconds and radians. ``operators``: full names
    of the nodes that may change the session, None for all. ``needs_security``: refuse to start
    without ROS security. ``latency_ns``: delay from the acquisition of a pose to its stamp.
    ``sigma_mm`` and ``sigma_rad``: standard deviation of a pose along and about each axis.
    ``image_device``: device of the OpenIGTLink images, None for the first.
    """

    case: Case
    source: LiveSourceEntry
    stamps_of_host: bool
    joints_of_host: bool
    guidance: Mapping[str, float] | None
    limiter: Mapping[str, float]
    moves_by_simulated: bool
    tumor_motion: Mapping[str, float] | None
    operators: tuple[str, ...] | None = None
    needs_security: bool = False
    motion_frame: str | None = None
    latency_ns: int = 0
    sigma_mm: float = 0.0
    sigma_rad: float = 0.0
    image_device: str | None = None


def open_live(path: Path, *, package_dirs: Sequence[Path] = ()) -> LiveCase:
    """Read ``live.yaml`` and check that the files that it names exist beside it.

    Raises `InputError` for the first fault.
    """
    if not is_file(path):
        found = "it is a folder" if is_folder(path) else "no such file"
        raise InputError(f"{path} is not a live configuration: {found}")
    live = read_live(Section.load(path, LIVE), path, package_dirs)
    live = replace(live, case=live.case.with_own_packages())
    live.case.check_files()
    return live


def read_live(document: Section, path: Path, package_dirs: Sequence[Path] = ()) -> LiveCase:
    """Read a document with the keys of `LIVE`, of the file ``path``; check no other files."""
    document.integer("schema")
    robot, tool = read_robot(document), read_tool(document)
    tumor, needle = read_tumor(document, tool), read_needle(document, tool)
    tracker = document.section("source")
    source, stamps_of_host = _source(tracker)
    image_device = _image_device(document, source)
    case = Case(
        path.parent,
        CaseManifest(
            file=path.name,
            name=document.text("name"),
            provenance=read_provenance(document),
            recording=None,
            clock=_clock(document),
            tool=tool,
            tumor=tumor,
            robot=robot,
            registration=_registration(document, robot),
            margins=read_margins(document),
            expected=None,
            plausibility=read_plausibility(document),
            images=read_images(document),
            needle=needle,
            stylus=read_stylus(document, tool, tumor, needle),
            cautery=_cautery(document, source),
            package_dirs=read_package_dirs(document),
        ),
        None,
        tuple(package_dirs),
    )
    if "limiter" in document:
        case.add_notes(document.section("limiter").notes)
    return LiveCase(
        case,
        source,
        stamps_of_host,
        joints_of_host="clock" not in document,
        guidance=_numbers(document, "guidance"),
        limiter=_numbers(document, "limiter") or MappingProxyType({}),
        moves_by_simulated="limiter" in document
        and document.section("limiter").boolean("accept_simulated"),
        tumor_motion=_numbers(document, "tumor_motion"),
        operators=document.texts("operators") if "operators" in document else None,
        needs_security=document.choice("security") == "required",
        motion_frame=_motion_frame(document),
        latency_ns=round(tracker.number("latency_ms") * NS_PER_MS),
        sigma_mm=tracker.number("sigma_mm"),
        sigma_rad=math.radians(tracker.number("sigma_deg")),
        image_device=image_device,
    )


def _numbers(document: Section, name: str) -> Mapping[str, float] | None:
    """Read all numbers of a section, in s and rad; their consumers check their upper limits."""
    if name not in document:
        return None
    block = document.section(name)
    found = {}
    for key, kind in LIVE_BLOCKS[name].keys.items():
        if not isinstance(kind, Number):
            continue
        value = block.number(key)
        if key.endswith("_ms"):
            key, value = key.removesuffix("_ms") + "_s", value / 1000.0
        if key.endswith("_deg"):
            key, value = key.removesuffix("_deg") + "_rad", math.radians(value)
        found[key] = value
    return MappingProxyType(found)


def _motion_frame(document: Section) -> str | None:
    """The frame of ``tumor_motion``; None if it is not given."""
    if "tumor_motion" not in document or "frame" not in document.section("tumor_motion"):
        return None
    return document.section("tumor_motion").frame("frame")


def _source(block: Section) -> tuple[LiveSourceEntry, bool]:
    names = [variant.name for variant in SOURCE.variants]
    given = [name for name in names if name in block]
    if len(given) != 1:
        raise InputError(
            f"{block.where} has {' and '.join(given) or 'none'} of "
            f"{', '.join(names)}; expected one of them"
        )
    of_host = block.choice("clock") == "host"
    source = block.section(given[0])
    if "tf" in block:
        return TfSourceEntry(_edges(source)), of_host
    if "igtl" in block:
        return IgtlSourceEntry(source.text("host"), source.integer("port")), of_host
    return TopicSourceEntry(source.text("topic")), of_host


def _image_device(document: Section, source: LiveSourceEntry) -> str | None:
    """The device of the images; raises `InputError` for images that nothing sends."""
    if "images" not in document:
        return None
    block = document.section("images")
    if "topic" in block and "device" in block:
        raise InputError(f"{block.where} has topic and device; expected one of them or none")
    if "topic" not in block and not isinstance(source, IgtlSourceEntry):
        raise InputError(
            f"{block.where} has no topic and the source is not igtl; expected a topic of "
            "sensor_msgs/Image, or source.igtl"
        )
    return block.text("device") if "device" in block else None


def _cautery(document: Section, source: LiveSourceEntry) -> CauteryEntry | None:
    entry = read_cautery(document)
    is_igtl = isinstance(source, IgtlSourceEntry)
    if entry is not None and entry.device is not None and not is_igtl:
        raise InputError(
            f"{document.place('cautery')}.device is {entry.device!r} and the source is not igtl; "
            "expected a topic of std_msgs/Bool, or source.igtl"
        )
    return entry


def _edges(tf: Section) -> tuple[tuple[str, str], ...]:
    if "edges" not in tf:
        return ()
    return tuple((edge.frame("parent"), edge.frame("child")) for edge in tf.sections("edges"))


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
