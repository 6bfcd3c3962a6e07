"""Commands of an operator to a session, each declared once with its arguments.

The service of a live node, the page, the panel and the Python API send and carry out these
commands and no others. To add one: declare it here, with its kind in `RequestKind` and its rate in
`ADMITTED`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar

from app.case import DISPLAY_ITEMS, DisplayItem, ItemKind
from app.geometry import InputError, SurfaceMesh, Transform
from app.hold import SeenHold, tip_change_text
from app.registration import RegistrationResult
from app.runtime.content import StructureContent
from app.runtime.display_items import other_depth
from app.runtime.requests import OperatorRequest, RequestKind
from app.session.structure import role_of

if TYPE_CHECKING:
    from app.runtime.case_recorder import RecordingStatus
    from app.runtime.commands import OperatorCommands
    from app.runtime.content import SessionContent

_Value = TypeVar("_Value")

_MAX_NOTE = 400
"""Characters of a note with its step and stamp."""


class OperatorCommand(Protocol):
    """A command with its arguments. ``loosens``: it can permit what was not permitted before."""

    kind: ClassVar[str]
    loosens: ClassVar[bool]

    def apply(self, commands: "OperatorCommands", origin: str) -> str:
        """Carry it out; return the new id that it gives, empty without one.

        Raises `MarginGuardError` where it is refused; nothing has changed then.
        """


class Operator(Protocol):
    """Access of a display to a session: it reads the session's state, and requests changes of it.

    One of a session in this process knows who asks; one of a live node is another process, of
    which the node knows. Thread-safe.
    """

    @property
    def content(self) -> "SessionContent":
        """The content in use."""

    @property
    def recording(self) -> "RecordingStatus | None":
        """State of the last recording of the session; None before the first."""

    @property
    def last_request(self) -> OperatorRequest | None:
        """The request that the session has listed last; None before any."""

    def seen(self) -> SeenHold:
        """Identifies the hold of the step that came last, to be displayed with it."""

    def request(self, command: OperatorCommand) -> str:
        """Wait until ``command`` is carried out; return as `OperatorCommand.apply`.

        Raises `MarginGuardError` where it is refused, or not known to be carried out.
        """

    def compute(self, function: Callable[..., _Value], /, *args: Any) -> _Value:
        """Return ``function(*args)``, computed where it delays neither session nor display."""


@dataclass(frozen=True, slots=True)
class Rearm:
    """End the hold that the operator has seen. See `OperatorCommands.rearm`."""

    kind: ClassVar[str] = RequestKind.REARM
    loosens: ClassVar = True
    seq: int
    nonce: int

    def apply(self, commands: "OperatorCommands", origin: str) -> str:
        """End the hold."""
        commands.rearm(SeenHold(self.seq, self.nonce), origin=origin)
        return ""


@dataclass(frozen=True, slots=True)
class SetMargins:
    """Use these distances in mm; looser ones wait for a re-arm."""

    kind: ClassVar[str] = RequestKind.MARGINS
    loosens: ClassVar = True
    stop_mm: float
    warn_mm: float

    def apply(self, commands: "OperatorCommands", origin: str) -> str:
        """Change both, where they are kept."""
        commands.use_margins(self.stop_mm, self.warn_mm, origin)
        return ""


@dataclass(frozen=True, slots=True, eq=False)
class SetTumor:
    """Use this tumour. See `OperatorCommands.set_tumor`."""

    kind: ClassVar[str] = RequestKind.TUMOR
    loosens: ClassVar = True
    frame_from_tumor: Transform
    tumor: SurfaceMesh
    sigma_mm: float = 0.0

    def apply(self, commands: "OperatorCommands", origin: str) -> str:
        """Replace the tumour; returns its ``model_id``."""
        return commands.set_tumor(
            self.frame_from_tumor, self.tumor, sigma_mm=self.sigma_mm, origin=origin
        )


@dataclass(frozen=True, slots=True, eq=False)
class SetStructure:
    """Guard a structure beside the tumour. See `OperatorCommands.set_structure`.

    The frame of ``surface`` is its name. ``role``: "target" or "forbidden"; raises `InputError` for
    another one.
    """

    kind: ClassVar[str] = RequestKind.STRUCTURE
    loosens: ClassVar = True
    frame_from_structure: Transform
    surface: SurfaceMesh
    role: str
    stop_mm: float
    warn_mm: float
    sigma_mm: float = 0.0

    def __post_init__(self) -> None:
        role_of(self.role)

    def apply(self, commands: "OperatorCommands", origin: str) -> str:
        """Add or replace it; returns the new ``setup_id``."""
        values = self.stop_mm, self.warn_mm, self.sigma_mm
        structure = StructureContent(self.surface, role_of(self.role), *values)
        return commands.set_structure(structure, self.frame_from_structure, origin=origin)


@dataclass(frozen=True, slots=True)
class SwitchStructure:
    """Guard a structure no more, or again. See `OperatorCommands.switch_structure`."""

    kind: ClassVar[str] = RequestKind.SWITCH
    loosens: ClassVar = True
    name: str
    on: bool
    reason: str = ""

    def apply(self, commands: "OperatorCommands", origin: str) -> str:
        """Switch it; returns the new ``setup_id``."""
        return commands.switch_structure(self.name, on=self.on, reason=self.reason, origin=origin)


@dataclass(frozen=True, slots=True, eq=False)
class SetRegistration:
    """Use this registration of the robot's base. See `OperatorCommands.set_registration`."""

    kind: ClassVar[str] = RequestKind.REGISTRATION
    loosens: ClassVar = True
    registration: RegistrationResult

    def apply(self, commands: "OperatorCommands", origin: str) -> str:
        """Replace the registration; returns its ``registration_id``."""
        return commands.set_registration(self.registration, origin=origin)


