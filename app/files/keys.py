"""Declarations of the keys of a YAML document: type, bounds, choices, default, description.

A `Block` declares a mapping. `app.files.document.Section` reads a mapping by its block, and
`app.files.document_text` describes the block as JSON Schema. The end of a key is its unit: ``_mm``.
"""

import difflib
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

_UNITS = {
    "_n_s_m": "N s/m",
    "_kg_m3": "kg/m3",
    "_kg_m2": "kg m2",
    "_kg": "kg",
    "_n_s": "N/s",
    "_mm_s2": "mm/s2",
    "_deg_s2": "degrees/s2",
    "_mm_s": "mm/s",
    "_rad_s": "rad/s",
    "_deg_s": "degrees/s",
    "_deg": "degrees",
    "_mm": "mm",
    "_ms": "ms",
    "_hz": "Hz",
    "_n": "N",
    "_s": "s",
}
"""Ending of a key -> unit; an ending comes after those that contain it at their end."""


def unit_of(name: str) -> str:
    """Return the unit that ends the key ``name``; empty if there is none."""
    return next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), "")


@dataclass(frozen=True, slots=True, eq=False)
class Key:
    """The value of a key. It may be left out if it is ``optional`` or has a ``default``."""

    description: str
    optional: bool = field(default=False, kw_only=True)
    default: bool | float | str | None = field(default=None, kw_only=True)

    @property
    def required(self) -> bool:
        """True if the key must be given."""
        return not self.optional and self.default is None


@dataclass(frozen=True, slots=True, eq=False)
class Text(Key):
    """A text that is not empty and matches ``pattern`` as a whole.

    ``expected`` describes the pattern for the message.
    """

    pattern: re.Pattern[str] | None = None
    expected: str = "a text"


@dataclass(frozen=True, slots=True, eq=False)
class Frame(Key):
    """The name of a frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Choice(Key):
    """One of the texts ``options``."""

    options: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Boolean(Key):
    """``true`` or ``false``."""


@dataclass(frozen=True, slots=True, eq=False)
class Integer(Key):
    """An integer from ``minimum`` to ``maximum``."""

    minimum: int
    maximum: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Number(Key):
    """A finite number of at least ``minimum``, more than ``above`` and at most ``maximum``."""

    minimum: float = -math.inf
    above: float = -math.inf
    maximum: float = math.inf


@dataclass(frozen=True, slots=True, eq=False)
class Numbers(Key):
    """A list of ``count`` finite numbers."""

    count: int


@dataclass(frozen=True, slots=True, eq=False)
class ListOf(Key):
    """A list of values that ``items`` describes.

    ``if_empty`` ends the message that refuses an empty list; without it the list may be empty.
    """

    items: Key
    if_empty: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Texts(Key):
    """A mapping of names of the user's choice, which match ``name`` as a whole, to texts.

    With ``plain_values`` a number, true or false may be given as well and is read as its text.
    """

    name: re.Pattern[str]
    name_expected: str
    plain_values: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Variant:
    """One of the combinations of optional keys that a block allows, for `Block.variants`.

    ``required`` must be given, ``optional`` may be. ``where`` selects the variant: JSON Schema of
    the values of other keys.
    """

    name: str
    required: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    where: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Block(Key):
    """A mapping with these ``keys`` and no others.

    With ``variants`` an optional key without a default is allowed only in those that name it, and
    exactly one variant applies. ``needs``: a key, and the other one that must be given with it.
    ``rules`` are checked by the readers of the block and cannot be stated in JSON Schema.
    ``old_names``: former name of an optional key -> key; it is still read, with a note.
    ``replaced``: former key -> text of what stands for it; it is refused with that text.
    ``read`` makes the value of a mapping of this block from its `Section`.
    """

    keys: Mapping[str, Key]
    variants: tuple[Variant, ...] = ()
    needs: tuple[tuple[str, str], ...] = ()
    rules: tuple[str, ...] = ()
    old_names: Mapping[str, str] = field(default_factory=dict)
    replaced: Mapping[str, str] = field(default_factory=dict)
    read: Callable[[Any], Any] | None = None

    def others_than(self, variant: Variant) -> list[str]:
        """The keys that belong to other variants only."""
        named = (*variant.required, *variant.optional)
        return [
            name
            for name, key in self.keys.items()
            if not (key.required or key.default is not None or name in named)
        ]


ROBOT_FILE = Text(".urdf, .xacro or AMBF .yaml, relative, absolute or package://NAME/...")

XACRO_ARGS = Texts(
    "values of the arguments of a .xacro, by name",
    re.compile(r"[^\W\d]\w*"),
    "the name of a xacro argument",
    plain_values=True,
    optional=True,
)


def did_you_mean(word: object, known: Iterable[str]) -> str:
    """Text ``; did you mean 'stop_mm'?`` for the most similar known word; empty without one."""
    similar = difflib.get_close_matches(str(word), list(known), n=1)
    return f"; did you mean {similar[0]!r}?" if similar else ""
