"""Fixtures for Slicer's module MarginGuard: its folder on the path, doubles of desktop Slicer."""

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

from app.runtime import PreparedCase, prepare_case, recorded_breaches  # noqa: E402
from app.scene import SceneApplication  # noqa: E402
from MarginGuardLib.recorded import RecordedCase  # noqa: E402

MAX_SPINS = 6000
"""20 ms each: a first run compiles for a minute."""


@pytest.fixture
def application() -> SceneApplication:
    """Scene with the part of Slicer's application that markups need."""
    return SceneApplication(slicer.vtkMRMLScene())


@functools.cache
def opened_case() -> PreparedCase:
    """The recorded case, opened once because it does not change."""
    return prepare_case(CASE)


@functools.cache
def recorded_case() -> RecordedCase:
    """The recorded case as the panel opens it, stepped through once."""
    return RecordedCase(opened_case(), recorded_breaches(opened_case()))


@functools.cache
def frame_times_s() -> list[float]:
    """Times of the case's frames in s from the first one, those of silences included."""
    opened = opened_case()
    return [(frame.stamp.ns - opened.extent.first_ns) / 1e9 for frame in opened.case.frames()]


def spin_until(panel_logic: Any, is_expected: Callable[[Any], bool]) -> Any:
    """Spin the logic until ``is_expected(status)`` is true; return that status."""
    for _ in range(MAX_SPINS):
        status = panel_logic.spin(0.02)
        if is_expected(status):
            return status
    raise AssertionError(f"status {status}; expected another one within the spins")


@pytest.fixture(scope="module")
def desktop() -> Iterator[ModuleType]:
    """The module's file, loaded with TEST DOUBLES for what only desktop Slicer has."""
    with desktop_slicer():
        import MarginGuard

        yield MarginGuard
    for name in ("MarginGuard", "MarginGuardLib.settings"):
        sys.modules.pop(name, None)
