"""The frames that a case names, looked for in its recording before anything is replayed."""

from app.case import Case
from app.geometry import FrameError
from app.session.pose_tree import Edge, shortest_path
from app.session.setup import REFERENCE


def check_frames(case: Case, *, with_tumor: bool = True) -> None:
    """Raise `FrameError` where the recording never leads from the tool to a frame that is needed.

    That is the tumour's, ``with_tumor``, and with a robot the reference. A robot's base that is
    placed without the robot, as the recording measures it, is refused too: the registration would
    place it a second time. Read is up to the frame from which all is known: the first, as a rule,
    and the last where nothing leads there. A live case passes, since its frames are still to come.
    """
    manifest = case.manifest
    tool, robot = manifest.tool.frame, manifest.robot
    wanted = {"tumor.frame": manifest.tumor.frame} if with_tumor else {}
    if robot is not None:
        wanted["the frame of a robot's registration"] = REFERENCE
    if case.recording_path is None or not wanted:
        return
    edges = _edges_leading(case, tool, tuple(wanted.values()))
    names = {name for edge in edges for name in edge}
    for place, name in {"tool.frame": tool, **wanted}.items():
        if name not in names:
            raise FrameError(
                f"{manifest.file}: {place} is {name!r}: no such frame is in the recording, which "
                f"has {', '.join(sorted(names)) or 'none'}"
            )
    for place, name in wanted.items():
        if shortest_path(edges, tool, name) is None:
            raise FrameError(
                f"{manifest.file}: {place} is {name!r}: nothing in the recording leads there from "
                f"tool.frame {tool!r}, it has {_shown(edges)}"
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


def _shown(edges: tuple[Edge, ...]) -> str:
    return ", ".join(f"{target} -> {source}" for target, source in edges)
