"""Shows a session in the MRML scene of desktop Slicer."""

from slicer import (
    vtkMRMLApplicationLogic,
    vtkMRMLCameraNode,
    vtkMRMLScene,
    vtkMRMLTransformNode,
)

from app.fixture import MarginState
from app.geometry import FloatArray, Transform
from app.runtime import SessionContent
from app.scene import (
    MarginGuardScene,
    MarkerStyle,
    Preset,
    SceneError,
    ScenePresenter,
    TransformHealth,
    bullseye,
    center_on,
    forward_of,
    look_through,
    preset_camera,
)
from app.scene.convert import world_matrix, world_points
from app.scene.pictures.camera_views import VIEW_ANGLE_DEG
from app.session import StepResult

NOT_TRACKED_YET = "UNKNOWN: nothing was tracked yet"
DISPLAY_CHANGED = "UNKNOWN: the display was changed by a user or another module"
_BULLSEYE_MM = 120.0


class SessionDisplay:
    """Shows the steps of a session in ``mrml_scene``. Call it in the thread that owns the scene.

    ``opacity`` is the tumour's, 0 to 1. ``patient_to_ras`` is the parent node of the reference,
    None for the world's origin. With the application's ``logic`` its views draw once per step.
    """

    def __init__(
        self,
        mrml_scene: vtkMRMLScene,
        content: SessionContent,
        *,
        opacity: float,
        marker_style: MarkerStyle,
        patient_to_ras: vtkMRMLTransformNode | None,
        logic: vtkMRMLApplicationLogic | None,
    ) -> None:
        self.presenter = ScenePresenter(
            mrml_scene, content, is_live=True, logic=logic, adopt_nodes=True
        )
        self.presenter.marker_style = marker_style
        self._opacity = opacity
        self._patient_to_ras = patient_to_ras
        self._up: FloatArray | None = None

    @property
    def content(self) -> SessionContent:
        """The content of the step that was shown last."""
        return self.presenter.content

    @property
    def scene(self) -> MarginGuardScene | None:
        """The scene, None before the frame that the tumour moves with was tracked."""
        return self.presenter.scene

    def show(
        self, step: StepResult, content: SessionContent, now_ns: int
    ) -> tuple[TransformHealth, ...]:
        """Show ``step``, taken with ``content``; return the health of each transform."""
        self.presenter.set_content(content)
        before = self.scene
        self.presenter.show(step, now_ns=now_ns)
        if self.scene is not before:
            self.set_patient_to_ras(self._patient_to_ras)
            self.set_opacity(self._opacity)
        return self.presenter.health(now_ns)

    def readout(self) -> tuple[MarginState, str]:
        """Read the state from the tumour's colour, and the banner's text, from the scene."""
        if self.scene is None or self.scene.margin is None:
            return MarginState.UNKNOWN, NOT_TRACKED_YET
        display = self.scene.tumor.GetDisplayNode()
        color = None if display is None else display.GetColor()
        for state in MarginState:
            if state.color == color:
                return state, self.scene.margin.status.GetText()
        return MarginState.UNKNOWN, DISPLAY_CHANGED

    def set_opacity(self, opacity: float) -> None:
        """Set the tumour's opacity, 0 to 1."""
        self._opacity = opacity
        if self.scene is not None and self.scene.tumor is not None:
            self.scene.tumor.GetDisplayNode().SetOpacity(opacity)

    def set_patient_to_ras(self, patient_to_ras: vtkMRMLTransformNode | None) -> None:
        """Make ``patient_to_ras`` the parent of the reference; None for the world's origin.

        For display only: no measured transform changes. Raises `SceneError` for the reference or a
        node below it.
        """
        if self.scene is not None:
            root = self.reference_node()
            above = patient_to_ras
            while above is not None:
                if above is root:
                    name = patient_to_ras.GetName()
                    raise SceneError(f"{name} is below {root.GetName()}; expected another node")
                above = above.GetParentTransformNode()
            root.SetAndObserveTransformNodeID(patient_to_ras.GetID() if patient_to_ras else None)
        self._patient_to_ras = patient_to_ras

    def view_from(self, camera: vtkMRMLCameraNode, preset: Preset) -> None:
        """Place ``camera`` at the side ``preset`` of the patient, facing the tumour."""
        rotation = world_matrix(self._scene().tree.node(self._scene().reference))[:3, :3]
        points = world_points(self._scene().tumor)
        look_through(
            camera,
            preset_camera(preset, points, ras_from_patient=rotation, angle_deg=VIEW_ANGLE_DEG),
            VIEW_ANGLE_DEG,
        )

    def view_along_tool(self, camera: vtkMRMLCameraNode) -> None:
        """Place ``camera`` behind the tool, facing its tip (the bullseye view)."""
        if self._scene().tool is None or self.content.tool is None:
            raise SceneError("view along the tool: no tool mesh in the scene; expected one")
        tip = self._scene().tree.node(self.content.tool.frame)
        ras_from_tip = Transform.from_matrix(
            world_matrix(tip), target="ras", source=self.content.tool.frame
        )
        view = bullseye(
            ras_from_tip,
            forward_of(self.content.tool),
            distance_mm=_BULLSEYE_MM,
            previous_up=self._up,
        )
        self._up = view.up
        look_through(camera, view, VIEW_ANGLE_DEG)

    def center_tumor(self, camera: vtkMRMLCameraNode) -> None:
        """Move ``camera`` without a turn until the middle of the tumour is in its middle."""
        center_on(camera, world_points(self._scene().tumor).mean(axis=0))

    def tumor_node(self) -> vtkMRMLTransformNode:
        """The transform node of the tumour's frame; `SceneError` before it is tracked."""
        return self._scene().tree.node(self.content.tumor.frame)

    def frame_node(self, frame: str) -> vtkMRMLTransformNode:
        """The transform node of ``frame``; `SceneError` before it is tracked."""
        if self.scene is None or self.scene.tree.node(frame) is None:
            raise SceneError(f"{frame} was not tracked yet; expected it in the scene")
        return self.scene.tree.node(frame)

    def reference_node(self) -> vtkMRMLTransformNode:
        """The transform node of the root frame; `SceneError` before it is tracked."""
        if self.scene is None:
            raise SceneError("nothing was tracked yet; expected the reference in the scene")
        return self.scene.tree.node(self.scene.reference)

    def clear(self) -> None:
        """Remove all nodes of the session from the scene."""
        self.presenter.clear()

    def _scene(self) -> MarginGuardScene:
        if self.scene is None or self.scene.tumor is None:
            raise SceneError("nothing was tracked yet; expected the tumour in the scene")
        return self.scene
