"""A session in the MRML scene: each step's poses and decision, and grey for what has grown old."""

from slicer import (
    vtkMRMLApplicationLogic,
    vtkMRMLCameraNode,
    vtkMRMLScene,
    vtkMRMLTransformNode,
)

from app.bridge.publishing.replay_scene import ReplayScene
from app.fixture import MarginState
from app.geometry import FloatArray, Transform
from app.scene import (
    MarginGuardScene,
    Preset,
    SceneError,
    TransformHealth,
    bullseye,
    forward_of,
    look_through,
    preset_camera,
)
from app.scene.frames.frame_graph import poses_in
from app.scene.nodes.convert import world_matrix, world_points
from app.scene.pictures.cameras import VIEW_ANGLE_DEG
from app.session import REFERENCE, SessionSetup, StepResult

NOTHING_YET = "UNKNOWN: nothing was tracked yet"
TAKEN = "UNKNOWN: the display was changed by somebody else"
_BULLSEYE_MM = 120.0


class SessionDisplay:
    """Shows the steps of a session in ``mrml_scene``; for the scene's thread alone.

    ``shown`` and ``setup`` say what there is: tumour, tool, robot and the fixed edges. A part of
    it comes into the scene when its frame is seen for the first time. With the application's
    ``logic`` its views draw once a step.
    """

    def __init__(
        self,
        mrml_scene: vtkMRMLScene,
        shown: ReplayScene,
        setup: SessionSetup,
        *,
        opacity: float,
        patient_to_ras: vtkMRMLTransformNode | None,
        logic: vtkMRMLApplicationLogic | None,
    ) -> None:
        self.shown = shown
        self.scene: MarginGuardScene | None = None
        self._mrml_scene = mrml_scene
        self._setup = setup
        self._opacity = opacity
        self._patient_to_ras = patient_to_ras
        self._logic = logic
        self._measured: dict[tuple[str, str], Transform] = {}
        self._up: FloatArray | None = None

    def show(
        self, step: StepResult, shown: ReplayScene, now_ns: int
    ) -> tuple[TransformHealth, ...]:
        """Move everything to where ``step`` has it, colour the margin; how every transform is.

        Another tumour in ``shown`` takes the place of the one before.
        """
        for sample in step.frame.poses:
            if sample.transform is not None:
                self._measured[sample.target, sample.source] = sample.transform
        if shown.tumor is not self.shown.tumor:
            self.clear()
        self.shown = shown
        scene = self.scene or self._begin(shown)
        if scene is None:
            return ()
        with scene.update():
            for sample in step.frame.poses:
                scene.watchdog.saw(sample)
            scene.set_poses(self._measured.values(), self._placed(scene, shown))
            self._add_what_is_placed(scene, shown)
            if scene.tumor is not None:
                links = dict.fromkeys(scene.robots, step.links)
                scene.show(step.decision, links, now_ns)
        return scene.watchdog.check(now_ns)

    def check(self, now_ns: int) -> tuple[TransformHealth, ...]:
        """Grey what is too old by ``now_ns``; how every tracked transform is."""
        return () if self.scene is None else self.scene.check(now_ns)

    def readout(self) -> tuple[MarginState, str]:
        """The state that the tumour's colour tells, and the banner, as both are in the scene."""
        if self.scene is None or self.scene.margin is None:
            return MarginState.UNKNOWN, NOTHING_YET
        display = self.scene.tumor.GetDisplayNode()
        color = None if display is None else display.GetColor()
        for state in MarginState:
            if state.color == color:
                return state, self.scene.margin.status.GetText()
        return MarginState.UNKNOWN, TAKEN

    def restart(self) -> None:
        """Forget when what was seen: the next step may be from an earlier time."""
        if self.scene is not None:
            self.scene.watchdog.restart()

    def set_opacity(self, opacity: float) -> None:
        """Of the tumour, 0 to 1."""
        self._opacity = opacity
        if self.scene is not None and self.scene.tumor is not None:
            self.scene.tumor.GetDisplayNode().SetOpacity(opacity)

    def hang_under(self, patient_to_ras: vtkMRMLTransformNode | None) -> None:
        """Show all of it where ``patient_to_ras`` puts the reference; None: at the world's origin.

        For display only: nothing that is measured changes. Raises `SceneError` for a node that
        hangs from the reference itself.
        """
        if self.scene is not None:
            root = self.reference_node()
            above = patient_to_ras
            while above is not None:
                if above is root:
                    raise SceneError(f"{patient_to_ras.GetName()} hangs from {root.GetName()}")
                above = above.GetParentTransformNode()
            root.SetAndObserveTransformNodeID(patient_to_ras.GetID() if patient_to_ras else None)
        self._patient_to_ras = patient_to_ras

    def look(self, camera: vtkMRMLCameraNode, preset: Preset) -> None:
        """Look at the tumour from one side of the patient."""
        turn = world_matrix(self._scene().tree.node(self._scene().reference))[:3, :3]
        points = world_points(self._scene().tumor)
        look_through(
            camera,
            preset_camera(preset, points, ras_from_patient=turn, angle_deg=VIEW_ANGLE_DEG),
            VIEW_ANGLE_DEG,
        )

    def look_along_tool(self, camera: vtkMRMLCameraNode) -> None:
        """Look along the tool at what lies before its tip (the bullseye view)."""
        if self._scene().tool is None or self.shown.tool is None:
            raise SceneError("the tool's mesh is not in the scene: no direction to look along")
        tip = self._scene().tree.node(self.shown.tool.frame)
        ras_from_tip = Transform.from_matrix(
            world_matrix(tip), target="ras", source=self.shown.tool.frame
        )
        view = bullseye(
            ras_from_tip,
            forward_of(self.shown.tool),
            distance_mm=_BULLSEYE_MM,
            previous_up=self._up,
        )
        self._up = view.up
        look_through(camera, view, VIEW_ANGLE_DEG)

    def tumor_node(self) -> vtkMRMLTransformNode:
        """The transform node of the tumour's frame; `SceneError` before it is seen."""
        return self._scene().tree.node(self.shown.tumor.frame)

    def reference_node(self) -> vtkMRMLTransformNode:
        """The transform node of the reference; `SceneError` before it is seen."""
        if self.scene is None:
            raise SceneError("nothing was tracked yet: the reference is not in the scene")
        return self.scene.tree.node(self.scene.reference)

    def clear(self) -> None:
        """Take all of it out of the scene."""
        if self.scene is not None:
            self.scene.clear()
        self.scene = None

    def _scene(self) -> MarginGuardScene:
        if self.scene is None or self.scene.tumor is None:
            raise SceneError("nothing was tracked yet: the tumour is not in the scene")
        return self.scene

    def _begin(self, shown: ReplayScene) -> MarginGuardScene | None:
        """The scene, as soon as the frame that the tumour moves with is seen."""
        holder = self._setup.frame_from_tumor.target
        seen = poses_in(holder, self._measured.values())
        if len(seen) == 1:
            return None
        root = REFERENCE if REFERENCE in seen else holder
        self.scene = MarginGuardScene(
            self._mrml_scene,
            root,
            stale_after_ns=shown.margins.stale_after_ns,
            logic=self._logic,
            go_on=True,
        )
        self.hang_under(self._patient_to_ras)
        for target, source in self._measured:
            self.scene.watchdog.expect(target, source)
        return self.scene

    def _placed(self, scene: MarginGuardScene, shown: ReplayScene) -> list[Transform]:
        """The fixed edges whose target is in the scene, in an order in which they can be set."""
        known = {*poses_in(scene.reference, self._measured.values())}
        placed = []
        for edge in shown.static_edges:
            if edge.target in known:
                placed.append(edge)
                known.add(edge.source)
        return placed

    def _add_what_is_placed(self, scene: MarginGuardScene, shown: ReplayScene) -> None:
        if scene.tumor is None and scene.tree.node(shown.tumor.frame) is not None:
            scene.add_tumor(shown.tumor).GetDisplayNode().SetOpacity(self._opacity)
        tip = self._setup.tool_from_tip.source
        if scene.tool is None and scene.tree.node(tip) is not None:
            if shown.tool is None:
                scene.add_tip(tip)
            else:
                scene.add_tool(shown.tool)
        robot = self._setup.robot
        if robot is not None and not scene.robots and scene.tree.node(robot.base_frame):
            scene.add_robot(robot.robot.name, robot.robot, robot.base_frame)
