"""The part of the page on which operators calibrate the tool: one calibration, which all show."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from aiohttp import web

from app.files import write_transform
from app.geometry import Transform
from app.runtime import (
    CalibrationFit,
    Compute,
    SessionContent,
    ToolCalibration,
    TrackedTool,
    UseTip,
    fit_calibration,
)
from app.runtime.workflow.guided_fits import GuidedFits
from app.viewer.access.auth import ROLE
from app.viewer.access.role import Role
from app.viewer.readout.calibration import calibration_map, calibration_values

TIP_FILE, STYLUS_FILE = "tip.yaml", "stylus.yaml"


class CalibrationPart:
    """Fits the poses of ``guide`` while they are recorded. The page's thread owns it.

    ``use`` replaces the tip of the session.
    """

    def __init__(
        self,
        guide: ToolCalibration,
        compute: Compute,
        on_computed: Callable[[], None],
        use: UseTip,
    ) -> None:
        self.guide = guide
        self.use = use
        self._fits = GuidedFits(guide, fit_calibration, compute, on_computed)
        self._map: tuple[CalibrationFit | None, dict[str, Any] | None] = None, None

    @property
    def revision(self) -> object:
        """A value that changes when the page needs an update without a new step."""
        return self.guide.status().revision, self._fits.is_done

    def update(self, content: SessionContent) -> None:
        """Use the session's present tip, take a fit that is done, and begin the next one."""
        self.guide.use_content(content)
        self._fits.follow()

    def values(self) -> dict[str, Any]:
        """The values of the page that belong to the last `update`."""
        status = self.guide.status()
        if self._map[0] is not status.fit:
            made = None if status.fit is None else calibration_map(status.fit.coverage, status.kind)
            self._map = status.fit, made
        return {
            "calibration": calibration_values(status, can_undo=self.guide.can_undo),
            "calibration_map": self._map[1],
        }

    async def file(self, request: web.Request) -> web.Response:
        """The tip of a tool that the session uses, as YAML for a ``tip_from`` of ``live.yaml``.

        ``tip.yaml`` is that of the guarded tool, ``stylus.yaml`` that of the stylus; 409 without.
        """
        if not request[ROLE].may(Role.OPERATE):
            raise web.HTTPForbidden
        name = request.path.rpartition("/")[2]
        tool = TrackedTool.STYLUS if name == STYLUS_FILE else TrackedTool.CAUTERY
        change = self.guide.in_use(tool)
        if change is None:
            text = "stylus: it has no calibrated tip; expected one to save"
            return web.Response(status=409, text=text)
        loop = asyncio.get_running_loop()
        content = await loop.run_in_executor(
            None, _file_content, change.tool_from_tip, f"sigma {change.sigma_mm:.3f} mm"
        )
        return web.Response(
            body=content,
            content_type="application/yaml",
            headers={"Content-Disposition": f'attachment; filename="{name}"'},
        )

    def close(self) -> None:
        """End the thread."""
        self._fits.close()


def _file_content(tool_from_tip: Transform, note: str) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "tip.yaml"
        write_transform(path, tool_from_tip, note)
        return path.read_bytes()
