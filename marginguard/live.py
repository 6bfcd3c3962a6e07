"""A session of a live node: its steps, and what an operator may request of it."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from secrets import token_hex
from typing import TYPE_CHECKING, Any

from app.geometry import InputError
from app.runtime import (
    ITEM_COMMANDS,
    AddNote,
    ChooseDepth,
    LengthenItem,
    OperatorCommand,
    Rearm,
    Record,
    SessionContent,
    SetItemTip,
    SetMargins,
    SetRegistration,
    SetStructure,
    SetTip,
    SetTumor,
    SwitchStructure,
)
from app.session import StepResult
from marginguard.constraints import prepare_ros
from marginguard.values import needs

if TYPE_CHECKING:
    from app.bridge.displays import SessionClient
    from app.bridge.displays.remote_operator import RemoteOperator

__all__ = [
    "AddNote",
    "ChooseDepth",
    "LengthenNeedle",
    "LiveSession",
    "Rearm",
    "Record",
    "SetMargins",
    "SetRegistration",
    "SetStructure",
    "SetStylusTip",
    "SetTip",
    "SetTumor",
    "SwitchStructure",
    "live_session",
]

LengthenNeedle: type[LengthenItem] = ITEM_COMMANDS["needle"]
SetStylusTip: type[SetItemTip] = ITEM_COMMANDS["stylus"]

DEFAULT_NODE = "/marginguard"


class LiveSession:
    """A session in another process, as the page and the panel see it; made by `live_session`.

    `request` takes the commands of displays:

    >>> import marginguard as mg
    >>> tip = mg.Transform.identity("cautery", "cautery_tip")
    >>> stylus = mg.Transform.identity("stylus", "stylus_tip")
    >>> place = mg.Transform.identity("needle", "tumor")
    >>> ball = mg.open_case(mg.example_case()).content.tumor
    >>> wall = mg.SurfaceMesh("wall", ball.vertices_mm, ball.faces)
    >>> beside = mg.Transform.identity("reference", "wall")
    >>> corners = [[0.0, 0.0, 0.0], [50.0, 0.0, 0.0], [0.0, 50.0, 0.0], [0.0, 0.0, 50.0]]
    >>> frames = {"fixed_frame": "reference", "moving_frame": "base"}
    >>> base = mg.register_points(corners, corners, **frames)
    >>> commands = [
    ...     mg.AddNote("first cut"), mg.ChooseDepth(40.0), mg.LengthenNeedle(5.0), mg.Record(True),
    ...     mg.Rearm(seq=4711, nonce=9301742), mg.SetMargins(stop_mm=2.0, warn_mm=6.0),
    ...     mg.SetTip(tip, 0.2), mg.SetStylusTip(stylus, 0.2), mg.SetTumor(place, ball, 0.3),
    ...     mg.SetRegistration(base), mg.SetStructure(beside, wall, "forbidden", 1.0, 4.0),
    ...     mg.SwitchStructure("wall", on=False, reason="not in the field"),
    ... ]
    >>> print(*[command.kind for command in commands[:5]])
    note image_depth needle_length record rearm
    >>> print(*[command.kind for command in commands[5:]])
    set_margins set_tip set_stylus_tip set_tumor register set_structure switch_structure
    """

    def __init__(self, steps: Iterator[StepResult], client: Any) -> None:
        self._steps = steps
        self._client: SessionClient = client

    def steps(self) -> Iterator[StepResult]:
        """Yield each new step. Raises `MarginGuardError` when none arrives in time."""
        return self._steps

    @property
    def content(self) -> SessionContent:
        """Tumour, tool, margins and registration of the last step. `InputError` before one."""
        return self._operator.content

    def request(self, command: OperatorCommand) -> str:
        """Carry ``command`` out and return the answer. Raises `MarginGuardError` if it is refused.

        The audit log names this script's node as its origin.
        """
        return self._operator.request(command)

    def rearm(self) -> str:
        """End the hold that the last step shows, as `request` does."""
        seen = self._operator.seen()
        return self.request(Rearm(seen.seq, seen.nonce))

    @property
    def _operator(self) -> "RemoteOperator":
        if self._client.operator is None:
            raise InputError("live session: no step has come yet; expected one: see `steps`")
        return self._client.operator


@contextmanager
def live_session(
    node: str = DEFAULT_NODE, *, timeout_s: float = 5.0, name: str = ""
) -> Iterator[LiveSession]:
    """Join the session of the live node ``node`` while the ``with`` block runs.

    ``name`` is that of this script's node, as ``operators`` of a ``live.yaml`` lists it; it begins
    with ``marginguard_api``, and is another one for each script without it.

    Its steps end with a `BridgeError` (a `MarginGuardError`) when none arrives for ``timeout_s``.
    A script that takes them too slowly misses some; it never gets an old one as new. Needs the
    extra ``ros``. Raises `InputError` without it.

    >>> import marginguard as mg
    >>> with mg.live_session("/no/such/session", timeout_s=0.1) as session:
    ...     next(session.steps())
    Traceback (most recent call last):
        ...
    app.bridge.ros_errors.BridgeError: /no/such/session: no step in 0.1 s; no live node ... is there
    """
    if not isinstance(node, str):
        raise InputError(f"node: is {node!r}; expected the name of a node as str")
    if isinstance(timeout_s, bool) or not isinstance(timeout_s, int | float) or not timeout_s > 0.0:
        raise InputError(f"timeout_s: is {timeout_s!r}; expected seconds > 0")
    with needs("ROS 2"):
        from app.bridge import BridgeError, RosNode
        from app.bridge.displays import SessionClient
        from app.bridge.displays.remote_operator import API_NODE
    prepare_ros()
    name = name or f"{API_NODE}_{token_hex(3)}"
    if not name.startswith(API_NODE):
        raise InputError(f"name: is {name!r}; expected a name that begins with {API_NODE!r}")

    def waiting(silent_s: float) -> None:
        if silent_s > timeout_s:
            why = f"; {client.silence}" if client.silence else ""
            raise BridgeError(f"{client.node}: no step in {timeout_s:g} s{why}")

    with RosNode(name) as ros:
        client = SessionClient(ros, node, waiting=waiting)
        client.needs_every = lambda: True
        with closing(client), closing(client.steps()) as steps:
            yield LiveSession(steps, client)
