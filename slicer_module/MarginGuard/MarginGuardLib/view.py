"""View of a session in the panel: cameras, opacity, markers, items, distances in directions."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from slicer import vtkMRMLCameraNode, vtkMRMLScene, vtkMRMLTransformNode

from app.geometry import InputError, MarginGuardError, SurfaceMesh
from app.runtime import (
    GUARDED_TOOL,
    ITEM_COMMANDS,
    Compute,
    SessionContent,
    ShownItem,
    TipDirections,
    stop_surface,
    tools_of,
)
from app.scene import MarkerStyle, Preset
from app.session import StepResult

from .jobs import one_line
from .shown_session import ShownSession


class PanelView:
    """Display settings of ``session``, which change no decision. Call it in the scene's thread.

    ``failure``: why the camera does not follow any more, empty otherwise.
    """

    def __init__(self, session: ShownSession, mrml_scene: vtkMRMLScene) -> None:
        self._session = session
        self._mrml_scene = mrml_scene
        self._follow: vtkMRMLCameraNode | None = None
        self._centred: vtkMRMLCameraNode | None = None
        self.failure = ""

    def set_opacity(self, opacity: float) -> None:
        """Set the tumour's opacity, 0 to 1, for this display and later ones."""
        self._session.opacity = opacity
        if self._session.display is not None:
            self._session.display.set_opacity(opacity)

    def set_markers(self, spacing_mm: float, size_mm: float) -> None:
        """Set least distance and size of the breach markers, for this display and later ones."""
        style = MarkerStyle(spacing_mm, size_mm)
        self._session.marker_style = style
        if self._session.display is not None:
            self._session.display.presenter.marker_style = style

    def delete_markers(self) -> None:
        """Remove the breach markers; the list of breaches stays. Raises `InputError` without."""
        self._session.shown().presenter.delete_breach_marks()

    def set_patient_to_ras(self, node: vtkMRMLTransformNode | None) -> None:
        """Make ``node`` the parent of the reference; None for the world's origin.

        Raises `SceneError` for a node of the session itself.
        """
        if self._session.display is not None:
            self._session.display.set_patient_to_ras(node)
        self._session.patient_to_ras = node

    def look_from(self, preset: Preset) -> None:
        """View the tumour from one side, and end following."""
        self._follow = None
        self._session.shown().view_from(self._camera(), preset)

    def follow_tool(self, follow: bool) -> None:
        """Start or end following the tool with the camera; centring ends."""
        self._follow = None
        if follow:
            self._session.shown().view_along_tool(self._camera())
            self._follow, self._centred = self._camera(), None

    def keep_centred(self, keep: bool) -> None:
        """Start or end keeping the tumour in the middle of the view; following the tool ends."""
        self._centred = None
        if keep:
            self._session.shown().center_tumor(self._camera())
            self._centred, self._follow = self._camera(), None

    @property
    def keeps_tumor(self) -> bool:
        """True while the tumour is kept in the middle."""
        return self._centred is not None

    @property
    def follows_tool(self) -> bool:
        """True while the camera follows the tool."""
        return self._follow is not None

    def update(self) -> None:
        """Follow; after an error, as for a deleted camera, the view stays."""
        display = self._session.display
        if display is None:
            return
        try:
            if self._follow is not None:
                display.view_along_tool(self._follow)
            elif self._centred is not None:
                display.center_tumor(self._centred)
        except MarginGuardError as error:
            self._follow = self._centred = None
            self.failure = one_line(error)

    def end(self) -> None:
        """Follow nothing: the session has ended."""
        self._follow = self._centred = None
        self.failure = ""

    def _camera(self) -> vtkMRMLCameraNode:
        camera = self._mrml_scene.GetFirstNodeByClass("vtkMRMLCameraNode")
        if camera is None:
            raise InputError("the scene has no 3D view; expected one with a camera")
        return camera


class PanelItems:
    """Display items of ``session``. Call it in the scene's thread."""

    def __init__(self, session: ShownSession) -> None:
        self._session = session

    def lengthen(self, name: str, by_mm: float) -> None:
        """Show the rod ``name`` longer by ``by_mm``. Raises `InputError` without a session."""
        self._session.request(ITEM_COMMANDS[name](by_mm))

    def shown(self) -> tuple[ShownItem, ...]:
        """The items of the session."""
        operator = self._session.operator
        return () if operator is None else operator.content.items

    def tools(self) -> tuple[str, ...]:
        """Names of the tools with a tip."""
        operator = self._session.operator
        return (GUARDED_TOOL,) if operator is None else tools_of(operator.content)


_PAIRS = ("RL", "AP", "SI")


class PanelDirections:
    """Computes the surface at the stop margin in the background. Call it in the scene's thread.

    ``changed()`` is called in another thread when it is done.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._directions = TipDirections()
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="stop surface")
        self._of: tuple[SurfaceMesh, float] | None = None
        self._computing: Future[SurfaceMesh | None] | None = None
        self._shown: StepResult | None = None
        self._text = ""

    def text(self, step: StepResult, content: SessionContent, compute: Compute) -> str:
        """The distances at ``step`` in mm; empty while they are not known."""
        stop_mm = content.margins.stop_mm
        if self._of is None or self._of[0] is not content.tumor or self._of[1] != stop_mm:
            self._of, self._shown = (content.tumor, stop_mm), None
            self._computing = self._worker.submit(compute, stop_surface, content)
            self._computing.add_done_callback(lambda _: self._changed())
        if self._computing is None or not self._computing.done():
            return ""
        if step is not self._shown:
            self._shown = step
            found = self._directions.at(step, content, _result(self._computing))
            lines = ("   ".join(f"{letter} {_mm(found[letter])}" for letter in p) for p in _PAIRS)
            self._text = "\n".join(lines) if found else ""
        return self._text

    def close(self) -> None:
        """End the thread."""
        self._worker.shutdown(wait=False, cancel_futures=True)


def _result(computing: "Future[SurfaceMesh | None]") -> SurfaceMesh | None:
    try:
        return computing.result()
    except MarginGuardError:
        return None  # a surface that cannot be dilated: the margin itself is not affected


def _mm(distance_mm: float | None) -> str:
    return "\N{EN DASH}" if distance_mm is None else f"{distance_mm:.1f}"
