"""Where the links of a robot are, link by link."""

from collections.abc import Iterator, Mapping

from app.geometry import FloatArray, Transform


class LinkPoses(Mapping[str, Transform]):
    """``root_from_link`` for every link, each made when it is asked for.

    A robot is placed at every step of a session, which asks for one link of it.
    """

    __slots__ = ("_matrices", "_root", "_rows")

    def __init__(self, root: str, rows: Mapping[str, int], matrices: FloatArray) -> None:
        """A new array (n, 4, 4) of poses by construction, in mm, is taken over.

        ``rows`` tells which of them is a link's.
        """
        self._root = root
        self._rows = rows
        self._matrices = matrices

    def __getitem__(self, link: str) -> Transform:
        matrix = self._matrices[self._rows[link]]
        return Transform.unchecked(self._root, link, matrix[:3, :3], matrix[:3, 3])

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)
