"""Paths between frames over edges of either direction, and products of transforms along them."""

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from app.geometry.transform import Transform

Edge = tuple[str, str]
"""Target and source of a transform: (tf parent, tf child)."""

_Node = TypeVar("_Node")


def shortest_path(edges: Iterable[Edge], start: str, goal: str) -> tuple[Edge, ...] | None:
    """Edges from ``start`` to ``goal``, in either direction; None if they are not connected.

    Of several paths with the fewest edges the one whose edges come first.
    """
    paths: dict[str, tuple[Edge, ...]] = {start: ()}
    for known, found, edge in _in_breadth(edges, start):
        paths[found] = (*paths[known], edge)
        if found == goal:
            break
    return paths.get(goal)


def product_along(start: str, path: Iterable[Transform]) -> Transform:
    """The product from ``start`` on, each transform inverted if its edge is walked backwards."""
    product: Transform | None = None
    for edge in path:
        at = start if product is None else product.source
        step = edge if edge.target == at else edge.inverse()
        product = step if product is None else product @ step
    return Transform.identity(start, start) if product is None else product


def poses_in(root: str, edges: Iterable[Transform]) -> dict[str, Transform]:
    """``root_from_frame`` for every frame that ``edges`` connect with ``root``, itself included.

    Uses the path with the fewest edges; of two edges between the same frames the later one.
    """
    latest = {frozenset((edge.target, edge.source)): edge for edge in edges}
    transforms = {(edge.target, edge.source): edge for edge in latest.values()}
    poses = {root: Transform.identity(root, root)}
    for known, found, edge in _in_breadth(transforms, root):
        step = transforms[edge]
        poses[found] = poses[known] @ (step if step.target == known else step.inverse())
    return poses


def chain_to_root(first: _Node, parent_of: Callable[[_Node], _Node | None]) -> list[_Node]:
    """``first``, its parent and so on, up to one that has no parent."""
    chain = [first]
    while (parent := parent_of(chain[-1])) is not None:
        chain.append(parent)
    return chain


def _in_breadth(edges: Iterable[Edge], start: str) -> Iterator[tuple[str, str, Edge]]:
    """Yield each frame that is reached from ``start``: after which other one, and by which edge."""
    of_frame: dict[str, list[tuple[str, Edge]]] = {}
    for edge in edges:
        target, source = edge
        of_frame.setdefault(target, []).append((source, edge))
        of_frame.setdefault(source, []).append((target, edge))
    reached, waiting = {start}, [start]
    for at in waiting:  # grows in the loop
        for beyond, edge in of_frame.get(at, ()):
            if beyond not in reached:
                reached.add(beyond)
                waiting.append(beyond)
                yield at, beyond, edge
