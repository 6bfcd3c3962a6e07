"""The part of the page on which operators calibrate tools and register the robot."""

import math
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from aiohttp import web

from app.files import write_transform
from app.geometry import InputError
from app.runtime import GUARDED_TOOL, tool_names
from app.viewer.downloads import Write, operators_file
from app.viewer.messages.checks import Check, Commands, RefusedError, integer, one_of, text
from app.workflow import (
    CalibrationFit,
    CalibrationKind,
    Coverage,
    Workflow,
    calibration_shown,
    registration_shown,
)

_RADIUS = 50.0
_MAX_POINTS = 120


def calibration_map(coverage: Coverage) -> dict[str, Any]:
    """Points and sectors of a plot with +y upwards, 50 units to each side."""
    points = coverage.points_deg[:: max(1, -(-len(coverage.points_deg) // _MAX_POINTS))]
    count = len(coverage.sectors)
    return {
        "points": [
            [round(min(max(x, -_RADIUS), _RADIUS), 1), round(-min(max(y, -_RADIUS), _RADIUS), 1)]
            for x, y in points.tolist()
        ],
        "sectors": [
            {"d": _sector_path(number, count), "covered": is_covered}
            for number, is_covered in enumerate(coverage.sectors)
        ],
    }


def _sector_path(number: int, count: int) -> str:
    ends = [2.0 * math.pi * each / count for each in (number, number + 1)]
    (x0, y0), (x1, y1) = ((_RADIUS * math.cos(a), -_RADIUS * math.sin(a)) for a in ends)
    return f"M0 0L{x0:.2f} {y0:.2f}A{_RADIUS:g} {_RADIUS:g} 0 0 0 {x1:.2f} {y1:.2f}Z"


TIP_FILES = {"tip.yaml" if each == GUARDED_TOOL else f"{each}.yaml": each for each in tool_names()}
"""Name of the file with a tip, and its tool."""
_MAX_DIGITS = 20
_seen_revision = integer(0, 2**53 - 1)


class GuidedPart:
    """The guided recordings of ``workflow``, which all pages share. The page's thread owns it."""

    def __init__(self, workflow: Workflow) -> None:
        self.workflow = workflow
        self._map: tuple[CalibrationFit | None, dict[str, Any] | None] = None, None

    def values(self) -> dict[str, Any]:
        """The values of the page that belong to the last update of ``workflow``."""
        calibration, registration = self.workflow.calibration, self.workflow.registration
        status = calibration.status()
        if self._map[0] is not status.fit:
            made = None if status.fit is None else calibration_map(status.fit.coverage)
            self._map = status.fit, made
        robot = (
            {}
            if registration is None
            else {"registration": asdict(registration_shown(registration))}
        )
        return {
            "calibration": asdict(calibration_shown(calibration)),
            "calibration_map": self._map[1],
            **robot,
        }

    async def file(self, request: web.Request) -> web.Response:
        """The tip of a tool that the session uses, as YAML for a ``tip_from`` of ``live.yaml``.

        ``tip.yaml`` is that of the guarded tool, others are those of pointers; 409 without one.
        """

        def tip() -> Write:
            tool = TIP_FILES[request.path.rpartition("/")[2]]
            change = self.workflow.calibration.in_use(tool)
            if change is None:
                raise InputError(f"{tool}: it has no calibrated tip; expected one to save")
            note = f"sigma {change.sigma_mm:.3f} mm"
            return lambda path: write_transform(path, change.tool_from_tip, note)

        return await operators_file(request, "application/yaml", tip)


def add_guided_controls(commands: Commands, workflow: Workflow) -> None:
    """Commands of both recordings, ``calibration_start`` to ``registration_undo``.

    Each names the revision that the page has seen, and raises `InputError` where it cannot be done,
    also because another page has changed the recording: the page that asked shows why.
    """
    calibration, registration = workflow.calibration, workflow.registration

    def add(name: str, change: Callable[..., None], *checks: Check) -> None:
        commands.add(name, change, _seen_revision, *checks)

    def calibrate(seen: int, kind: str, tool: str) -> None:
        calibration.start(seen, CalibrationKind(kind), tool)

    tool = one_of(tool_names())
    add("calibration_start", calibrate, one_of([each.value for each in CalibrationKind]), tool)
    for name, guide in (("calibration", calibration), ("registration", registration)):
        if guide is not None:
            add(f"{name}_stop", guide.stop)
            add(f"{name}_discard", guide.discard)
            add(f"{name}_use", guide.accept)
            add(f"{name}_undo", guide.undo)
    if registration is None:
        return

    def remove(seen: int, point: str) -> None:
        if not (point.isascii() and point.isdecimal()):
            raise RefusedError("point: not one of the registration; expected its decimal number")
        registration.remove(seen, int(point))

    add("registration_start", registration.start, tool)
    add("registration_remove", remove, text(_MAX_DIGITS))
    add("registration_restore", registration.restore)
