"""A measured transform with its acquisition time and what the tracker said of it."""

from dataclasses import dataclass
from enum import IntEnum

from app.geometry.errors import FrameError, TransformError
from app.geometry.frames import check_frame
from app.geometry.slots import setters
from app.geometry.stamp import Stamp
from app.geometry.transform import Transform


class TrackingStatus(IntEnum):
    """What is known of one sample. Only `OK` may be navigated by.

    The first six are a tracker's own words (IGSIO's ``ToolStatus``); the others are found by the
    reader of a sample that the tracker called good.
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

    ``transform`` is None exactly when ``status`` is not `TrackingStatus.OK`: a lost pose has no
    number that could be used by mistake. The frames are known either way.
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
                f"{'has a' if self.transform is not None else 'lacks its'} transform: "
                "OK samples carry one, the others none"
            )
        if self.transform is None:
            check_frame(self.target)
            check_frame(self.source)
        elif (self.target, self.source) != (self.transform.target, self.transform.source):
            self._take_names(self.transform)

    def _take_names(self, transform: Transform) -> None:
        """The transform's own, where none are given; `FrameError` for others."""
        for name, given, known in (
            ("target", self.target, transform.target),
            ("source", self.source, transform.source),
        ):
            if given not in ("", known):
                raise FrameError(f"{name} {given!r} is not the transform's {known!r}")
            object.__setattr__(self, name, known)

    @classmethod
    def good(cls, transform: Transform, stamp: Stamp) -> "TrackedTransform":
        """A sample that may be navigated by, with the frames of its transform."""
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
        """A sample that says the pose of ``source`` in ``target`` is not known."""
        return cls(None, stamp, status, target, source)


_set_transform, _set_stamp, _set_status, _set_target, _set_source = setters(TrackedTransform)
