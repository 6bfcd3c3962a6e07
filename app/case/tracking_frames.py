"""Tracker frames, joint samples and activations, as recordings and live sources yield them."""

from dataclasses import dataclass
from enum import StrEnum

from app.geometry import (
    Freshness,
    FreshnessLimits,
    InputError,
    Stamp,
    TrackedTransform,
    freshness_of,
    slot_setters,
)


class Activation(StrEnum):
    """Known state of the energy device; a higher rank prevails in a summary of several moments."""

    OFF = "off"
    UNKNOWN = "unknown"
    ON = "on"

    @property
    def label(self) -> str:
        """Capitals, for displays."""
        return self.value.upper()

    @property
    def symbol(self) -> str:
        """A sign that differs without colour."""
        return {"off": "\N{WHITE CIRCLE}", "unknown": "?", "on": "\N{BLACK CIRCLE}"}[self.value]

    @property
    def rank(self) -> int:
        """Position among the states."""
        return list(Activation).index(self)


class ActivationTrail:
    """Last report of the energy device, on any clock in ns. Not older than ``stale_after_ns``.

    A source that has said nothing, or too long ago, leaves the state unknown: never off.
    """

    def __init__(self, stale_after_ns: int) -> None:
        self._limits = FreshnessLimits(stale_after_ns, future_tolerance_ns=stale_after_ns)
        self._last: tuple[int, bool] | None = None

    def hear(self, on: bool, at_ns: int) -> None:
        """Take what the source says at ``at_ns``; from any thread."""
        self._last = at_ns, on

    def forget(self) -> None:
        """Take that the source cannot be understood; from any thread."""
        self._last = None

    def at(self, now_ns: int) -> Activation:
        """The state at ``now_ns``."""
        last = self._last
        if last is None or freshness_of(last[0], now_ns, self._limits) is not Freshness.VALID:
            return Activation.UNKNOWN
        return Activation.ON if last[1] else Activation.OFF


@dataclass(frozen=True, slots=True, eq=False)
class JointSample:
    """A position for each of the joints ``names``, in rad, or in m for prismatic joints.

    Plain floats, not an array: hundreds of samples arrive per second, and few of them are used.
    """

    names: tuple[str, ...]
    positions: tuple[float, ...]
    stamp: Stamp

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "positions", tuple(map(float, self.positions)))
        if len(self.positions) != len(self.names):
            raise InputError(
                f"joint sample has {len(self.names)} names and {len(self.positions)} positions; "
                "expected one position per name"
            )
        if len(set(self.names)) != len(self.names):
            twice = next(name for name in self.names if self.names.count(name) > 1)
            raise InputError(f"joint {twice!r} is repeated in a joint sample; expected it once")

    @classmethod
    def unchecked(
        cls, names: tuple[str, ...], positions: tuple[float, ...], stamp: Stamp
    ) -> "JointSample":
        """Without checks: from tuples of one length, of unique names and of floats."""
        made = object.__new__(cls)
        _set_names(made, names)
        _set_positions(made, positions)
        _set_stamp(made, stamp)
        return made

    def as_mapping(self) -> dict[str, float]:
        """Positions by joint name."""
        return dict(zip(self.names, self.positions, strict=True))


_set_names, _set_positions, _set_stamp = slot_setters(JointSample)


@dataclass(frozen=True, slots=True, eq=False)
class TrackingFrame:
    """All samples that the tracker acquired at ``stamp``, and the joints read since the last frame.

    ``poses`` holds one sample per edge, of any status. A frame without poses is a watchdog frame:
    the source sent nothing for too long. ``unfiltered_stamp`` is the time by the second clock of an
    IGSIO recording, before its smoothing. ``activation``: None without a source of its state.
    """

    stamp: Stamp
    poses: tuple[TrackedTransform, ...]
    joints: tuple[JointSample, ...] = ()
    unfiltered_stamp: Stamp | None = None
    activation: Activation | None = None
