"""The part of the page with the bodies of a simulated world, and its commands."""

import asyncio
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from aiohttp import web

from app.files.meshes import load_mesh
from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    FloatArray,
    Freshness,
    FreshnessLimits,
    InputError,
    MarginGuardError,
    SurfaceMesh,
    Transform,
    freshness_of,
)
from app.robot.primitives import box, sphere
from app.runtime import (
    MAX_BODY_TRIANGLES,
    BodyKind,
    RequestOutcome,
    SimulatedWorld,
    WorldMoment,
    WorldRequest,
    place_text,
)
from app.scene import BodyModels, MarginGuardScene
from app.viewer.access_control import ROLE
from app.viewer.address import Role
from app.viewer.drawing.scene_view import Part, SceneView
from app.viewer.messages.checks import Commands, number, numbers, one_of, text
from app.viewer.view_state import ViewState
from app.viewer.web_app import refusal

_COUNTED_S = 100


def is_current(moment: WorldMoment, now_ns: int, stale_after_ns: int) -> bool:
    """True if the poses of ``moment`` may be shown as those of ``now_ns``, of the same clock."""
    limits = FreshnessLimits(stale_after_ns)
    return freshness_of(moment.stamp_ns, now_ns, limits) is Freshness.VALID


def world_values(moment: WorldMoment, now_ns: int, stale_after_ns: int) -> dict[str, Any]:
    """The bodies with their age and place, the last request, and why there are none."""
    current = is_current(moment, now_ns, stale_after_ns)
    return {
        "count": _count(moment),
        "light": "valid" if current else "missing" if moment.stamp_ns is None else "stale",
        "age": _age(moment.stamp_ns, now_ns),
        "rows": [
            {
                "name": body.name,
                "kind": str(body.kind),
                "place": place_text(moment.poses[body.name])
                if body.name in moment.poses
                else "place not known",
                "at": _numbers(moment, body.name),
                "body": body.kind.is_body,
                "added": body.kind is BodyKind.ADDED,
            }
            for body in moment.bodies
        ],
        "problem": "" if moment.is_connected else "no simulation receives requests",
        "request": None if moment.request is None else _request(moment.request),
    }


def _numbers(moment: WorldMoment, name: str) -> list[float]:
    """Position in mm; empty while it is not known."""
    pose = moment.poses.get(name)
    return [] if pose is None else [round(float(each), 2) for each in pose.translation_mm]


def _count(moment: WorldMoment) -> str:
    count = sum(each.kind.is_body for each in moment.bodies)
    return f"{count} {'body' if count == 1 else 'bodies'}"


def _request(request: WorldRequest) -> dict[str, Any]:
    reason = f": {request.reason}" if request.reason else ""
    return {
        "line": f"{request.text}: {request.outcome}{reason}",
        "accepted": request.outcome in (RequestOutcome.DONE, RequestOutcome.WAITING),
        "outcome": str(request.outcome),
    }


def _age(stamp_ns: int | None, now_ns: int) -> str:
    if stamp_ns is None:
        return ""
    age_ns = max(now_ns - stamp_ns, 0)
    if age_ns >= _COUNTED_S * NS_PER_S:
        return f"over {_COUNTED_S} s"
    return f"{age_ns // NS_PER_MS} ms" if age_ns < NS_PER_S else f"{age_ns / NS_PER_S:.1f} s"


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
        return view.use_models(Part.BODIES, {} if self._models is None else self._models.models)

    def values(self) -> dict[str, Any]:
        """The values of the page that belong to the last `update`."""
        return {"world": world_values(self._moment, self._now_ns, self._stale_after_ns)}


MAX_BYTES = 4 << 20
MAX_PLACE_MM = 10_000.0
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")
NAME_EXPECTED = "at most 32 letters, digits and '_', the first a letter"

_CHUNK_BYTES = 1 << 16
_UPLOAD_S = 60.0


