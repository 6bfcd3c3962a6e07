"""Poses of the links of a robot, converted to `Transform` on access."""

from collections.abc import Iterator, Mapping

import numpy as np

from app.geometry import FloatArray, Transform


class LinkPoses(Mapping[str, Transform]):
    """``root_from_link`` by link, each converted when it is accessed.

    A session computes all links at every step and reads one of them.
    """

    __slots__ = ("_matrices", "_root", "_rows")

    def __init__(self, root: str, rows: Mapping[str, int], matrices: FloatArray) -> None:
        """Take over ``matrices`` (n, 4, 4): rigid, in mm, not copied and not checked.

        ``rows`` maps a link to its index in ``matrices``.
        """
        self._root = root
        self._rows = rows
        self._matrices = matrices

    @classmethod
    def of(cls, links: Mapping[str, Transform]) -> "LinkPoses":
        """``links`` as they are, or with their matrices; there is at least one."""
        if isinstance(links, LinkPoses):
            return links
        matrices = np.array([each.matrix for each in links.values()])
        root = next(iter(links.values())).target
        return cls(root, {name: number for number, name in enumerate(links)}, matrices)

    @property
    def root(self) -> str:
        """The link that the poses are in."""
        return self._root

    @property
    def matrices(self) -> FloatArray:
        """Matrices (n, 4, 4) in the order of the names."""
        rows: FloatArray = self._matrices[list(self._rows.values())]
        return rows

    def __getitem__(self, link: str) -> Transform:
        matrix = self._matrices[self._rows[link]]
        return Transform.unchecked(self._root, link, matrix[:3, :3], matrix[:3, 3])

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)
