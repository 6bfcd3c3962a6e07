"""Overview of robot, tool and tumour in a corner of a close-up, which leaves the robot out."""

from collections.abc import Callable, Iterable

from slicer import vtkMRMLModelNode
from trame_slicer.views import ThreeDView
from vtkmodules.vtkRenderingCore import vtkActor, vtkRenderer

from app.geometry import FloatArray
from app.scene import MarginGuardScene
from app.scene.pictures.camera_views import VIEW_ANGLE_DEG, Camera
from app.viewer.drawing.translucency import MODELS, FollowingActor, actors_of, follow

_SIDES = {"right": 0.71, "left": 0.01}
"""Left edge at each side of the picture."""
_BOTTOM, _SIZE = 0.70, 0.28
"""Parts of the picture's width and height, as the frame in page.css."""
_LABEL = 0.16
"""Part of the picture's width that the distance has on the right of the tip."""
_BACKGROUND = (0.085, 0.115, 0.145)


class OverviewInset:
    """Second renderer in the window of ``view``, with a camera that the pointer does not move.

    While it is shown, it alone draws the robots; all others are drawn by both.
    """

    def __init__(self, view: ThreeDView) -> None:
        self._main = view.renderer()
        self._managed = view.get_displayable_manager_by_class(MODELS)
        self._renderer = vtkRenderer()
        self.side = "right"
        self._renderer.SetBackground(*_BACKGROUND)
        self._renderer.InteractiveOff()
        self._renderer.DrawOff()
        self._followers: dict[vtkActor, FollowingActor] = {}
        self._is_placed = False
        self.robots: dict[vtkMRMLModelNode, vtkActor] = {}
        """Models that the inset alone draws."""
        view.render_window().AddRenderer(self._renderer)

    @property
    def is_shown(self) -> bool:
        """True if the next picture has it."""
        return bool(self._renderer.GetDraw())

    def hide(self) -> None:
        """Leave it out of the next pictures; the robots are drawn in the view again."""
        self._renderer.DrawOff()
        self._take({})

    def reframe(self) -> None:
        """Place its camera again when it is shown next."""
        self._is_placed = False

    def show(
        self,
        scene: MarginGuardScene,
        links: Iterable[vtkMRMLModelNode],
        others: Iterable[vtkMRMLModelNode],
        camera: Callable[[], Camera],
        uncovered: FloatArray,
    ) -> None:
        """Draw tumour, tool, ``links`` and ``others``; ``camera`` is called when it is placed.

        It changes sides where it would cover one of the points ``uncovered`` (n, 3) in RAS, or
        the distance beside it.
        """
        if self._covers(self.side, uncovered):
            other = next(side for side in _SIDES if side != self.side)
            self.side = self.side if self._covers(other, uncovered) else other
        left = _SIDES[self.side]
        self._renderer.SetViewport(left, _BOTTOM, left + _SIZE, _BOTTOM + _SIZE)
        self._take(actors_of(self._managed, links))
        drawn = actors_of(self._managed, [scene.tumor, scene.tool, *others]).values()
        follow(self._renderer, self._followers, [each for each in drawn if each.GetVisibility()])
        if not self._is_placed:
            placed, own = camera(), self._renderer.GetActiveCamera()
            own.SetPosition(placed.position.tolist())
            own.SetFocalPoint(placed.focal_point.tolist())
            own.SetViewUp(placed.up.tolist())
            own.SetViewAngle(VIEW_ANGLE_DEG)
            self._is_placed = True
        self._renderer.ResetCameraClippingRange()
        self._renderer.DrawOn()

    def _covers(self, side: str, points: FloatArray) -> bool:
        left = _SIDES[side]
        for point in points:
            self._main.SetWorldPoint(*point, 1.0)
            self._main.WorldToView()
            x, y = (0.5 * (value + 1.0) for value in self._main.GetViewPoint()[:2])
            if left - _LABEL <= x <= left + _SIZE and _BOTTOM <= y <= _BOTTOM + _SIZE:
                return True
        return False

    def _take(self, robots: dict[vtkMRMLModelNode, vtkActor]) -> None:
        """Draw the actors of ``robots`` here, and those of before in the view if it has them."""
        if robots == self.robots:
            return
        # The lists alone: adding and removing a prop would upload its surface again.
        own, main = self._renderer.GetViewProps(), self._main.GetViewProps()
        for model, actor in self.robots.items():
            own.RemoveItem(actor)
            display = model.GetDisplayNode()
            if display is not None and self._managed.GetActorByID(display.GetID()) is actor:
                main.AddItem(actor)
        for actor in robots.values():
            main.RemoveItem(actor)
            own.AddItem(actor)
        self.robots = robots
