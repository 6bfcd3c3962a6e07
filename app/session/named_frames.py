"""Checks that the frames named in a case are among those that its tracker measures."""

from collections.abc import Collection, Iterable, Mapping, Sequence

from app.case import Case, StructureEntry
from app.geometry import Edge, FrameError, shortest_path
from app.session.setup import REFERENCE, SessionSetup

_TOOL = "tool.frame"
_TUMOR = "tumor.frame"
_REGISTERED = "the frame of a robot's registration"

_MAX_SHOWN = 20
_MAX_CHARS = 40
"""Limits of one message line with names received from the network."""


def check_frames(case: Case, *, with_tumor: bool = True) -> None:
    """Raise `FrameError` if the recording does not connect the tool to every required frame.

    Required are the tumour's frame (``with_tumor``) and, with a robot, the reference. A robot's
    base that the recording itself measures is rejected too, because the registration would place
    it a second time. Reads the recording up to the frame from which all are connected: usually the
    first, and all of it if they never are. Later errors are reported by the session. A live case
    always passes, because it has no frames yet.
    """
    manifest = case.manifest
    tool, robot = manifest.tool.frame, manifest.robot
    structures = (manifest.tumor, *manifest.structures) if with_tumor else ()
    required = {f"{each.key}.frame": each.frame for each in structures}
    if robot is not None:
        required[_REGISTERED] = REFERENCE
    if case.recording_path is None or not required:
        return
    edges = _edges_leading(case, tool, tuple(required.values()))
    if places := _unknown_frames({_TOOL: tool, **required}, edges):
        raise FrameError(
            f"{manifest.file}: {places}: no such frame is in the recording; expected one of "
            f"{', '.join(_names(edges)) or 'none'}"
        )
    if places := _disconnected(tool, required, edges):
        raise FrameError(
            f"{manifest.file}: {places}: not connected to {_TOOL} {tool!r} in the recording, "
            f"which has {_shown(edges)}"
        )
    for each in (manifest.tumor, *manifest.structures):
        if isinstance(each, StructureEntry) and each.name in _names(edges):
            raise FrameError(
                f"{manifest.file}: {each.key}.name is that of a frame of the recording; "
                "expected a name of its own"
            )
    placed = (
        *edges,
        (tool, manifest.tool.tip_frame),
        *((each.frame, each.frame_from_tumor.source) for each in structures),
    )
    if robot is not None and shortest_path(placed, REFERENCE, robot.base_frame) is not None:
        raise FrameError(
            f"{manifest.file}: robot.base_frame is {robot.base_frame!r}; expected a name of its "
            f"own, not one that is placed without the robot: {_shown(placed)}"
        )


def missing_frames_problem(
    setup: SessionSetup, edges: tuple[Edge, ...], named: Collection[Edge] = frozenset()
) -> str:
    """One line on the frames missing from the ``edges`` that a live tracker has sent; else empty.

    With ``named`` only these edges are used.
    """
    if named:
        if missing := sorted(set(named).difference(edges)):
            return (
                f"source.tf.edges has {_shortened(_arrows(missing))}: not sent by the tracker so "
                f"far; it sends {_shortened(_arrows(edges))}"
            )
        edges, sent = tuple(sorted(named)), "source.tf.edges has"
    else:
        sent = "the tracker sends so far"
    tool, required = setup.tool_from_tip.target, {_TUMOR: setup.frame_from_tumor.target}
    required |= {
        f"structures.{each.name}.frame": each.frame_from_structure.target
        for each in setup.structures
    }
    if setup.robot is not None:
        required[_REGISTERED] = REFERENCE
    if places := _unknown_frames({_TOOL: tool, **required}, edges):
        return f"{places}: not among what {sent}, {_shortened(_names(edges))}"
    if places := _disconnected(tool, required, edges):
        return (
            f"{places}: not connected to {_TOOL} {tool!r} by what {sent}, "
            f"{_shortened(_arrows(edges))}"
        )
    return ""


def nothing_received_problem(setup: SessionSetup) -> str:
    """One line on a tracker that has not sent any pose so far."""
    structures = (each.frame_from_structure.target for each in setup.guarded)
    frames = dict.fromkeys([setup.tool_from_tip.target, *structures])
    return (
        f"tracker: no pose has come so far; expected poses of {', '.join(map(repr, frames))}: "
        "check that it runs and sends to the source of the configuration"
    )


def path_to_base(setup: SessionSetup, edges: tuple[Edge, ...]) -> tuple[Edge, ...]:
    """Those of ``edges`` that place the robot's base without its registration; empty if none.

    The fixed edges of tip and tumour count as measured.
    """
    robot = setup.robot
    if robot is None or not any(robot.base_frame in edge for edge in edges):
        return ()
    fixed = (setup.tool_from_tip, *(each.frame_from_structure for each in setup.guarded))
    placed = (*edges, *((edge.target, edge.source) for edge in fixed))
    path = shortest_path(placed, REFERENCE, robot.base_frame) or ()
    return tuple(edge for edge in path if edge in edges)


def base_measured_problem(setup: SessionSetup, edges: tuple[Edge, ...]) -> str:
    """One line on ``edges`` that measure a registered robot base; empty if there are none.

    Two parents of one frame are a loop: tf alternates between them.
    """
    robot = setup.robot
    path = path_to_base(setup, edges)
    if robot is None or robot.registration is None or not path:
        return ""
    return (
        f"robot.base_frame is {robot.base_frame!r}; expected a name of its own: the tracker "
        f"measures it by {_shortened(_arrows(path))}"
    )


def _edges_leading(case: Case, tool: str, required: tuple[str, ...]) -> tuple[Edge, ...]:
    """Edges of the recording up to the frame that connects the tool to all ``required``."""
    edges: dict[Edge, None] = {}
    for frame in case.recorded_frames():
        new = {(sample.target, sample.source): None for sample in frame.poses}
        if new.keys() <= edges.keys():
            continue
        edges |= new
        known = tuple(edges)
        if all(shortest_path(known, tool, name) is not None for name in required):
            break
    return tuple(edges)


def _unknown_frames(required: Mapping[str, str], edges: Iterable[Edge]) -> str:
    """Frames that no edge touches: ``tumor.frame is 'needel'``; empty if there are none."""
    names = _names(edges)
    return _places({place: name for place, name in required.items() if name not in names})


def _disconnected(tool: str, required: Mapping[str, str], edges: tuple[Edge, ...]) -> str:
    """Frames without a path from ``tool``, in the same form."""
    return _places(
        {
            place: name
            for place, name in required.items()
            if shortest_path(edges, tool, name) is None
        }
    )


def _places(frames: Mapping[str, str]) -> str:
    return " and ".join(f"{place} is {name!r}" for place, name in frames.items())


def _names(edges: Iterable[Edge]) -> list[str]:
    return sorted({name for edge in edges for name in edge})


def _arrows(edges: Iterable[Edge]) -> list[str]:
    return [f"{target} -> {source}" for target, source in edges]


def _shown(edges: Iterable[Edge]) -> str:
    return ", ".join(_arrows(edges))


def _shortened(words: Sequence[str]) -> str:
    """The first of ``words``, each cut to `_MAX_CHARS`, and the number of the others."""
    few = [
        word if len(word) <= _MAX_CHARS else f"{word[:_MAX_CHARS]}..."
        for word in words[:_MAX_SHOWN]
    ]
    more = len(words) - len(few)
    return ", ".join([*few, *([f"{more} more"] if more else [])])
