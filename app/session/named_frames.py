"""The frames that a case names, looked for among those that its tracker measures."""

from collections.abc import Collection, Iterable, Mapping, Sequence

from app.case import Case
from app.geometry import FrameError
from app.session.pose_tree import Edge, shortest_path
from app.session.setup import REFERENCE, SessionSetup

_TOOL = "tool.frame"
_TUMOR = "tumor.frame"
_REGISTERED = "the frame of a robot's registration"

_MOST_SHOWN = 20
_MOST_LETTERS = 40
"""Of what strangers name, in one line."""


def check_frames(case: Case, *, with_tumor: bool = True) -> None:
    """Raise `FrameError` where the recording never leads from the tool to a frame that is needed.

    That is the tumour's, ``with_tumor``, and with a robot the reference. A robot's base that is
    placed without the robot, as the recording measures it, is refused too: the registration would
    place it a second time. Read is up to the frame from which all is known: the first, as a rule,
    and the last where nothing leads there; what comes later is the session's to see. A live case
    passes, since its frames are still to come.
    """
    manifest = case.manifest
    tool, robot = manifest.tool.frame, manifest.robot
    wanted = {_TUMOR: manifest.tumor.frame} if with_tumor else {}
    if robot is not None:
        wanted[_REGISTERED] = REFERENCE
    if case.recording_path is None or not wanted:
        return
    edges = _edges_leading(case, tool, tuple(wanted.values()))
    if places := _unnamed({_TOOL: tool, **wanted}, edges):
        raise FrameError(
            f"{manifest.file}: {places}: no such frame is in the recording, which has "
            f"{', '.join(_names(edges)) or 'none'}"
        )
    if places := _apart(tool, wanted, edges):
        raise FrameError(
            f"{manifest.file}: {places}: nothing in the recording leads there from "
            f"{_TOOL} {tool!r}, it has {_shown(edges)}"
        )
    placed = (
        *edges,
        (tool, manifest.tool.tip_frame),
        (manifest.tumor.frame, manifest.tumor.frame_from_tumor.source),
    )
    if robot is not None and shortest_path(placed, REFERENCE, robot.base_frame) is not None:
        raise FrameError(
            f"{manifest.file}: robot.base_frame is {robot.base_frame!r}: a name of its own wanted, "
            f"placed without the robot are {_shown(placed)}"
        )


def not_sent(
    setup: SessionSetup, edges: tuple[Edge, ...], named: Collection[Edge] = frozenset()
) -> str:
    """What a live tracker that has sent ``edges`` so far lacks, in one line; empty for nothing.

    With ``named`` those alone are used.
    """
    if named:
        if missing := sorted(set(named).difference(edges)):
            return (
                f"source.tf.edges has {_few(_arrows(missing))}: not sent by the tracker so far, it "
                f"sends {_few(_arrows(edges))}"
            )
        edges, sent = tuple(sorted(named)), "source.tf.edges has"
    else:
        sent = "the tracker sends so far"
    tool, wanted = setup.tool_from_tip.target, {_TUMOR: setup.frame_from_tumor.target}
    if setup.robot is not None:
        wanted[_REGISTERED] = REFERENCE
    if places := _unnamed({_TOOL: tool, **wanted}, edges):
        return f"{places}: not among what {sent}, {_few(_names(edges))}"
    if places := _apart(tool, wanted, edges):
        return (
            f"{places}: nothing leads there from {_TOOL} {tool!r}, of what {sent}, "
            f"{_few(_arrows(edges))}"
        )
    return ""


def way_to_base(setup: SessionSetup, edges: tuple[Edge, ...]) -> tuple[Edge, ...]:
    """Those of ``edges`` by which the robot's base is placed without its registration.

    Empty when it is placed by that alone. Tip and tumour, which stay where they are in measured
    frames, count as placed.
    """
    robot = setup.robot
    if robot is None or not any(robot.base_frame in edge for edge in edges):
        return ()
    fixed = (setup.tool_from_tip, setup.frame_from_tumor)
    placed = (*edges, *((edge.target, edge.source) for edge in fixed))
    way = shortest_path(placed, REFERENCE, robot.base_frame) or ()
    return tuple(edge for edge in way if edge in edges)


def placed_twice(setup: SessionSetup, edges: tuple[Edge, ...]) -> str:
    """What is wrong where ``edges`` measure a base that is registered, in one line; empty if not.

    Two places of one frame are a loop of frames: tf believes now the one and now the other.
    """
    robot = setup.robot
    way = way_to_base(setup, edges)
    if robot is None or robot.registration is None or not way:
        return ""
    return (
        f"robot.base_frame is {robot.base_frame!r}: a name of its own wanted, the tracker measures "
        f"it by {_few(_arrows(way))}"
    )


def _edges_leading(case: Case, tool: str, wanted: tuple[str, ...]) -> tuple[Edge, ...]:
    """What the recording measures, up to where it leads from the tool to all that is wanted."""
    edges: dict[Edge, None] = {}
    for frame in case.recorded_frames():
        new = {(sample.target, sample.source): None for sample in frame.poses}
        if new.keys() <= edges.keys():
            continue
        edges |= new
        known = tuple(edges)
        if all(shortest_path(known, tool, name) is not None for name in wanted):
            break
    return tuple(edges)


def _unnamed(wanted: Mapping[str, str], edges: Iterable[Edge]) -> str:
    """Which frames no edge names: ``tumor.frame is 'needel'``; empty when all are named."""
    names = _names(edges)
    return _places({place: name for place, name in wanted.items() if name not in names})


def _apart(tool: str, wanted: Mapping[str, str], edges: tuple[Edge, ...]) -> str:
    """Which frames no way leads to from ``tool``, in the same words."""
    return _places(
        {place: name for place, name in wanted.items() if shortest_path(edges, tool, name) is None}
    )


def _places(frames: Mapping[str, str]) -> str:
    return " and ".join(f"{place} is {name!r}" for place, name in frames.items())


def _names(edges: Iterable[Edge]) -> list[str]:
    return sorted({name for edge in edges for name in edge})


def _arrows(edges: Iterable[Edge]) -> list[str]:
    return [f"{target} -> {source}" for target, source in edges]


def _shown(edges: Iterable[Edge]) -> str:
    return ", ".join(_arrows(edges))


def _few(words: Sequence[str]) -> str:
    """The first of ``words``, each cut where it is long, and how many more there are."""
    few = [
        word if len(word) <= _MOST_LETTERS else f"{word[:_MOST_LETTERS]}..."
        for word in words[:_MOST_SHOWN]
    ]
    more = len(words) - len(few)
    return ", ".join([*few, *([f"{more} more"] if more else [])])
