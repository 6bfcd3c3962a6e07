"""``live.yaml``: the keys of ``case.yaml`` with a live ``source`` instead of a recording.

The keys, their values and their reader.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

from app.case.case import Case
from app.case.manifest.case_file import (
    CASE,
    CLOCK,
    KNOWN_OFFSET,
    CaseManifest,
    load_document,
    read_manifest,
    with_lists,
)
from app.case.manifest.display_items import ENERGY_DEVICE
from app.case.manifest.images import LIVE_ACTIVATION, LIVE_IMAGES
from app.case.manifest.key_rules import topic_text
from app.case.manifest.robot import BY_MATRIX, BY_POINTS, REGISTRATION
from app.case.messages.ros_messages import TRACKED_TRANSFORMS_TOPIC
from app.files.bounded_io import is_file, is_folder
from app.files.declared import By, block_of, value_as
from app.files.document import Section
from app.files.keys import (
    Block,
    Boolean,
    Choice,
    Frame,
    Integer,
    Key,
    ListOf,
    Number,
    Text,
    Variant,
)
from app.geometry import InputError

ABOVE_0 = "every value is more than 0"
PASSIVE = "the force is passive with its period, delay and damping"
NEEDS_ROBOT = "tumor_motion needs a robot or a frame"


@dataclass(frozen=True, slots=True)
class _Edge:
    parent: Annotated[str, Frame("parent frame")]
    child: Annotated[str, Frame("child frame")]


@dataclass(frozen=True, slots=True)
class TfSourceEntry:
    """The tracker's poses are on ``/tf``, as ``edges`` (parent, child); empty finds them there."""

    edges: Annotated[
        tuple[tuple[str, str], ...],
        ListOf(
            "only these transforms; without it those between tool and tumour",
            block_of(_Edge, "a transform"),
            optional=True,
            if_empty="leave it out to use all edges on the topic",
        ),
        By(lambda tf: tuple((each.parent, each.child) for each in tf.value("edges") or ())),
    ]


@dataclass(frozen=True, slots=True)
class TopicSourceEntry:
    """The tracker's poses are on ``topic``, as ``marginguard_msgs/TrackedTransform``."""

    topic: Annotated[
        str,
        topic_text("topic of the poses", default=TRACKED_TRANSFORMS_TOPIC),
    ]


@dataclass(frozen=True, slots=True)
class IgtlSourceEntry:
    """The tracker's poses come over OpenIGTLink from a server such as PLUS."""

    host: Annotated[str, Text("name or address of the server")]
    port: Annotated[int, Integer("TCP port", 1, 65_535)]


LiveSourceEntry = TfSourceEntry | TopicSourceEntry | IgtlSourceEntry

_SOURCES = {
    "tf": block_of(TfSourceEntry, "poses on /tf, without the tracker's status", optional=True),
    "tracked_transforms": block_of(
        TopicSourceEntry,
        "poses with their status, as marginguard_msgs/TrackedTransform",
        optional=True,
    ),
    "igtl": block_of(IgtlSourceEntry, "poses of an OpenIGTLink server such as PLUS", optional=True),
}

SOURCE = Block(
    "where the tracker's poses come from",
    {
        **_SOURCES,
        "clock": Choice(
            "host: stamps are of this machine's clock; estimate: of another one",
            ("host", "estimate"),
        ),
        "latency_ms": Number(
            "delay from the acquisition of a pose to its stamp, for stamps of arrival",
            default=0.0,
            minimum=0.0,
            maximum=1000.0,
        ),
        "sigma_mm": Number(
            "standard deviation of a pose along each axis, slow errors included",
            default=0.0,
            minimum=0.0,
            maximum=100.0,
        ),
        "sigma_deg": Number(
            "standard deviation of a pose about each axis, slow errors included",
            default=0.0,
            minimum=0.0,
            maximum=45.0,
        ),
    },
    variants=tuple(Variant(name, (name,)) for name in _SOURCES),
)

_GUIDANCE = Block(
    "force that guides the hand; default: none",
    {
        "force_n": Number("largest force", minimum=0.0),
        "range_mm": Number("distance over which the force rises", minimum=0.0),
        "rate_n_s": Number("largest rate of change of the force", minimum=0.0),
        "period_ms": Number("interval between forces at the device", minimum=0.0),
        "delay_ms": Number("delay of the loop", minimum=0.0),
        "damping_n_s_m": Number("physical damping of the device", minimum=0.0),
    },
    optional=True,
    rules=(PASSIVE,),
)

_LIMITER = Block(
    "limits of the replies on ~/allowed_twist",
    {
        "tau_ms": Number("time constant of the approach", default=50.0, minimum=0.0),
        "lever_mm": Number("weight of rotation against translation", default=50.0, minimum=0.0),
        "retreat_mm_s": Number(
            "largest speed at which the tool is driven out of the margin",
            default=20.0,
            minimum=0.0,
        ),
        "max_speed_mm_s": Number("largest speed", default=250.0, minimum=0.0),
        "max_turn_rad_s": Number("largest angular speed", default=2.0, minimum=0.0),
        "accept_simulated": Boolean(
            "allow motion by recorded or simulated poses; only where no patient and no robot is",
            default=False,
        ),
    },
    optional=True,
    rules=(ABOVE_0,),
    old_names={"most_mm_s": "max_speed_mm_s", "most_rad_s": "max_turn_rad_s"},
)

