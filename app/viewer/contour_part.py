"""The part of the page on which operators contour a tumour: one contour, which all pages edit."""

from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import numpy as np
from aiohttp import web

from app.contour import (
    MAX_DILATION_MM,
    MAX_RADIUS_MM,
    Change,
    Contour,
    ContourEditor,
    contour_count,
)
from app.contour.surface import pixel_sigma
from app.files.meshes import write_mesh
from app.geometry import FloatArray, InputError
from app.runtime import (
    GUARDED_TOOL,
    SessionContent,
    compute_here,
    tip_mm,
    tool_names,
)
from app.scene import ContourModel, MarginGuardScene
from app.session import StepResult
from app.viewer.downloads import Write, operators_file
from app.viewer.drawing.scene_view import SceneView
from app.viewer.image_cuts import SurfaceCuts, pixels_from_root
from app.viewer.image_part import svg_path
from app.viewer.messages.checks import Check, Commands, integer, number, one_of, text
from app.viewer.view_state import ViewState
from app.workflow import ContourTumor, DisplayOperator

_MAX_IMAGES = 10_000
"""Images whose place is kept, so that points can be placed on one that a page has frozen."""


class ContourPlaces:
    """Places in ``frame``, the frame that the tumour moves with, of what a page has shown.

    ``number`` is that of the present image, None without one.
    """

    def __init__(self, content: SessionContent) -> None:
        self.frame = content.frame_from_tumor.target
        self.number: int | None = None
        self._images: OrderedDict[int, FloatArray] = OrderedDict()
        self._content = content
        self._step: StepResult | None = None

    def tip_mm(self, tool: str) -> FloatArray:
        """The tip (3,) of ``tool``. Raises `InputError` with why it is not known."""
        return tip_mm(self._step, self._content, tool, self.frame)

    @property
    def has_tip(self) -> bool:
        """True if the place of the guarded tool's tip is known."""
        try:
            self.tip_mm(GUARDED_TOOL)
        except InputError:
            return False
        return True

    def show(self, shown: ViewState | None, number: int | None, matrix: FloatArray | None) -> None:
        """Note the moment that is shown, with image ``number`` if it has a ``matrix`` (4, 4).

        ``matrix`` maps (column, row, 0) of the image to mm in `frame`.
        """
        self.number, self._step = None, None
        if number is not None and matrix is not None:
            self.number = number
            self._images[number] = matrix
            self._images.move_to_end(number)
            while len(self._images) > _MAX_IMAGES:
                self._images.popitem(last=False)
        if shown is not None and not shown.silent:
            self._step, self._content = shown.step, shown.content

    def matrix(self, number: int) -> FloatArray | None:
        """The map (4, 4) of an image that was shown; None for others."""
        return self._images.get(number)


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
            self._scene, self._model = scene, None
        if scene is None or (self._model is None and surface is None):
            return
        if self._model is None:
            parent = scene.tree.node(self.places.frame)
            if parent is None:
                return
            self._model = ContourModel(scene.scene, parent)
        self._model.show(None if surface is None else surface.mesh)


MAX_ERASE_MM = 30.0
MAX_CALIBRATION_MM = 5.0
_MAX_PIXEL = 10_000.0
_MAX_NUMBER = 2**53 - 1
_author = text(16)
_seen = integer(0, _MAX_NUMBER)
_pixel = number(-_MAX_PIXEL, _MAX_PIXEL)


class ContourControls:
    """Add, move and erase points, undo, delete all, dilate, mark a clip, state the error, accept.

    Each names the page, and the revision it has seen. A change that cannot be made, also because
    another page has changed the contour, raises `InputError`: the page that asked shows its text,
    and the contour stays as it is.
    """

    def __init__(self, commands: Commands, part: ContourPart, *, live: bool) -> None:
        self._part, self._editor = part, part.editor
        image = integer(0, _MAX_NUMBER)
        commands.add("contour_add", self._add, _author, image, _pixel, _pixel)
        tool = one_of(tool_names())
        commands.add("contour_tip", self._tip, _author, tool)
        commands.add("contour_move", self._move, _author, _seen, image, _pixel, _pixel)
        radius = number(0.0, MAX_ERASE_MM)
        commands.add("contour_erase", self._erase, _author, _seen, image, _pixel, _pixel, radius)

        def add(name: str, call: Callable[..., None], *checks: Check) -> None:
            def change(author: str, seen: int, *values: float) -> None:
                call(Change(author, seen), *values)

            commands.add(f"contour_{name}", change, _author, _seen, *checks)

        def accept(change: Change) -> None:
            self._editor.require_seen(change)
            part.accept()

        add("undo", self._editor.undo)
        add("delete_all", self._editor.delete_all)
        add("dilation", self._editor.dilate, number(0.0, MAX_DILATION_MM))
        add("hydromark", self._editor.mark_hydromark, number(0.0, MAX_RADIUS_MM))
        add("calibration", self._editor.calibrate, number(0.0, MAX_CALIBRATION_MM))
        if live:
            add("accept", accept)

    def _add(self, author: str, image: int, x: float, y: float) -> None:
        place = self._place(image, x, y)
        self._editor.add(Change(author, self._editor.revision), place, image, (x, y))

    def _tip(self, author: str, tool: str) -> None:
        place = self._part.places.tip_mm(tool)
        self._editor.add(Change(author, self._editor.revision), place)

    def _move(self, author: str, seen: int, point: int, x: float, y: float) -> None:
        known = self._editor.contour.point(point)
        if known is not None and known.image is None:
            raise InputError("contour: a point at the tip cannot be moved; expected to erase it")
        # A point that is gone is refused by the editor.
        place = np.zeros(3) if known is None else self._place(known.image or 0, x, y)
        self._editor.move(Change(author, seen), point, place, (x, y))

    def _erase(self, author: str, seen: int, image: int, x: float, y: float, radius: float) -> None:
        self._editor.erase(Change(author, seen), self._place(image, x, y), radius)

    def _place(self, image: int, x: float, y: float) -> FloatArray:
        """The place (3,) in mm of a pixel. Raises `InputError` for an image without one."""
        matrix = self._part.places.matrix(image)
        if matrix is None:
            raise InputError(
                f"contour: the place of image {image} is not known; expected an image that was "
                "shown"
            )
        return np.asarray((matrix @ (x, y, 0.0, 1.0))[:3])
