"""A measured transform with its acquisition time and status."""

from dataclasses import dataclass
from enum import IntEnum

from app.geometry.errors import FrameError, TransformError
from app.geometry.frames import check_frame
from app.geometry.slots import slot_setters
from app.geometry.stamp import Stamp
from app.geometry.transform import Transform


class TrackingStatus(IntEnum):
    """Status of one sample. Only `OK` samples may be used for navigation.

    Values 0 to 5 are reported by the tracker (IGSIO's ``ToolStatus``). The others are set by a
    reader for a sample that the tracker reported as OK.
    """

    OK = 0
    INVALID = 1
    MISSING = 2
    OUT_OF_VIEW = 3
    OUT_OF_VOLUME = 4
    REQUEST_TIMEOUT = 5
    NOT_FINITE = 6
    NOT_RIGID = 7


@dataclass(frozen=True, slots=True, eq=False)
class TrackedTransform:
    """A sample of ``target_from_source``, acquired at ``stamp``.

    ``transform`` is None exactly if ``status`` is not `TrackingStatus.OK`: a lost pose has no
    numbers that could be used by mistake. ``target`` and ``source`` are known in both cases; with
    a transform they default to its frames. Raises `TransformError` if transform and status
    contradict each other, `FrameError` if the frames do.
    """

    transform: Transform | None
    stamp: Stamp
    status: TrackingStatus
    target: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        if (self.transform is not None) != (self.status is TrackingStatus.OK):
            raise TransformError(
                f"a sample with status {self.status.name} "
                f"{'has a' if self.transform is not None else 'lacks its'} transform; "
                "expected one for status OK only"
            )
        if self.transform is None:
            check_frame(self.target)
            check_frame(self.source)
        elif (self.target, self.source) != (self.transform.target, self.transform.source):
            self._set_frames_of(self.transform)

    def _set_frames_of(self, transform: Transform) -> None:
        for name, given, known in (
            ("target", self.target, transform.target),
            ("source", self.source, transform.source),
        ):
            if given not in ("", known):
                raise FrameError(f"{name} {given!r} contradicts the transform; expected {known!r}")
            object.__setattr__(self, name, known)

    @classmethod
    def valid(cls, transform: Transform, stamp: Stamp) -> "TrackedTransform":
        """A sample with status `TrackingStatus.OK` and the frames of its transform, unchecked."""
        made = object.__new__(cls)
        _set_transform(made, transform)
        _set_stamp(made, stamp)
        _set_status(made, TrackingStatus.OK)
        _set_target(made, transform.target)
        _set_source(made, transform.source)
        return made

    @classmethod
    def lost(
        cls, target: str, source: str, stamp: Stamp, status: TrackingStatus
    ) -> "TrackedTransform":
        """A sample without a transform: the pose of ``source`` in ``target`` is not known."""
        return cls(None, stamp, status, target, source)


_set_transform, _set_stamp, _set_status, _set_target, _set_source = slot_setters(TrackedTransform)
