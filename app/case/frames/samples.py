"""Tracker frames and joint samples, as recordings and live sources yield them."""

from dataclasses import dataclass

from app.case.frames.cautery import CauteryState
from app.geometry import InputError, Stamp, TrackedTransform, slot_setters


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
    IGSIO recording, before its smoothing. ``cautery``: None without a source of its state.
    """

    stamp: Stamp
    poses: tuple[TrackedTransform, ...]
    joints: tuple[JointSample, ...] = ()
    unfiltered_stamp: Stamp | None = None
    cautery: CauteryState | None = None