class BodyUpload:
    """Adds the surface of a request's STL file, in mm, to ``world``; one upload at a time."""

    def __init__(self, world: SimulatedWorld) -> None:
        self._world = world
        self._lock = asyncio.Lock()

    async def post(self, request: web.Request) -> web.Response:
        """Answer ``POST /body/NAME?x=&y=&z=``: the place of the file's origin in the world, mm.

        Status 409 has the reason of a file that is refused.
        """
        if not request[ROLE].may(Role.OPERATE):
            raise web.HTTPForbidden
        try:
            if self._lock.locked():
                raise InputError("upload: another one is running; expected to wait for it")
            async with self._lock, asyncio.timeout(_UPLOAD_S):
                await self._add(request)
        except TimeoutError:
            return refusal(InputError(f"upload: longer than {_UPLOAD_S:g} s; expected less"))
        except MarginGuardError as error:
            return refusal(error)
        return web.json_response({})

    async def _add(self, request: web.Request) -> None:
        name = checked_name(request.match_info["name"])
        place_mm = np.array([_number(request.query.get(axis, "")) for axis in "xyz"])
        content = bytearray()
        async for data in request.content.iter_chunked(_CHUNK_BYTES):
            content += data
            if len(content) > MAX_BYTES:
                raise InputError(f"upload: larger than {MAX_BYTES >> 20} MiB; expected less")
        loop = asyncio.get_running_loop()
        mesh = await loop.run_in_executor(None, _surface, name, bytes(content))
        self._world.add(mesh, placed(self._world, name, place_mm))


def checked_name(name: str) -> str:
    """``name``, if a body may have it. Raises `InputError`."""
    if not NAME.fullmatch(name):
        raise InputError(f"body: the name is {name[:80]!a}; expected {NAME_EXPECTED}")
    return name


def placed(world: SimulatedWorld, name: str, place_mm: FloatArray) -> Transform:
    """The pose of a body at ``place_mm`` (3,), along the axes of ``world``."""
    return Transform(world.frame, name, np.eye(3), place_mm)


def _surface(name: str, content: bytes) -> SurfaceMesh:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"{name}.stl")
        path.write_bytes(content)
        try:
            mesh = load_mesh(path, units="mm", frame=name)
        except MarginGuardError as error:
            raise InputError(str(error).replace(str(path), path.name)) from error
    if len(mesh.faces) > MAX_BODY_TRIANGLES:
        raise InputError(
            f"body {name}: {len(mesh.faces)} triangles; expected at most {MAX_BODY_TRIANGLES}"
        )
    return mesh


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) <= MAX_PLACE_MM:
        raise InputError(
            f"place: {text[:40]!a}; expected x, y and z of at most {MAX_PLACE_MM:g} mm"
        )
    return value


AXES = ("x", "y", "z")
SHAPES = ("box", "ball")
MAX_SIZE_MM, MIN_SIZE_MM = 1000.0, 0.1
_MAX_NAME = 64


class WorldControls:
    """Move, add and remove bodies of ``world``.

    What cannot be requested raises `InputError`: the page that asked shows its text. Refusals of
    the simulation are in the list of the world, which all pages show.
    """

    def __init__(self, commands: Commands, world: SimulatedWorld) -> None:
        self._world = world
        name, way = text(_MAX_NAME), number(-MAX_PLACE_MM, MAX_PLACE_MM)
        turn = number(-360.0, 360.0)
        commands.add("world_move", self._move, name, way, way, way, one_of(AXES), turn)
        sizes = numbers(3, MIN_SIZE_MM, MAX_SIZE_MM)
        place = numbers(3, -MAX_PLACE_MM, MAX_PLACE_MM)
        commands.add("world_add", self._add, name, one_of(SHAPES), sizes, place)
        commands.add("world_remove", world.remove, name)

    def _move(self, name: str, x: float, y: float, z: float, axis: str, turn_deg: float) -> None:
        vector = np.radians(turn_deg) * np.eye(3)[AXES.index(axis)]
        frame = self._world.frame
        turn = Transform.from_rotation_vector(vector, np.zeros(3), target=frame, source=frame)
        self._world.move(name, np.array([x, y, z]), turn.rotation)

    def _add(self, name: str, shape: str, sizes: Sequence[float], place: Sequence[float]) -> None:
        """Add a box with edges ``sizes``, or a ball with the first as its diameter, in mm."""
        checked_name(name)
        vertices, faces = box(sizes) if shape == "box" else sphere(sizes[0] / 2.0)
        mesh = SurfaceMesh(name, vertices, faces.astype(np.int32))
        self._world.add(mesh, placed(self._world, name, np.array(place)))
