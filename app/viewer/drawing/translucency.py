"""Draws translucent surfaces in their order of depth.

VTK's order-independent transparency takes 10 ms of a picture of 980 x 560 pixels where the
processor draws, and is an approximation. A closed surface needs no sorting of its triangles if its
far side is drawn before its near side: that is exact for a convex surface.
"""

from collections.abc import Container, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from slicer import vtkMRMLMarkupsPlaneNode, vtkMRMLModelNode
from trame_slicer.views import ThreeDView
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper, vtkProp, vtkRenderer

from app.geometry import FloatArray, SurfaceMesh
from app.runtime import SessionContent
from app.scene import MarginGuardScene

MODELS = "vtkMRMLModelDisplayableManager"
_PLANE = "vtkSlicerPlaneRepresentation3D"


class TranslucentOrder:
    """Orders what ``view`` draws, from the far to the near. Call `update` before each picture.

    The tumour, the margin surface around it and one more closed model, as the link that holds the
    tool, may be translucent. With any other translucent model VTK sorts, in the time that it takes.
    """

    def __init__(self, view: ThreeDView) -> None:
        self._renderer = view.renderer()
        self._models = view.get_displayable_manager_by_class(MODELS)
        self._near_sides: dict[vtkActor, FollowingActor] = {}

    def update(
        self,
        scene: MarginGuardScene | None,
        closed: Iterable[vtkMRMLModelNode],
        bodies: Iterable[vtkMRMLModelNode] = (),
        apart: Container[vtkMRMLModelNode] = (),
    ) -> None:
        """Order the models of ``scene``, of which those in ``closed`` are closed surfaces.

        ``bodies``: what is drawn besides tumour, tool and robots. ``apart``: what this renderer
        does not draw.
        """
        closed = set(closed)
        actors = {} if scene is None else self._actors(scene, bodies)
        translucent = {
            model: actor
            for model, actor in actors.items()
            if model not in apart
            and actor.GetVisibility()
            and actor.HasTranslucentPolygonalGeometry()
        }
        others = [] if scene is None else [m for m in translucent if not _is_target(scene, m)]
        ordered = (
            scene is not None
            and scene.tumor in actors
            and len(others) <= 1
            and translucent.keys() <= closed
        )
        for model in actors:
            display = model.GetDisplayNode()
            display.SetFrontfaceCulling(ordered and model in translucent)
            display.SetBackfaceCulling(model in closed and model not in translucent)
        follow(self._renderer, self._near_sides, translucent.values() if ordered else ())
        self._renderer.SetUseOIT(not ordered)
        if scene is not None and ordered:
            middle = np.array(actors[scene.tumor].GetCenter())
            self._put_first(self._by_depth(scene, translucent, middle))

    def _actors(
        self, scene: MarginGuardScene, bodies: Iterable[vtkMRMLModelNode]
    ) -> dict[vtkMRMLModelNode, vtkActor]:
        parts = (scene.tumor, scene.margin_surface, scene.tool)
        models = [*parts, *scene.items.nodes.values(), *scene.link_models, *bodies]
        return actors_of(self._models, filter(None, models))

    def _by_depth(
        self,
        scene: MarginGuardScene,
        translucent: Mapping[vtkMRMLModelNode, vtkActor],
        middle: FloatArray,
    ) -> list[vtkProp]:
        """The far and near sides, and the constraint's plane, from the far to the near.

        ``middle`` (3,) is that of the tumour, in RAS mm.
        """
        # The margin surface encloses the tumour.
        inside_out = [
            translucent[m] for m in (scene.tumor, scene.margin_surface) if m in translucent
        ]
        target = [
            *reversed(inside_out),
            *(self._near_sides[actor].actor for actor in inside_out),
        ]
        before: list[vtkProp] = []
        after: list[vtkProp] = []
        camera = self._renderer.GetActiveCamera()
        eye = np.array(camera.GetPosition())
        if scene.margin is not None:
            is_behind = _are_on_one_side(scene.margin.plane.node, eye, middle)
            (before if is_behind else after).extend(self._planes())
        for model, actor in translucent.items():
            if not _is_target(scene, model):
                depth_mm = (
                    np.array(actor.GetCenter()) - middle
                ) @ camera.GetDirectionOfProjection()
                sides = [actor, self._near_sides[actor].actor]
                if depth_mm > 0.0:
                    before[:0] = sides
                else:
                    after.extend(sides)
        return [*before, *target, *after]

    def _planes(self) -> list[vtkProp]:
        props = self._renderer.GetViewProps()
        found = (props.GetItemAsObject(n) for n in range(props.GetNumberOfItems()))
        return [prop for prop in found if prop.GetClassName() == _PLANE]

    def _put_first(self, ordered: Sequence[vtkProp]) -> None:
        """Let the renderer draw ``ordered`` before its other props, without a new upload."""
        props = self._renderer.GetViewProps()
        present = [props.GetItemAsObject(n) for n in range(props.GetNumberOfItems())]
        if present[: len(ordered)] == list(ordered):
            return
        props.RemoveAllItems()
        for prop in (*ordered, *(each for each in present if each not in ordered)):
            props.AddItem(prop)


