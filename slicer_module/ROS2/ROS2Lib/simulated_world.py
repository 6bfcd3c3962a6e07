"""Bodies of a simulated world as transform nodes, which a user may move, add and remove."""

import logging
from typing import Any

import numpy as np
from slicer import vtkMRMLModelNode, vtkMRMLScriptedModuleNode

from app.bridge.ros_errors import TfError
from app.bridge.world_client import TRUTH, WORLD, BodySurfaces, WorldEditor
from app.geometry import NS_PER_S, MarginGuardError, Stamp, SurfaceMesh, Transform
from app.runtime import WorldBody
from app.scene.convert import world_matrix
from app.scene.models import add_model, remove_displayed, smooth_surface
from app.scene.simulated_bodies import COLOR, EditedWorld
from ROS2Lib.collision_model import placed_surface
from ROS2Lib.member import Member, Owner, Ros2Error

GONE_NS = NS_PER_S
"""A body whose pose is as much older than those of the others has been removed."""


class vtkMRMLROS2SimulatedWorldNode(Member, vtkMRMLScriptedModuleNode):
    """The world of ``marginguard simulate``: ``BodyToWorld`` is where the physics has a body.

    Moving such a node sends a request with the time of the edit; the simulation answers by the
    body's next pose, or refuses (`GetProblem`). `AddBody` and `RemoveBody` are requests, too.
    Each body has its surface under its node, unless `AddBody` has put a model there.
    """

    ROLE = "simulated world"

    def __init__(self) -> None:
        self._editor: WorldEditor | None = None
        self._world: EditedWorld | None = None
        self._problem = ""
        self._requests = 0
        self._models: dict[str, vtkMRMLModelNode] = {}
        self._own: set[str] = set()
        self._surfaces: BodySurfaces | None = None
        self._received: tuple[WorldBody, ...] = ()
        self._drawn: dict[str, tuple[WorldBody, vtkMRMLModelNode]] = {}

    def GetNumberOfRequests(self) -> int:
        """Number of requests that were sent."""
        return self._requests

    def GetProblem(self) -> str:
        """The reason why the last refused request was refused; empty before the first."""
        return self._problem

    def GetBodies(self) -> list[str]:
        """Names of the bodies in the scene, sorted."""
        return [] if self._world is None else sorted(self._world.bodies)

    def GetBodyModelNode(self, body: str) -> Any:
        """The model node with the surface of a body; None without one."""
        return self._drawn[body][1] if body in self._drawn else None

    def GetBodyTransformNode(self, body: str) -> Any:
        """The transform node of a body; None before its first pose."""
        return None if self._world is None else self._world.node(body)

    def AddBody(self, name: str, model: vtkMRMLModelNode) -> bool:
        """Request a fixed body with the surface of ``model``, at its pose in the scene's world.

        When the body is there, the model is put under its transform node, unless its own transform
        is not rigid. Raises `MarginGuardError` for a model without triangles.
        """
        editor, owner = self._on_graph()
        vertices, triangles, pose = placed_surface(model, WORLD, name)
        editor.add(SurfaceMesh(name, vertices, triangles), pose, Stamp(owner.now_ns()))
        if np.allclose(pose.matrix, world_matrix(model.GetParentTransformNode())):
            self._models[name] = model
            self._own.add(name)
        self._requests += 1
        return True

    def RemoveBody(self, name: str) -> bool:
        """Request the end of a body."""
        editor, owner = self._on_graph()
        editor.remove(name, Stamp(owner.now_ns()))
        self._requests += 1
        return True

    def status(self) -> str:
        """Number of bodies and requests, and the last refusal."""
        text = f"{len(self.GetBodies())} bodies, {self._requests} requests"
        return f"{text}, refused: {self._problem}" if self._problem else text

    def spin(self) -> None:
        """Request what the user has moved, and show what the physics has moved."""
        if self._owner is None or self._world is None:
            return
        self._world.send()
        poses: list[tuple[int, Transform]] = []
        for frame in self._owner.buffer.frames:
            if not frame.startswith(TRUTH):
                continue
            try:
                found = self._owner.buffer.lookup(WORLD, frame)
            except TfError:  # of another tree
                continue
            name = frame.removeprefix(TRUTH)
            poses.append((found.stamp_ns or 0, found.transform.renamed(source=name)))
        newest_ns = max((stamp_ns for stamp_ns, _ in poses), default=0)
        current = [pose for stamp_ns, pose in poses if stamp_ns >= newest_ns - GONE_NS]
        self._world.show(current, newest_ns)
        for name in tuple(self._models):
            node = self._world.node(name)
            if node is not None:
                self._models.pop(name).SetAndObserveTransformNodeID(node.GetID())
        self._draw()

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """The name of the simulation's node."""
        (simulation,) = names
        return (owner.resolve(f"/{simulation.strip('/')}"),)

    def _on_graph(self) -> tuple[WorldEditor, Owner]:
        if self._editor is None or self._owner is None:
            raise Ros2Error(f"{self.GetName()}: the simulated world is not on a ROS node")
        return self._editor, self._owner

    def _draw(self) -> None:
        """Draw the surfaces that were received last, of the bodies that have a node."""
        world, scene = self._world, self.GetScene()
        surfaces = {
            each.name: each
            for each in self._received
            if world is not None
            and each.kind.is_body
            and each.name not in self._own
            and world.node(each.name) is not None
        }
        for name, (body, model) in tuple(self._drawn.items()):
            if surfaces.get(name) is not body:
                del self._drawn[name]
                remove_displayed(scene, model)
        for name, body in surfaces.items():
            if name not in self._drawn and world is not None:
                surface, node = smooth_surface(body.mesh), world.node(name)
                model = add_model(scene, name, surface, COLOR, parent=node)
                model.SaveWithSceneOff()  # the simulation has it
                self._drawn[name] = body, model

    def _take(self, bodies: list[WorldBody]) -> None:
        """In the thread of the ROS node."""
        self._received = tuple(bodies)

    def _move(self, poses: list[Transform], stamp: Stamp) -> None:
        editor, _ = self._on_graph()
        editor.move(poses, stamp)
        self._requests += 1

    def _refused(self, reason: str) -> None:
        self._problem = reason

    def _not_sent(self, error: MarginGuardError) -> None:
        self._problem = str(error)
        logging.error(f"{self.GetName()}: {error}")

    def _start(self, owner: Owner, simulation: str) -> None:
        self.SaveWithSceneOff()  # its bodies are those of a running simulation
        self.SetName(f"ros2:simulatedworld:{simulation}")
        self._editor = WorldEditor(owner.ros, simulation, self._refused)
        self._surfaces = BodySurfaces(owner.ros, simulation, self._take)
        scene = self.GetScene()
        self._world = EditedWorld(scene, WORLD, self._move, self._not_sent, clock_ns=owner.now_ns)
        _ = owner.buffer  # listen to tf from now on

    def _stop(self) -> None:
        self._received = ()
        self._draw()
        if self._surfaces is not None:
            self._surfaces.close()
            self._surfaces = None
        if self._world is not None:
            self._world.clear()
        if self._editor is not None:
            self._editor.close()
        self._editor = self._world = None
