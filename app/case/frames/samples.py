"""What a recording or a live source yields: one tracker frame after the other."""

from dataclasses import dataclass

from app.geometry import InputError, Stamp, TrackedTransform, slot_setters


@dataclass(frozen=True, slots=True, eq=False)
class JointSample:
    """A position for each of the joints ``names``, in rad, in m for sliding joints as in ROS.

    Plain numbers: hundreds of samples come in a second, and few of them are looked at.
    """

    names: tuple[str, ...]
    positions: tuple[float, ...]
    stamp: Stamp

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "positions", tuple(map(float, self.positions)))
        if len(self.positions) != len(self.names):
            raise InputError(
                f"joint sample has {len(self.names)} names and {len(self.positions)} positions: "
                "one position a name wanted"
            )
        if len(set(self.names)) != len(self.names):
            twice = next(name for name in self.names if self.names.count(name) > 1)
            raise InputError(f"joint {twice!r} is named twice in a joint sample: once wanted")

    @classmethod
    def unchecked(
        cls, names: tuple[str, ...], positions: tuple[float, ...], stamp: Stamp
    ) -> "JointSample":
        """From tuples of one length, of names that are not repeated and of floats: not checked."""
        made = object.__new__(cls)
        _set_names(made, names)
        _set_positions(made, positions)
        _set_stamp(made, stamp)
        return made

    def as_mapping(self) -> dict[str, float]:
        """Name to position, as the robot's kinematics take them."""
        return dict(zip(self.names, self.positions, strict=True))


_set_names, _set_positions, _set_stamp = slot_setters(JointSample)


@dataclass(frozen=True, slots=True, eq=False)
class TrackingFrame:
    """All samples that the tracker acquired at ``stamp``, and the joints read since the last frame.

    ``poses`` holds one sample an edge, whatever its status. A frame without any pose is a
    watchdog frame: the source fell silent and time went on. ``unfiltered_stamp`` is the second
    clock of an IGSIO recording, before its smoothing.
    """

    stamp: Stamp
    poses: tuple[TrackedTransform, ...]
    joints: tuple[JointSample, ...] = ()
    unfiltered_stamp: Stamp | None = None
