"""Build step of the wheel: copies the folders that MarginGuard ships into ``app/share``.

`app.files.paths` finds them there. They are no packages of ``pyproject.toml``, because that would
install ``benchmarks`` and ``examples`` as top-level packages. This is a build step of setuptools
and not a ``setup.py``, which colcon would take for a Python package and not search the folders
below it for message packages.
"""

import shutil
from pathlib import Path

from setuptools.command.build_py import build_py

SHIPPED = ("benchmarks", "data", "examples", "foxglove", "launch", "rviz", "slicer_module")
"""Folders of the root; each must exist."""

SHARE = Path("app") / "share"
GENERATED = ("__pycache__", "*.py[cod]", ".*")


class BuildWithShippedFiles(build_py):
    """``build_py`` that starts from an empty folder and adds `SHIPPED`.

    An editable installation uses the folders of the checkout, so nothing is copied.
    """

    def run(self) -> None:
        """Build the packages, then copy the shipped folders."""
        if self.editable_mode:
            super().run()
            return
        build = Path(self.build_lib)
        # setuptools keeps files of earlier builds, which may have been removed or renamed.
        shutil.rmtree(build, ignore_errors=True)
        super().run()
        for name in SHIPPED:
            shutil.copytree(name, build / SHARE / name, ignore=shutil.ignore_patterns(*GENERATED))
