"""What a recording or a live source yields: one tracker frame after the other."""

from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray, InputError, Stamp, TrackedTransform


@dataclass(frozen=True, slots=True, eq=False)
class JointSample:
    """Positions (n,) of the joints ``names``, in rad, in m for sliding joints as in ROS."""

    names: tuple[str, ...]
    positions: FloatArray
    stamp: Stamp

    def __post_init__(self) -> None:
        positions = np.array(self.positions, dtype=np.float64)
        if positions.shape != (len(self.names),):
            raise InputError(
                f"joint sample has {len(self.names)} names and positions of shape "
                f"{positions.shape}: one position a name wanted"
            )
        positions.setflags(write=False)
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "positions", positions)

    def as_mapping(self) -> dict[str, float]:
        """Name to position, as the robot's kinematics take them."""
        return dict(zip(self.names, self.positions.tolist(), strict=True))


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
