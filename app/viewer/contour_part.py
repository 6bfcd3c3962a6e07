"""The part of the page on which operators contour a tumour: one contour, which all pages edit."""

from collections.abc import Callable
from typing import Any

import numpy as np
from aiohttp import web

from app.contour import Contour, ContourEditor, ContourSurface, contour_count
from app.contour.surface import pixel_sigma
from app.files.meshes import write_mesh
from app.geometry import FloatArray, InputError
from app.runtime import SessionContent, compute_here
from app.scene import ContourModel, MarginGuardScene
from app.viewer.downloads import Write, operators_file
from app.viewer.drawing.scene_view import SceneView
from app.viewer.readout.ultrasound import svg_path
from app.viewer.steps.contour_places import ContourPlaces
from app.viewer.steps.plane_lines import SurfaceCuts, pixels_from_root
from app.viewer.steps.view_state import ViewState
from app.workflow import ContourTumor, DisplayOperator


class ContourPart:
    """Edits one contour and computes its surface after each change. The page's thread owns it.

    ``operator`` is that of a live session, whose tumour the contour replaces; None in a replay.
    ``changed()`` is called in any thread when there is something to show.
    """

    def __init__(
        self,
        content: SessionContent,
        changed: Callable[[], None],
        operator: DisplayOperator | None = None,
    ) -> None:
        self.places = ContourPlaces(content)
        self.editor = ContourEditor(self.places.frame)
        self._content = content
        self._operator = operator
        self._tumor = ContourTumor(compute_here if operator is None else operator.compute, changed)
        self._cuts = SurfaceCuts()
        self._model: ContourModel | None = None
        self._scene: MarginGuardScene | None = None
        self._drawn: ContourSurface | None = None

    @property
    def revision(self) -> object:
        """A value that changes when the page needs an update without a new step."""
        return self.editor.revision, self._tumor.revision

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
        self._tumor.follow(self.editor.contour, self._pixel_sigma)
        self._draw(view.scene)

    def values(self) -> dict[str, Any]:
        """The values of the page that belong to the last `update`.

        Points are in pixels, from 0 at the outer edge of the first pixel.
        """
        editor, places, tumor = self.editor, self.places, self._tumor
        contour, surface = editor.contour, tumor.surface
        size, sigma, problem = tumor.texts()
        uncertainty = None if surface is None else surface.uncertainty
        cut, matrix = "", None if places.number is None else places.matrix(places.number)
        if surface is not None and matrix is not None:
            cut = svg_path(self._cuts.cut(surface.mesh, pixels_from_root(matrix)))
        points = [
            {
                "n": each.number,
                "image": each.image,
                "x": round(each.pixel[0] + 0.5, 2),
                "y": round(each.pixel[1] + 0.5, 2),
            }
            for each in contour.points
            if each.pixel is not None
        ]
        return {
            "contour": {
                "points": points,
                "count": contour_count(contour),
                "text": size,
                "problem": problem,
                "dilation": contour.dilation_mm,
                "calibration": contour.calibration_mm,
                "hydromark": contour.hydromark_mm,
                "sigma": sigma,
                "sigma_mm": "" if uncertainty is None else f"{uncertainty.sigma_mm:.2f}",
                "computed": tumor.is_of(contour),
                "ready": tumor.can_use(contour),
                "revision": editor.revision,
                "undo": editor.can_undo,
                "tip": places.has_tip,
                "image": places.number,
                "cut": cut,
            }
        }

    def accept(self) -> None:
        """Begin to use the contour as the tumour of the session. Raises `InputError`."""
        if self._operator is None:
            raise InputError("contour: this is a replay; expected a live session")
        edge = self._content.frame_from_tumor
        self._tumor.use(self.editor.contour, edge, self._operator)

    async def file(self, request: web.Request) -> web.Response:
        """The surface of the revision that is asked for, as STL or PLY; 409 says why not."""

        def surface() -> Write:
            if request.query.get("revision") != str(self.editor.revision):
                raise InputError(
                    "contour: it has changed meanwhile, and nothing was saved; expected the same "
                    "request again"
                )
            edge = self._content.frame_from_tumor
            mesh = self._tumor.command(self.editor.contour, edge).tumor
            return lambda path: write_mesh(path, mesh)

        return await operators_file(request, "application/octet-stream", surface)

    def close(self) -> None:
        """End the thread."""
        self._tumor.close()

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
        surface = self._tumor.surface
        if scene is not self._scene:
            if self._model is not None:
                self._model.remove()
            self._scene, self._model, self._drawn = scene, None, None
        if scene is None or (self._model is None and surface is None):
            return
        if self._model is None:
            parent = scene.tree.node(self.places.frame)
            if parent is None:
                return
            self._model = ContourModel(scene.scene, parent)
        if surface is self._drawn:
            return
        self._drawn = surface
        if surface is None:
            self._model.hide()
        else:
            self._model.show(surface.mesh)
