"""An obstacle that an operator uploads: an STL file becomes a body of a simulated world."""

import asyncio
import re
import tempfile
from pathlib import Path

import numpy as np
from aiohttp import web

from app.files.meshes import load_mesh
from app.geometry import FloatArray, InputError, MarginGuardError, SurfaceMesh, Transform
from app.runtime import MAX_BODY_TRIANGLES, SimulatedWorld
from app.viewer.access.auth import ROLE
from app.viewer.access.role import Role

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
            return _refusal(InputError(f"upload: longer than {_UPLOAD_S:g} s; expected less"))
        except MarginGuardError as error:
            return _refusal(error)
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


def _refusal(error: Exception) -> web.Response:
    return web.json_response({"problem": " ".join(str(error).split())}, status=409)
