"""Moving edges of ``/tf``, each with the stamp of its sample."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from app.fixture import MarginState
from app.geometry import FrameError, Stamp, Transform, chain_to_root
from app.session import StepResult


@dataclass(frozen=True, slots=True)
class PublishPolicy:
    """Shared topics that this node publishes: those that other nodes may publish, too.

    A replay is alone on the graph and publishes all of them. ``clock``: the session's time is the
    time of the graph; ``measured``: the tracker's edges; ``robot``: its description, joints and
    links.
    """

    clock: bool = True
    measured: bool = True
    robot: bool = True


PUBLISH_ALL = PublishPolicy()


def moving_edges(
    step: StepResult, policy: PublishPolicy = PUBLISH_ALL
) -> Iterator[tuple[Transform, Stamp]]:
    """Yield every transform of ``step`` with the time at which it was measured.

    Measured edges are published as measured. Lost ones are left out: tf cannot represent a lost
    pose, so its absence and ``/diagnostics`` report it. The links of the robot are all children of
    its root, so that no joint is needed to place them. The fixture has the stamp of the oldest
    sample that went in; while the margin is UNKNOWN the last plane still holds, but nothing newer
    is known.
    """
    for sample in step.frame.poses if policy.measured else ():
        if sample.transform is not None:
            yield sample.transform, sample.stamp
    if step.joints is not None and policy.robot:
        for link, root_from_link in step.links.items():
            if link != root_from_link.target:
                yield root_from_link, step.joints.stamp
    decision = step.decision
    if (
        decision.state is not MarginState.UNKNOWN
        and decision.stamp is not None
        and step.virtual_fixture is not None
    ):
        yield step.virtual_fixture, decision.stamp


class FrameTree:
    """Selects the edges of each step that tf can hold, and each sample once.

    A tracker may report more edges than a tree holds (``StylusToTracker`` beside
    ``StylusToReference``), but in tf a frame has one parent and there are no loops: the edge that
    came first stays, the calibrations of ``static_edges`` before all. tf2 also complains about a
    transform that is published again with its stamp, as for a joint sample when the tracker is
    faster than the robot. When the player seeks back, all samples are new again. Raises
    `FrameError` for static edges that form no tree by themselves.
    """

    def __init__(
        self, static_edges: Iterable[Transform] = (), policy: PublishPolicy = PUBLISH_ALL
    ) -> None:
        self._policy = policy
        self._parents: dict[str, str] = {}
        self._static: frozenset[str] = frozenset()
        self._newest_ns: dict[str, int] = {}
        self._now_ns: int | None = None
        self.left_out: dict[tuple[str, str], str] = {}
        """Edges (parent, child) that do not fit into the tree, with the reason."""
        for edge in static_edges:
            if not self._fits(edge):
                raise FrameError(
                    f"static transforms: {self.left_out[edge.target, edge.source]}; expected a tree"
                )
        self._static = frozenset(self._parents)

    def new_edges(self, step: StepResult) -> list[tuple[Transform, Stamp]]:
        """Moving edges of ``step`` that are newer than the last ones of the same child frame."""
        if self._now_ns is not None and step.frame.stamp.ns < self._now_ns:
            self._newest_ns.clear()
        self._now_ns = step.frame.stamp.ns
        found = []
        for transform, stamp in moving_edges(step, self._policy):
            newest_ns = self._newest_ns.get(transform.source)
            if self._fits(transform) and (newest_ns is None or stamp.ns > newest_ns):
                self._newest_ns[transform.source] = stamp.ns
                found.append((transform, stamp))
        return found

    def _fits(self, edge: Transform) -> bool:
        parent, child = edge.target, edge.source
        known = self._parents.get(child)
        if known == parent and child not in self._static:
            return True
        if known is not None:
            self.left_out[parent, child] = f"{child!r} already has the parent {known!r}"
            return False
        if child in chain_to_root(parent, self._parents.get):
            self.left_out[parent, child] = (
                f"{parent!r} is below {child!r}; the edge would close a loop"
            )
            return False
        self._parents[child] = parent
        return True
