"""The part of the page with the bodies of a simulated world."""

from typing import Any

from app.runtime import SimulatedWorld, WorldMoment
from app.scene import BodyModels, MarginGuardScene
from app.viewer.drawing.scene_view import SceneView
from app.viewer.readout.world import is_current, world_values
from app.viewer.steps.view_state import ViewState


class WorldPart:
    """Shows the bodies of ``world`` in the scene and in a list. The page's thread owns it.

    They are grey while their poses are older than those of the session may be.
    """

    def __init__(self, world: SimulatedWorld) -> None:
        self.world = world
        self._moment = WorldMoment()
        self._now_ns = 0
        self._stale_after_ns = 0
        self._scene: MarginGuardScene | None = None
        self._models: BodyModels | None = None

    @property
    def revision(self) -> object:
        """A value that changes when the page needs an update without a new step."""
        return self.world.version

    def update(self, shown: ViewState, view: SceneView) -> bool:
        """Show the present with the moment ``shown``; True if there are other bodies."""
        self._moment, self._now_ns = self.world.moment(), self.world.clock_ns()
        self._stale_after_ns = shown.content.margins.stale_after_ns
        scene = view.scene
        if scene is not self._scene:
            if self._models is not None:
                self._models.remove()
            self._scene = scene
            self._models = None if scene is None else BodyModels(scene, self.world.tracker)
        if self._models is not None:
            meshes = [each.mesh for each in self._moment.bodies if each.kind.is_body]
            current = is_current(self._moment, self._now_ns, self._stale_after_ns)
            self._models.show(meshes, self._moment.poses, is_current=current)
        return view.use_bodies({} if self._models is None else self._models.models)

    def values(self) -> dict[str, Any]:
        """The values of the page that belong to the last `update`."""
        return {"world": world_values(self._moment, self._now_ns, self._stale_after_ns)}
