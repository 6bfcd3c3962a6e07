"""Commands of the page that edit a simulated world: requests to the simulation."""

from collections.abc import Callable, Sequence

import numpy as np

from app.geometry import InputError, SurfaceMesh, Transform
from app.robot.primitives import box, sphere
from app.runtime import SimulatedWorld
from app.viewer.body_upload import MAX_PLACE_MM, checked_name, placed
from app.viewer.messages.checks import number, numbers, one_of, text
from app.viewer.messages.commands import Commands
from app.viewer.messages.errors import NotDoneError

AXES = ("x", "y", "z")
SHAPES = ("box", "ball")
MAX_SIZE_MM, MIN_SIZE_MM = 1000.0, 0.1
_MAX_NAME = 64


class WorldControls:
    """Move, add and remove bodies of ``world``.

    What cannot be requested raises `NotDoneError`: the page that asked shows its text. Refusals of
    the simulation are in the list of the world, which all pages show.
    """

    def __init__(
        self, commands: Commands, world: SimulatedWorld, changed: Callable[[], None]
    ) -> None:
        self._world, self._changed = world, changed
        name, way = text(_MAX_NAME), number(-MAX_PLACE_MM, MAX_PLACE_MM)
        turn = number(-360.0, 360.0)
        commands.add("world_move", self._move, name, way, way, way, one_of(AXES), turn)
        sizes = numbers(3, MIN_SIZE_MM, MAX_SIZE_MM)
        place = numbers(3, -MAX_PLACE_MM, MAX_PLACE_MM)
        commands.add("world_add", self._add, name, one_of(SHAPES), sizes, place)
        commands.add("world_remove", self._remove, name)

    def _move(self, name: str, x: float, y: float, z: float, axis: str, turn_deg: float) -> None:
        vector = np.radians(turn_deg) * np.eye(3)[AXES.index(axis)]
        frame = self._world.frame
        turn = Transform.from_rotation_vector(vector, np.zeros(3), target=frame, source=frame)
        self._do(lambda: self._world.move(name, np.array([x, y, z]), turn.rotation))

    def _add(self, name: str, shape: str, sizes: Sequence[float], place: Sequence[float]) -> None:
        """Add a box with edges ``sizes``, or a ball with the first as its diameter, in mm."""

        def add() -> None:
            checked_name(name)
            vertices, faces = box(sizes) if shape == "box" else sphere(sizes[0] / 2.0)
            mesh = SurfaceMesh(name, vertices, faces.astype(np.int32))
            self._world.add(mesh, placed(self._world, name, np.array(place)))

        self._do(add)

    def _remove(self, name: str) -> None:
        self._do(lambda: self._world.remove(name))

    def _do(self, request: Callable[[], None]) -> None:
        try:
            request()
        except InputError as error:
            raise NotDoneError(str(error)) from error
        self._changed()
