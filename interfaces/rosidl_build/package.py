"""ROS interface package: name, interface files, and packages that it may refer to."""

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
        """Read the package in ``folder``; raises ValueError if it has no interface file."""
        files = tuple(
            file.relative_to(folder)
            for kind in KINDS
            for file in sorted((folder / kind).glob(f"*.{kind}"))
        )
        if not files:
            raise ValueError(f"{folder}: no .msg, .srv or .action file in {', '.join(KINDS)}")
        return cls(folder.name, folder, files)

    def others_in(self, root: Path) -> list[str]:
        """Other interface packages installed under the prefix ``root``.

        All of them are passed as dependencies. The generators select the ones that a type needs,
        and the linker (``--as-needed``) the ones that a library needs.
        """
        index = root / "share" / "ament_index" / "resource_index" / "rosidl_interfaces"
        return sorted(marker.name for marker in index.iterdir() if marker.name != self.name)
