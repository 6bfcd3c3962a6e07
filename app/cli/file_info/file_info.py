"""Facts about one file, as text and as JSON."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class FileInfo:
    """The ``kind`` of a file, ``facts`` by name, its ``uses``, and what is ``missing`` for them.

    ``uses`` are commands or keys of a ``case.yaml``; ``missing`` says what else they need.
    """

    path: str
    kind: str
    facts: Mapping[str, str]
    uses: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Values that JSON can hold."""
        return asdict(self)

    def as_text(self) -> str:
        """Lines of text."""
        lines = [self.path, f"  {'is':<14} {self.kind}"]
        lines += [f"  {name:<14} {value}" for name, value in self.facts.items()]
        for title, entries in (
            ("can be used", self.uses),
            ("missing", self.missing),
            ("note", self.notes),
        ):
            lines += [f"  {title:<14} {entry}" for entry in entries]
        return "\n".join(lines)
