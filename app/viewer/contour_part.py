"""The part of the page on which operators contour a tumour: one contour, which all pages edit."""

import asyncio
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from aiohttp import web

from app.contour import Contour, ContourEditor, ContourSurface, contour_surface
from app.contour.uncertainty import pixel_sigma
from app.files.meshes import write_mesh
from app.geometry import FloatArray, MarginGuardError, SurfaceMesh, Transform
from app.runtime import Compute, SessionContent, SetTumor
from app.scene import ContourModel, MarginGuardScene
from app.viewer.access.auth import ROLE
from app.viewer.access.role import Role
from app.viewer.drawing.scene_view import SceneView
from app.viewer.log import log
from app.viewer.messages.errors import NotDoneError
from app.viewer.readout.contour import contour_values
from app.viewer.readout.ultrasound import svg_path
from app.viewer.steps.contour_places import ContourPlaces, frame_from_tumor
from app.viewer.steps.plane_lines import SurfaceCuts, pixels_from_root
from app.viewer.steps.view_state import ViewState

UseTumor = Callable[[SetTumor], bool]
"""Begins to replace the tumour; False while that is not possible."""


class ContourPart:
    """Edits one contour and computes its surface after each change. The page's thread owns it.

    ``compute`` calls the computation in a thread of this part, ``on_computed`` is called from that
    thread. ``use`` replaces the tumour of a live session; None in a replay.
    """

    def __init__(
        self,
        content: SessionContent,
        compute: Compute,
        on_computed: Callable[[], None],
        use: UseTumor | None = None,
    ) -> None:
        self.places = ContourPlaces(content)
        self.editor = ContourEditor(self.places.frame)
        self._content = content
        self._compute = compute
        self._on_computed = on_computed
        self._use = use
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="contour")
        self._computing: tuple[int, Future[ContourSurface]] | None = None
        self._computed = 0
        self._surface: ContourSurface | None = None
        self._problem = ""
        self._cuts = SurfaceCuts()
        self._model: ContourModel | None = None
        self._scene: MarginGuardScene | None = None
        self._drawn: ContourSurface | None = None

    @property
    def revision(self) -> object:
        """A value that changes when the page needs an update without a new step."""
        return self.editor.revision, self._computed, self._is_done()

    def update(
        self,
        shown: ViewState | None,
        view: SceneView,
        number: int | None = None,
        matrix: FloatArray | None = None,
    ) -> None:
        """Show the contour with the moment ``shown`` and the present image, if there is one."""
        if shown is not None:
            self._content = shown.content
        self.places.show(shown, number, matrix)
        self._follow()
        self._draw(view.scene)

    def values(self) -> dict[str, Any]:
        """The values of the page that belong to the last `update`."""
        editor, places = self.editor, self.places
        is_computed = self._computed == editor.revision
        cut, matrix = "", None if places.number is None else places.matrix(places.number)
        if self._surface is not None and matrix is not None:
            cut = svg_path(self._cuts.cut(self._surface.mesh, pixels_from_root(matrix)))
        return {
            "contour": {
                **contour_values(
                    editor.contour, self._surface, self._problem, is_computed=is_computed
                ),
                "revision": editor.revision,
                "undo": editor.can_undo,
                "tip": places.has_tip,
                "image": places.number,
                "cut": cut,
            }
        }

    def accept(self) -> None:
        """Begin to use the contour as the tumour of the session. Raises `NotDoneError`."""
        if self._use is None:
            raise NotDoneError("contour: this is a replay; expected a live session")
        edge = frame_from_tumor(self._content)
        mesh, sigma_mm = self._finished(edge)
        if not self._use(SetTumor(edge, mesh, sigma_mm)):
            raise NotDoneError(
                "contour: the session is not ready for another tumour; expected the same request "
                "later"
            )

    async def file(self, request: web.Request) -> web.Response:
        """The surface of the revision that is asked for, as STL or PLY; 409 says why not."""
        if not request[ROLE].may(Role.OPERATE):
            raise web.HTTPForbidden
        name = request.path.rpartition("/")[2]
        try:
            if request.query.get("revision") != str(self.editor.revision):
                raise NotDoneError(
                    "contour: it has changed meanwhile, and nothing was saved; expected the same "
                    "request again"
                )
            mesh, _ = self._finished(frame_from_tumor(self._content))
        except NotDoneError as error:
            return web.Response(status=409, text=str(error))
        loop = asyncio.get_running_loop()
        content = await loop.run_in_executor(None, _file_content, name, mesh)
        disposition = f'attachment; filename="{name}"'
        return web.Response(
            body=content,
            content_type="application/octet-stream",
            headers={"Content-Disposition": disposition},
        )

    def close(self) -> None:
        """End the thread."""
        self._worker.shutdown(wait=False, cancel_futures=True)

    def _finished(self, edge: Transform) -> tuple[SurfaceMesh, float]:
        """The present surface in the tumour's frame, and its uncertainty in mm."""
        if self._computed != self.editor.revision:
            raise NotDoneError(
                "contour: its surface is being computed; expected the same request in a moment"
            )
        if self._surface is None:
            raise NotDoneError(self._problem or "contour: no points; expected 4 or more")
        if self._surface.uncertainty is None:
            raise NotDoneError(
                "contour: the error of its points is not stated; expected that of the calibration "
                "of the probe, or of the tool's tip, in mm"
            )
        mesh = self._surface.mesh.transformed(edge.inverse())
        return mesh, self._surface.uncertainty.sigma_mm

    def _is_done(self) -> bool:
        return self._computing is not None and self._computing[1].done()

    def _follow(self) -> None:
        """Take a surface that has been computed, and begin to compute that of a newer contour."""
        if self._computing is not None and self._is_done():
            self._computed, done = self._computing
            self._computing = None
            try:
                self._surface, self._problem = done.result(), ""
            except MarginGuardError as error:
                self._surface, self._problem = None, str(error)
            except Exception:
                # Without a surface the page goes on: it shows the session.
                log.exception("contour of %d points", len(self.editor.contour.points))
                self._surface = None
                self._problem = "contour: no surface was found; expected other points"
        if self._computing is None and self._computed != self.editor.revision:
            contour = self.editor.contour
            future = self._worker.submit(
                self._compute, contour_surface, contour, self._pixel_sigma(contour)
            )
            self._computing = self.editor.revision, future
            future.add_done_callback(lambda _: self._on_computed())

    def _pixel_sigma(self, contour: Contour) -> float:
        """The largest standard deviation of a click in the images of ``contour``."""
        sizes = [
            np.linalg.norm(matrix[:3, :2], axis=0)
            for image in contour.images
            if (matrix := self.places.matrix(image)) is not None
        ]
        return max((pixel_sigma((float(w), float(h))) for w, h in sizes), default=0.0)

    def _draw(self, scene: MarginGuardScene | None) -> None:
        """Draw the surface in ``scene``."""
        if scene is not self._scene:
            if self._model is not None:
                self._model.remove()
            self._scene, self._model, self._drawn = scene, None, None
        if scene is None or (self._model is None and self._surface is None):
            return
        if self._model is None:
            parent = scene.tree.node(self.places.frame)
            if parent is None:
                return
            self._model = ContourModel(scene.scene, parent)
        if self._surface is self._drawn:
            return
        self._drawn = self._surface
        if self._surface is None:
            self._model.hide()
        else:
            self._model.show(self._surface.mesh)


def _file_content(name: str, mesh: SurfaceMesh) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        write_mesh(path, mesh)
        return path.read_bytes()