class FollowingActor:
    """An actor that draws the faces towards the camera of the surface of another one.

    It has a mapper of its own, so that another renderer may draw it, too.
    """

    def __init__(self) -> None:
        self.actor = vtkActor()
        self.actor.PickableOff()
        # A mapper of its own: VTK 9.6 crashes when two actors with one mapper change their shader.
        self._mapper = vtkPolyDataMapper()
        self.actor.SetMapper(self._mapper)
        self._mapper_time = self._property_time = 0

    def follow(self, actor: vtkActor) -> None:
        """Show what ``actor`` shows, where it does."""
        mapper, look = actor.GetMapper(), actor.GetProperty()
        if mapper.GetMTime() != self._mapper_time:
            self._mapper_time = mapper.GetMTime()
            self._mapper.ShallowCopy(mapper)
            self._mapper.SetInputConnection(mapper.GetInputConnection(0, 0))
        if look.GetMTime() != self._property_time:
            self._property_time = look.GetMTime()
            self.actor.GetProperty().DeepCopy(look)
            self.actor.GetProperty().FrontfaceCullingOff()
            self.actor.GetProperty().BackfaceCullingOn()
        self.actor.SetUserMatrix(actor.GetUserMatrix())


def follow(
    renderer: vtkRenderer, followers: dict[vtkActor, FollowingActor], actors: Iterable[vtkActor]
) -> None:
    """Let ``renderer`` draw the near side of each of ``actors`` by an actor of ``followers``."""
    shown = set(actors)
    for actor in followers.keys() - shown:
        renderer.RemoveActor(followers.pop(actor).actor)
    for actor in shown:
        if actor not in followers:
            followers[actor] = FollowingActor()
            renderer.AddActor(followers[actor].actor)
        followers[actor].follow(actor)


def actors_of(managed: Any, models: Iterable[vtkMRMLModelNode]) -> dict[vtkMRMLModelNode, vtkActor]:
    """The actors that the manager of a view's models, ``managed``, has of ``models``."""
    found = {model: managed.GetActorByID(model.GetDisplayNode().GetID()) for model in models}
    return {model: actor for model, actor in found.items() if actor is not None}


def _is_target(scene: MarginGuardScene, model: vtkMRMLModelNode) -> bool:
    return model is scene.tumor or model is scene.margin_surface


def _are_on_one_side(node: vtkMRMLMarkupsPlaneNode, first: FloatArray, second: FloatArray) -> bool:
    """True if the plane of ``node`` does not separate the two points, (3,) each in RAS mm."""
    origin, normal = np.array(node.GetOriginWorld()), np.array(node.GetNormalWorld())
    return bool(((first - origin) @ normal) * ((second - origin) @ normal) > 0.0)


def closed_models(
    scene: MarginGuardScene, content: SessionContent, margin_surface: SurfaceMesh | None
) -> set[vtkMRMLModelNode]:
    """The models of which every part is closed with normals outward.

    The tip's ball, which has no mesh in ``content``, is left out.
    """
    surfaces = [(scene.tumor, [content.tumor])]
    surfaces += [
        (scene.structures.nodes.get(each.frame), [each])
        for each in [shape.surface for shape in content.structures]
        + [tool.surface for tool in content.tools]
    ]
    if margin_surface is not None:
        surfaces.append((scene.margin_surface, [margin_surface]))
    if content.tool is not None:
        surfaces.append((scene.tool, [content.tool]))
    surfaces += [
        (scene.items.nodes.get(item.name), [item.surface])
        for item in content.items
        if item.surface is not None and item.model is None
    ]
    if content.robot is not None:
        links = {link.name: link for link in content.robot.robot.links}
        for robot in scene.robots.values():
            for name, model in robot.models.items():
                surfaces.append((model, [shape.mesh for shape in links[name].visuals]))
    return {
        model for model, meshes in surfaces if model is not None and all(map(_is_closed, meshes))
    }


def _is_closed(mesh: SurfaceMesh) -> bool:
    return mesh.open_edges() == 0 and mesh.signed_volume_mm3 > 0.0
