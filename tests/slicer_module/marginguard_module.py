"""Slicer's module MarginGuard in a test: its folder on the path, and desktop Slicer's stand-ins."""

import functools
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import slicer

from tests.slicer_module.desktop import desktop_slicer

FOLDER = Path(__file__).resolve().parents[2] / "slicer_module" / "MarginGuard"
UI = FOLDER / "Resources" / "UI" / "MarginGuard.ui"
CASE = Path(__file__).resolve().parents[2] / "data" / "recorded_case"

if str(FOLDER) not in sys.path:
    sys.path.insert(0, str(FOLDER))  # as Slicer does with --additional-module-paths

from app.runtime import PreparedCase, prepare_case  # noqa: E402
from app.scene import SceneApplication  # noqa: E402

PATIENCE_SPINS = 6000
"""Of 20 ms each: a first run compiles for a minute."""


@pytest.fixture
def application() -> SceneApplication:
    """The scene with what markups need of Slicer's application."""
    return SceneApplication(slicer.vtkMRMLScene())


@functools.cache
def opened_case() -> PreparedCase:
    """The recorded case, opened once; nothing in it changes."""
    return prepare_case(CASE)


def spin_until(guard: Any, wanted: Callable[[Any], bool]) -> Any:
    """Spin the logic, which waits for its steps, until a status is wanted."""
    for _ in range(PATIENCE_SPINS):
        status = guard.spin(0.02)
        if wanted(status):
            return status
    raise AssertionError(f"in vain: {status}")


@pytest.fixture(scope="module")
def desktop() -> Iterator[ModuleType]:
    """The module's file, loaded with TEST DOUBLES for what only desktop Slicer has."""
    with desktop_slicer():
        import MarginGuard

        yield MarginGuard
    for name in ("MarginGuard", "MarginGuardLib.settings"):
        sys.modules.pop(name, None)
