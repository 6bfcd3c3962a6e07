"""Contents and commands of a session as text, for another process: JSON, and meshes by digest.

Numbers are written so that they are read back exactly; NaN and infinities are written as Python's
``json`` does. Nothing that is read can run code. What does not fit raises `InputError`.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

from app.files.plain_values import plain_converter
from app.geometry import InputError, MarginGuardError, SurfaceMesh, Transform
from app.registration import DriftBound, RegistrationResult
from app.robot import Robot, load_robot
from app.runtime.content import SessionContent, surface_digest
from app.runtime.display_items import ImageDescription, ShownItem
from app.runtime.operator_command import COMMANDS, OperatorCommand
from app.runtime.requests import KINDS
from app.session import RobotSetup

VERSION = 3
"""Version of the texts; another one is refused."""

_MAX_KNOWN = 256

_Value = TypeVar("_Value")


@dataclass(frozen=True, slots=True, eq=False)
class DescribedSession:
    """Description of a session, which a display needs before it can show a step of it.

    ``displays``: full names of the nodes of displays that the session was started for. ``host``:
    the machine that it runs on, by `app.runtime.host_id`.
    """

    content: SessionContent
    images: ImageDescription | None = None
    displays: tuple[str, ...] = ()
    host: str = ""


class SessionWire:
    """Writes and reads descriptions and commands. ``meshes`` holds their surfaces by digest.

    Before something with a mesh is read, `missing` names the digests to be added to ``meshes``.
    The robot's file is read where the description is: its path must lead to the same file.
    """

    def __init__(self) -> None:
        self.meshes: dict[str, SurfaceMesh] = {}
        self._robots: dict[object, Robot] = {}
        self._known: dict[object, Any] = {}
        """Values read before, by their text: an unchanged value stays the same object."""
        self._converter = plain_converter()
        self._converter.register_unstructure_hook(SurfaceMesh, self._put_mesh)
        self._converter.register_structure_hook(SurfaceMesh, self._mesh)
        for kind in (Transform, ShownItem, RegistrationResult):
            self._remember(kind, self._converter.get_structure_hook(kind))

    def text(self, value: object) -> str:
        """``value`` as text: a plain dataclass without a robot."""
        return json.dumps(self._converter.unstructure(value))

    def value(self, kind: type[_Value], text: str) -> _Value:
        """Read a ``kind`` from `text`."""
        return self._structured(kind, _loaded(text))

    def description(self, session: DescribedSession) -> str:
        """Write ``session``; puts its surfaces into ``meshes``."""
        content = session.content
        robot = content.robot
        written = self._converter.unstructure(
            replace(session, content=replace(content, robot=None))
        )
        if robot is not None:
            values = _RobotValues(*(getattr(robot, each.name) for each in fields(_RobotValues)))
            written["content"]["robot"] = self._converter.unstructure(values)
        return json.dumps({"version": VERSION, **written})

    def missing(self, text: str) -> set[str]:
        """Digests of the surfaces that `described` needs and that are not in ``meshes``."""
        return {digest for digest in _digests(_loaded(text)) if digest not in self.meshes}

    def keep(self, text: str) -> None:
        """Forget the surfaces that the description ``text`` does not name."""
        named = _digests(_loaded(text))
        self.meshes = {digest: mesh for digest, mesh in self.meshes.items() if digest in named}

    def described(self, text: str) -> DescribedSession:
        """Read `description`. The robot is loaded anew if its file is another one."""
        written = _loaded(text)
        if not isinstance(written, dict) or written.pop("version", None) != VERSION:
            raise InputError(
                f"description of a session: not of version {VERSION}; expected a MarginGuard of "
                "the same version on both sides"
            )
        content = written.get("content")
        robot = content.pop("robot", None) if isinstance(content, dict) else None
        session = self._structured(DescribedSession, written)
        if robot is None:
            return session
        values = self._structured(_RobotValues, robot)
        given = {each.name: getattr(values, each.name) for each in fields(values)}
        loaded = self._loaded_robot(session.content)
        key = id(loaded), json.dumps(robot)
        if key not in self._known:
            self._known[key] = RobotSetup(robot=loaded, **given)
        return replace(session, content=replace(session.content, robot=self._known[key]))

    def command(self, command: OperatorCommand) -> str:
        """Write the arguments of ``command``; puts its surface into ``meshes``."""
        return json.dumps(self._converter.unstructure(command))

    def read_command(self, kind: str, text: str) -> OperatorCommand:
        """The command ``kind`` with the arguments of `command`."""
        return self._structured(COMMANDS[command_kind(kind)], _loaded(text))

    def _loaded_robot(self, content: SessionContent) -> Robot:
        if content.robot_file is None:
            raise InputError("description of a session: a robot without a file; expected one")
        key = content.robot_file, content.package_dirs, tuple(content.xacro_args.items())
        if key not in self._robots:
            robot = load_robot(
                content.robot_file,
                package_dirs=content.package_dirs,
                xacro_args=content.xacro_args,
                require_meshes=False,  # a display checks no collision
            )
            self._robots = {key: robot}
        return self._robots[key]

    def _remember(self, kind: type, structure: Callable[[Any, Any], Any]) -> None:
        def known(value: Any, _: object) -> Any:
            key = kind, json.dumps(value)
            if key not in self._known:
                if len(self._known) >= _MAX_KNOWN:
                    self._known.clear()
                self._known[key] = structure(value, kind)
            return self._known[key]

        self._converter.register_structure_hook(kind, known)

    def _structured(self, kind: type[_Value], value: object) -> _Value:
        try:
            return self._converter.structure(value, kind)
        except MarginGuardError:
            raise
        except Exception as error:  # cattrs has many types for what does not fit
            raise InputError(
                f"{kind.__name__}: {type(error).__name__}: {' '.join(str(error).split())[:200]}; "
                "expected its arguments"
            ) from error

    def _put_mesh(self, mesh: SurfaceMesh) -> dict[str, str]:
        digest = mesh_digest(mesh)
        self.meshes[digest] = mesh
        return {"mesh": digest}

    def _mesh(self, value: Any, _: object) -> SurfaceMesh:
        digest = value["mesh"]
        if digest not in self.meshes:
            raise InputError(f"mesh {str(digest)[:40]}: not sent; expected it with what names it")
        return self.meshes[digest]


def command_kind(name: str) -> str:
    """``name`` if it is a kind of request. Raises `InputError` for another name."""
    if name not in KINDS:
        raise InputError(f"command: {name[:40]!r}; expected one of {', '.join(KINDS)}")
    return name


def mesh_digest(mesh: SurfaceMesh) -> str:
    """Identifies a surface in its frame."""
    return f"{mesh.frame}/{surface_digest(mesh)}"


def text_digest(text: str) -> str:
    """Identifies a description."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True, slots=True, eq=False)
class _RobotValues:
    """A `RobotSetup` without the robot itself."""

    base_frame: str
    tool_link: str
    registration: RegistrationResult | None
    max_drift: DriftBound
    link_from_tip: Transform | None
    follows_tool: bool


def _loaded(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"text of a session: {error}; expected JSON") from error


def _digests(value: Any) -> set[str]:
    if isinstance(value, Mapping):
        found = {str(value["mesh"])} if set(value) == {"mesh"} else set()
        return found.union(*(_digests(each) for each in value.values()))
    return set().union(*(_digests(each) for each in value)) if isinstance(value, list) else set()
