"""Where the links of a robot are, link by link."""

from collections.abc import Iterator, Mapping

from app.geometry import FloatArray, Transform


class LinkPoses(Mapping[str, Transform]):
    """``root_from_link`` for every link, each made when it is asked for.

    A robot is placed at every step of a session, which asks for one link of it.
    """

    __slots__ = ("_places_mm", "_root", "_rotations", "_rows")

    def __init__(
        self, root: str, rows: Mapping[str, int], rotations: FloatArray, places_mm: FloatArray
    ) -> None:
        """New arrays (n, 3, 3), of rotations by construction, and (n, 3) are taken over.

        ``rows`` tells which of them are a link's.
        """
        self._root = root
        self._rows = rows
        self._rotations = rotations
        self._places_mm = places_mm

    def __getitem__(self, link: str) -> Transform:
        row = self._rows[link]
        return Transform.by_construction(
            self._root, link, self._rotations[row], self._places_mm[row]
        )

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)
