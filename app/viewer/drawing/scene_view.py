"""The scene of a page: MRML nodes that show a step, a 3D view of them, and the parts' opacities."""

from collections.abc import Collection, Mapping
from enum import StrEnum

from slicer import vtkMRMLDisplayNode, vtkMRMLModelNode, vtkMRMLScene

from app.case import DISPLAY_ITEMS, ItemKind
from app.geometry import SurfaceMesh
from app.runtime import SessionContent
from app.scene import (
    MarginGuardScene,
    SceneApplication,
    ScenePresenter,
)
from app.scene.pictures.offscreen_view import three_d_view
from app.viewer.address import ViewerError
from app.viewer.drawing.inset import OverviewInset
from app.viewer.drawing.translucency import TranslucentOrder, closed_models
from app.viewer.view_state import ViewState

_INK = (0.92, 0.95, 0.98)
"""Colour of the closest-point line and its label on the dark background."""
_BACKGROUND = (0.055, 0.075, 0.095)


class Part(StrEnum):
    """A part of the scene, beside display items, that the page can hide or make translucent."""

    TUMOR = "TUMOR"
    STRUCTURES = "STRUCTURES"
    MARGIN = "MARGIN"
    TOOL = "TOOL"
    ROBOT = "ROBOT"
    BODIES = "BODIES"
    GHOST = "GHOST"
    CORRIDOR = "CORRIDOR"


_RODS = {each.name.upper(): each for each in DISPLAY_ITEMS if each.kind is ItemKind.ROD}
PARTS: dict[str, str] = {
    Part.TUMOR: "Tumour",
    Part.STRUCTURES: "Other structures, tools",
    Part.MARGIN: "Margin surface",
    Part.TOOL: "Tool",
    **{name: item.title for name, item in _RODS.items()},
    Part.ROBOT: "Robot",
    Part.BODIES: "Simulated bodies",
    Part.GHOST: "Planned robot",
    Part.CORRIDOR: "Needle corridor",
}
"""Parts that the page can hide or make translucent, with their labels."""

ADDED = (Part.BODIES, Part.GHOST, Part.CORRIDOR)
"""Parts that are not of the session."""

_OPACITY_ALONG_TOOL: dict[str, float] = {Part.TOOL: 0.0, Part.ROBOT: 0.0, Part.GHOST: 0.0}
"""Opacity factor of a part in a view along the tool, which it would hide; 1 for other parts."""


