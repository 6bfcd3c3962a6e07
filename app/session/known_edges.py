"""Edges that a session knows at one step, for uses of the step that need other frames."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

from app.case import JointSample
from app.geometry import (
    Edge,
    FrameError,
    Stamp,
    TrackedTransform,
    Transform,
    product_along,
    shortest_path,
)
from app.robot import Robot
from app.session.setup import RobotSetup


@dataclass(frozen=True, slots=True, eq=False)
class KnownEdges:
    """Static edges, measured edges and links of the robot, as the step used them.

    ``measured`` holds the latest sample of each edge, None if it may not be used at this step
    (lost, stale, frozen, from the future). ``links`` holds ``root_from_link`` from joints of
    ``links_stamp``, empty if they are not known; ``link_names`` names them in any case. The frame
    ``base`` is the root link ``root``.
    """

    static: tuple[Transform, ...] = ()
    measured: Mapping[Edge, TrackedTransform | None] = field(default_factory=dict)
    links: Mapping[str, Transform] = field(default_factory=dict)
    links_stamp: Stamp | None = None
    link_names: frozenset[str] = frozenset()
    base: str = ""
    root: str = ""

    def frames(self) -> frozenset[str]:
        """Names of all frames of these edges, also of those that may not be used now."""
        static = {name for edge in self.static for name in (edge.target, edge.source)}
        measured = {name for edge in self.measured for name in edge}
        robot = {self.base, self.root, *self.link_names} - {""}
        return frozenset(static | measured | robot)

    def between(self, target: str, source: str) -> tuple[Transform, Stamp | None]:
        """``target_from_source`` and the stamp of its oldest sample, None for static edges alone.

        Raises `FrameError` if they are not connected, or by an edge that may not be used.
        """
        edges: dict[Edge, tuple[Transform, Stamp | None] | None] = {}
        for edge, sample in self.measured.items():
            pose = None if sample is None else sample.transform
            edges[edge] = None if sample is None or pose is None else (pose, sample.stamp)
        edges |= {(edge.target, edge.source): (edge, None) for edge in self.static}
        for name in self.link_names - {self.root}:
            link = self.links.get(name)
            edges[self.root, name] = None if link is None else (link, self.links_stamp)
        if self.base != self.root:
            identity = Transform.identity(self.base, self.root)
            edges[self.base, self.root] = (identity, None)
        path = shortest_path(edges, target, source)
        if path is None:
            raise FrameError(f"{source!r} is not connected with {target!r} in the session")
        transforms, stamps = [], []
        for edge in path:
            known = edges[edge]
            if known is None:
                raise FrameError(f"{edge[1]!r} in {edge[0]!r} is not known now")
            transforms.append(known[0])
            stamps.append(known[1])
        oldest = min((stamp for stamp in stamps if stamp is not None), default=None)
        return product_along(target, transforms), oldest


NO_EDGES = KnownEdges()
"""Edges of a step whose frames are not known."""


def known_edges(
    static: tuple[Transform, ...],
    robot: RobotSetup | None,
    measured: Mapping[Edge, TrackedTransform | None],
    links: Mapping[str, Transform],
    joints: JointSample | None,
) -> KnownEdges:
    """The edges of a step with ``links`` of ``robot`` from the latest ``joints``.

    Links that follow the tool by inverse kinematics are a picture and not a measurement: they are
    not known.
    """
    if robot is None:
        return KnownEdges(static, measured)
    if robot.follows_tool:
        base = robot.base_frame
        return KnownEdges(static, measured, base=base, root=base)
    return KnownEdges(
        static,
        measured,
        links,
        None if joints is None else joints.stamp,
        _link_names(robot.robot),
        robot.base_frame,
        robot.robot.root_link,
    )


@lru_cache(maxsize=4)  # called in every step of a session, which has one robot
def _link_names(robot: Robot) -> frozenset[str]:
    return frozenset(link.name for link in robot.links)