_TUMOR_MOTION = Block(
    "expected motion of the tumour; default: it is still",
    {
        "swing_mm": Number("amplitude", minimum=0.0),
        "swing_deg": Number("amplitude of the rotation", minimum=0.0),
        "rate_hz": Number("frequency", minimum=0.0),
        "jitter_mm": Number("standard deviation of the tracker along each axis", minimum=0.0),
        "jitter_deg": Number("standard deviation of the tracker about each axis", minimum=0.0),
        "frame": Frame(
            "measured frame in which the velocity is estimated, at rest beside the robot's base; "
            "default: the reference",
            optional=True,
        ),
    },
    optional=True,
    rules=(ABOVE_0, NEEDS_ROBOT),
)

NODE_NAME = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
NODE_NAME_EXPECTED = "a node's name with its namespace, such as /console or /room/console"

_OPERATORS = ListOf(
    "nodes that may call ~/rearm and the other services that change or record the session, and set "
    "parameters; a guard against mistakes, not against attackers; default: every node",
    Text("name of a node", pattern=NODE_NAME, expected=NODE_NAME_EXPECTED),
    optional=True,
    if_empty="leave it out to accept every node",
)

_SECURITY = Choice(
    "required: refuse to start without ROS security (SROS2); optional: as the environment says",
    ("optional", "required"),
    default="optional",
)

LIVE_BLOCKS = {
    "guidance": _GUIDANCE,
    "limiter": _LIMITER,
    "tumor_motion": _TUMOR_MOTION,
}
"""Sections of numbers that ``case.yaml`` does not have."""

ONLY_LIVE: dict[str, Key] = {
    "source": SOURCE,
    **LIVE_BLOCKS,
    "operators": _OPERATORS,
    "security": _SECURITY,
}
"""Keys that ``case.yaml`` does not have."""

_ONLY_RECORDED = ("recording", "images", ENERGY_DEVICE.name, "expected")

_SHARED = {
    **{name: key for name, key in CASE.keys.items() if name not in _ONLY_RECORDED},
    "clock": replace(CLOCK, variants=(KNOWN_OFFSET,)),
    "images": LIVE_IMAGES,
    ENERGY_DEVICE.name: LIVE_ACTIVATION,
    "registration": replace(REGISTRATION, variants=(BY_MATRIX, BY_POINTS)),
}

LIVE = replace(CASE, description="a live session", keys={**_SHARED, **ONLY_LIVE})
LIVE_2 = with_lists(LIVE)


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
    live = read_live(load_document(path, LIVE, LIVE_2), path, package_dirs)
    live = replace(live, case=live.case.with_own_packages())
    live.case.check_files()
    return live


def read_live(document: Section, path: Path, package_dirs: Sequence[Path] = ()) -> LiveCase:
    """Read a document with the keys of `LIVE`, of the file ``path``; check no other files."""
    manifest = read_manifest(document, path.name)
    tracker = document.section("source")
    source = _source(tracker)
    _check_recorded_only(document, manifest)
    image_device = _image_device(document, source)
    _check_activation(document, manifest, source)
    case = Case(path.parent, manifest, None, tuple(package_dirs))
    limiter: Section | None = document.value("limiter")
    motion: Section | None = document.value("tumor_motion")
    if limiter is not None:
        case.add_notes(limiter.notes)
    return LiveCase(
        case,
        source,
        stamps_of_host=tracker.choice("clock") == "host",
        joints_of_host="clock" not in document,
        guidance=_numbers(document, "guidance"),
        limiter=_numbers(document, "limiter") or MappingProxyType({}),
        moves_by_simulated=limiter is not None and limiter.boolean("accept_simulated"),
        tumor_motion=_numbers(document, "tumor_motion"),
        operators=document.value("operators"),
        needs_security=document.choice("security") == "required",
        motion_frame=None if motion is None else motion.value("frame"),
        latency_ns=value_as(tracker, "latency_ns"),
        sigma_mm=tracker.number("sigma_mm"),
        sigma_rad=value_as(tracker, "sigma_rad"),
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


def _source(block: Section) -> LiveSourceEntry:
    given = [name for name in _SOURCES if name in block]
    if len(given) != 1:
        raise InputError(
            f"{block.where} has {' and '.join(given) or 'none'} of "
            f"{', '.join(_SOURCES)}; expected one of them"
        )
    source: LiveSourceEntry = block.value(given[0])
    return source


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
    device: str | None = block.value("device")
    return device


def _check_activation(document: Section, manifest: CaseManifest, source: LiveSourceEntry) -> None:
    entry = manifest.activation
    if entry is not None and entry.device is not None and not isinstance(source, IgtlSourceEntry):
        raise InputError(
            f"{document.place(ENERGY_DEVICE.name)}.device is {entry.device!r} and the "
            "source is not igtl; expected a topic of std_msgs/Bool, or source.igtl"
        )


def _check_recorded_only(document: Section, manifest: CaseManifest) -> None:
    """Raise `InputError` for what is estimated from a recording."""
    if manifest.clock.estimate:
        raise InputError(
            f"{document.place('clock')}.estimate needs a recording: estimate the offset with "
            "'marginguard calibrate time' and give it as offset_robot_to_tracker_ms"
        )
    registrations = [arm.registration for arm in manifest.arms] or [manifest.registration]
    if any(each is not None and each.dwells for each in registrations):
        raise InputError(
            f"{document.place('registration')}.dwells needs a recording: register one with "
            "'marginguard calibrate robot-base' and give the result as method: given"
        )
