"""View of a session in the panel: cameras, opacity, breach markers, the patient's pose."""

from slicer import vtkMRMLCameraNode, vtkMRMLScene, vtkMRMLTransformNode

from app.geometry import InputError, MarginGuardError
from app.scene import MarkerStyle, Preset

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
            self._session.display.set_marker_style(style)

    def delete_markers(self) -> None:
        """Remove the breach markers; the list of breaches stays. Raises `InputError` without."""
        self._session.shown().delete_markers()

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