@dataclass(frozen=True, slots=True, eq=False)
class SetTip:
    """Use this calibrated tip of the tool. See `OperatorCommands.set_tip`."""

    kind: ClassVar[str] = RequestKind.TIP
    loosens: ClassVar = True
    tool_from_tip: Transform
    sigma_mm: float = 0.0

    def apply(self, commands: "OperatorCommands", origin: str) -> str:
        """Replace the tip."""
        commands.set_tip(self.tool_from_tip, sigma_mm=self.sigma_mm, origin=origin)
        return ""


@dataclass(frozen=True, slots=True)
class LengthenItem:
    """Show the rod ``item``, a display item, longer by ``by_mm``."""

    kind: ClassVar[str]
    loosens: ClassVar = False
    item: ClassVar[str]
    by_mm: float

    def apply(self, commands: "OperatorCommands", origin: str) -> str:
        """Change what is shown; refused without the item and for a length out of range."""

        def change(content: "SessionContent") -> "tuple[SessionContent, str]":
            known = content.item(self.item)
            item = known.with_length(known.length_mm + self.by_mm)
            return content.with_item(item), f"from {known.length_mm:g} to {item.length_mm:g} mm"

        commands.change_shown(self.kind, change, origin=origin)
        return ""


@dataclass(frozen=True, slots=True, eq=False)
class SetItemTip:
    """Use this calibrated tip of the pointer ``item``, a display item."""

    kind: ClassVar[str]
    loosens: ClassVar = False
    item: ClassVar[str]
    frame_from_tip: Transform
    sigma_mm: float = 0.0

    def apply(self, commands: "OperatorCommands", origin: str) -> str:
        """Change what is shown; refused without the item, and as `ShownItem.with_tip`."""

        def change(content: "SessionContent") -> "tuple[SessionContent, str]":
            known = content.item(self.item)
            item, before = known.with_tip(self.frame_from_tip, self.sigma_mm), known.frame_from_tip
            text = "the first tip" if before is None else tip_change_text(before, item.tip)
            return content.with_item(item), f"{text}, sigma {self.sigma_mm:.2f} mm"

        commands.change_shown(self.kind, change, origin=origin)
        return ""


def _item_command(item: DisplayItem) -> Any:
    """The class of the command that changes the tip of ``item``."""
    is_rod = item.kind is ItemKind.ROD
    base: type = LengthenItem if is_rod else SetItemTip
    name = f"Lengthen{item.title}" if is_rod else f"Set{item.title}Tip"
    values = {"kind": item.command, "item": item.name, "__slots__": (), "__doc__": base.__doc__}
    return type(name, (base,), values)


ITEM_COMMANDS: dict[str, Any] = {each.name: _item_command(each) for each in DISPLAY_ITEMS}
"""The command of each display item by its name: a subclass of `LengthenItem` or `SetItemTip`."""


@dataclass(frozen=True, slots=True)
class ChooseDepth:
    """Place images from now on by the calibration of ``depth_mm``."""

    kind: ClassVar[str] = RequestKind.DEPTH
    loosens: ClassVar = False
    depth_mm: float

    def apply(self, commands: "OperatorCommands", origin: str) -> str:
        """Change what is shown."""
        commands.change_shown(self.kind, other_depth(self.depth_mm), origin=origin)
        return ""


@dataclass(frozen=True, slots=True)
class Record:
    """Start a recording called ``name``, or by date; or finish the one that runs."""

    kind: ClassVar[str] = RequestKind.RECORD
    loosens: ClassVar = False
    start: bool
    name: str = ""

    def apply(self, commands: "OperatorCommands", origin: str) -> str:
        """Start or finish; returns a line on the recording."""
        if self.start:
            return commands.start_recording(self.name, origin=origin).line
        return commands.stop_recording(origin=origin).line


@dataclass(frozen=True, slots=True)
class AddNote:
    """List a note on the present; it changes nothing."""

    kind: ClassVar[str] = RequestKind.NOTE
    loosens: ClassVar = False
    text: str

    def apply(self, commands: "OperatorCommands", origin: str) -> str:
        """List it. Raises `InputError` for a long text."""
        if len(self.text) > _MAX_NOTE:
            problem = f"note: {len(self.text)} characters; expected at most {_MAX_NOTE}"
            commands.requests.refused(self.kind, origin, problem)
            raise InputError(problem)
        commands.requests.accepted(self.kind, origin, self.text)
        return ""


COMMANDS: dict[str, type[OperatorCommand]] = {
    each.kind: each
    for each in (
        *(Rearm, SetMargins, SetTumor, SetStructure, SwitchStructure, SetRegistration, SetTip),
        *(*ITEM_COMMANDS.values(), ChooseDepth, Record, AddNote),
    )
}
"""Every command by its kind."""


class LocalOperator:
    """`Operator` of a session in this process. ``origin`` is the display that asks."""

    def __init__(self, commands: "OperatorCommands", origin: str) -> None:
        self._commands, self._origin = commands, origin

    @property
    def content(self) -> "SessionContent":
        """The content in use."""
        return self._commands.content

    @property
    def recording(self) -> "RecordingStatus | None":
        """State of the last recording; None before the first."""
        return self._commands.recording

    @property
    def last_request(self) -> OperatorRequest | None:
        """The request that was listed last."""
        return self._commands.requests.last

    def seen(self) -> SeenHold:
        """The hold of the last step."""
        return self._commands.seen()

    def request(self, command: OperatorCommand) -> str:
        """Carry ``command`` out."""
        return command.apply(self._commands, self._origin)

    def compute(self, function: Callable[..., _Value], /, *args: Any) -> _Value:
        """Return ``function(*args)``."""
        return self._commands.compute(function, *args)
