"""Poses of all frames in a root frame, from measured edges in any direction."""

from collections import deque
from collections.abc import Iterable

from app.geometry import Transform


def poses_in(root: str, edges: Iterable[Transform]) -> dict[str, Transform]:
    """``root_from_frame`` for every frame that ``edges`` connect with ``root``, itself included.

    Uses the path with the fewest edges; of two edges between the same frames the later one.
    """
    neighbours: dict[str, dict[str, Transform]] = {}
    for edge in edges:
        neighbours.setdefault(edge.target, {})[edge.source] = edge
        neighbours.setdefault(edge.source, {})[edge.target] = edge.inverse()
    poses = {root: Transform.identity(root, root)}
    queue = deque([root])
    while queue:
        frame = queue.popleft()
        for neighbour, edge in neighbours.get(frame, {}).items():
            if neighbour not in poses:
                poses[neighbour] = poses[frame] @ edge
                queue.append(neighbour)
    return poses