class SceneView:
    """Shows one step after another in a 3D view. Not thread-safe: the page's thread owns it.

    ``scene`` is None until a step in which tool and tumour are both known. ``added``: parts that
    are not of the session, which `use_models` may show, too.
    """

    def __init__(self, content: SessionContent, *, added: Collection[Part] = ()) -> None:
        self.application = SceneApplication(vtkMRMLScene())
        self.view = three_d_view(self.application, "MarginGuard", _BACKGROUND, _BACKGROUND)
        # A gradient takes a sixth of a picture's time where the processor draws.
        self.view.renderer().SetGradientBackground(False)
        self.presenter = ScenePresenter(
            self.application.scene, content, logic=self.application.logic
        )
        self._opacities = dict.fromkeys(PARTS, 1.0)
        self._hidden: set[str] = set()
        self._along_tool = False
        self._own_opacities: dict[str, dict[vtkMRMLDisplayNode, float]] = {}
        self._styled_scene: MarginGuardScene | None = None
        self.inset = OverviewInset(self.view)
        self.order = TranslucentOrder(self.view)
        self._closed: set[vtkMRMLModelNode] = set()
        self._margin_surface: SurfaceMesh | None = None
        self.added: dict[Part, dict[str, vtkMRMLModelNode]] = {each: {} for each in ADDED}
        """Models of each of `ADDED`, by name."""
        self._absent = set(ADDED) - set(added)

    @property
    def content(self) -> SessionContent:
        """The content of the step that was shown last."""
        return self.presenter.content

    @property
    def scene(self) -> MarginGuardScene | None:
        """The scene of the present content, None before a step has placed tool and tumour."""
        return self.presenter.scene

    @property
    def parts(self) -> tuple[str, ...]:
        """The parts that the content has."""
        shown = {each.name for each in self.content.items}
        absent = {name for name, item in _RODS.items() if item.name not in shown} | self._absent
        if self.content.margins.stop_mm == 0.0:
            absent.add(Part.MARGIN)
        if self.content.robot is None:
            absent |= {Part.ROBOT, Part.GHOST}
        if not (self.content.structures or self.content.tools):
            absent.add(Part.STRUCTURES)
        return tuple(part for part in PARTS if part not in absent)

    def visible(self, part: str) -> bool:
        """True if the part is not hidden."""
        return part not in self._hidden

    def opacity(self, part: str) -> float:
        """Factor of the part's own opacity, 0 to 1."""
        return self._opacities[part]

    def show(self, shown: ViewState) -> None:
        """Bring the scene to the step of ``shown``."""
        self.presenter.set_content(shown.content)
        self._margin_surface = shown.margin_surface
        self.presenter.set_margin_surface(shown.margin_surface)
        if self.scene is None and shown.step.tumor_from_tip is None:
            return  # The cameras frame tool and tumour: both are needed.
        self.presenter.show(
            shown.step,
            measured=shown.measured,
            breach_points_mm=shown.marks[: shown.marked],
        )
        if shown.silent:
            self.presenter.hide_pointers()
        self._style_new_nodes()

    @property
    def bodies(self) -> Mapping[str, vtkMRMLModelNode]:
        """Models of the bodies of a simulated world, by name."""
        return self.added[Part.BODIES]

    @property
    def links(self) -> list[vtkMRMLModelNode]:
        """Models of the robots' links, with those of a planned one."""
        links = [] if self.scene is None else self.scene.link_models
        return [*links, *self.added[Part.GHOST].values()]

    @property
    def others(self) -> list[vtkMRMLModelNode]:
        """Added models that are no links."""
        return [*self.bodies.values(), *self.added[Part.CORRIDOR].values()]

    def use_models(self, part: Part, models: Mapping[str, vtkMRMLModelNode]) -> bool:
        """Style ``models``, which the scene has, as ``part`` of `ADDED`; True if they changed."""
        if list(self.added[part].values()) == list(models.values()):
            return False
        self.added[part] = dict(models)
        self._style_new_nodes()
        return True

    def sort(self) -> None:
        """Sort what is translucent by its depth. Call it before each picture."""
        added = [model for models in self.added.values() for model in models.values()]
        self.order.update(self.scene, self._closed, added, apart=self.inset.robots)

    def set_visible(self, part: str, visible: bool) -> None:
        """Show or hide a part."""
        if visible:
            self._hidden.discard(part)
        else:
            self._hidden.add(part)
        self._style(part)

    def set_opacity(self, part: str, opacity: float) -> None:
        """Multiply the part's own opacity by ``opacity``, 0 to 1."""
        if not 0.0 <= opacity <= 1.0:
            raise ViewerError(f"opacity of {PARTS[part].lower()} is {opacity}; expected 0 to 1")
        self._opacities[part] = opacity
        self._style(part)

    def look_along_tool(self, along: bool) -> None:
        """Hide what stands between a camera behind the tool and what the tip points at."""
        self._along_tool = along
        for part in PARTS:
            self._style(part)
        self._show_label()

    def _style_new_nodes(self) -> None:
        """Style what the presenter has added since the last step."""
        scene = self.scene
        if scene is None:
            return
        if scene is not self._styled_scene:
            self._styled_scene = scene
            self._own_opacities = {part: {} for part in PARTS}
            _color_line(scene)
            self._show_label()
        has_changed = False
        for part in PARTS:
            known = self._own_opacities[part]
            displays = self._displays(scene, part)
            if displays != list(known):
                has_changed = True
                self._own_opacities[part] = {
                    each: known.get(each, each.GetOpacity()) for each in displays
                }
                self._style(part)
        if has_changed:
            self._closed = closed_models(scene, self.content, self._margin_surface)

    def _style(self, part: str) -> None:
        if self.scene is None or self.scene is not self._styled_scene:
            return
        factor = _OPACITY_ALONG_TOOL.get(part, 1.0) if self._along_tool else 1.0
        with self.scene.update():
            for display, own in self._own_opacities[part].items():
                display.SetOpacity(own * self._opacities[part] * factor)
                display.SetVisibility(self.visible(part) and factor > 0.0)

    def _displays(self, scene: MarginGuardScene, part: str) -> list[vtkMRMLDisplayNode]:
        if part in ADDED:
            return [node.GetDisplayNode() for node in self.added[Part(part)].values()]
        nodes = {
            Part.TUMOR: [scene.tumor],
            Part.STRUCTURES: list(scene.structures.nodes.values()),
            Part.MARGIN: [scene.margin_surface],
            Part.TOOL: [scene.tool],
            **{name: [scene.items.nodes.get(item.name)] for name, item in _RODS.items()},
            Part.ROBOT: scene.link_models,
        }[part]
        return [node.GetDisplayNode() for node in nodes if node is not None]

    def _show_label(self) -> None:
        """Show the distance label, but not along the tool, where it hides the tip's target."""
        if self.scene is not None and self.scene.margin is not None:
            display = self.scene.margin.line.GetDisplayNode()
            display.SetPointLabelsVisibility(not self._along_tool)


def _color_line(scene: MarginGuardScene) -> None:
    """Draw the closest-point line in a colour that shows on the dark background."""
    if scene.margin is None:
        return
    display = scene.margin.line.GetDisplayNode()
    display.SetSelectedColor(*_INK)
    display.SetColor(*_INK)
    display.GetTextProperty().SetBackgroundColor(*_BACKGROUND)
