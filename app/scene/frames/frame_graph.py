"""From measured edges in any direction to the pose of every frame in one."""

from collections import deque
from collections.abc import Iterable

from app.geometry import Transform


def poses_in(root: str, edges: Iterable[Transform]) -> dict[str, Transform]:
    """``root_from_frame`` for every frame that ``edges`` connect with ``root``, itself included.

    The way with the fewest edges is taken; of two edges between the same frames the later one.
    """
    neighbours: dict[str, dict[str, Transform]] = {}
    for edge in edges:
        neighbours.setdefault(edge.target, {})[edge.source] = edge
        neighbours.setdefault(edge.source, {})[edge.target] = edge.inverse()
    poses = {root: Transform.identity(root, root)}
    queue = deque([root])
    while queue:
        at = queue.popleft()
        for beyond, step in neighbours.get(at, {}).items():
            if beyond not in poses:
                poses[beyond] = poses[at] @ step
                queue.append(beyond)
    return poses
