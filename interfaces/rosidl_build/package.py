"""A ROS interface package: its name, its interface files, and the packages that it may refer to."""

from dataclasses import dataclass
from pathlib import Path

KINDS = ("msg", "srv", "action")


@dataclass(frozen=True, slots=True)
class InterfacePackage:
    """The folders ``msg``, ``srv`` and ``action`` of a package named like its ``folder``.

    ``interface_files`` are relative to ``folder``.
    """

    name: str
    folder: Path
    interface_files: tuple[Path, ...]

    @classmethod
    def read(cls, folder: Path) -> "InterfacePackage":
        """Read the package in ``folder``; ValueError when it holds no interface file."""
        files = tuple(
            file.relative_to(folder)
            for kind in KINDS
            for file in sorted((folder / kind).glob(f"*.{kind}"))
        )
        if not files:
            raise ValueError(f"{folder}: no .msg, .srv or .action file in {', '.join(KINDS)}")
        return cls(folder.name, folder, files)

    def others_in(self, root: Path) -> list[str]:
        """The interface packages installed under the prefix ``root``, this one left out.

        All of them count as dependencies: the ones that a type really rests on are found by the
        generators, the ones that a library rests on by the linker (``--as-needed``).
        """
        index = root / "share" / "ament_index" / "resource_index" / "rosidl_interfaces"
        return sorted(marker.name for marker in index.iterdir() if marker.name != self.name)
