"""Detect transforms of other nodes that contradict the static transforms of a live session."""

from collections.abc import Collection, Iterator, Mapping
from typing import NamedTuple

from app.bridge.message_origin import Origin
from app.bridge.sender_names import SenderNames
from app.case.messages.message_values import PoseValues
from app.geometry import MarginGuardError, Transform
from app.session import SILENT_NS, has_ended

MAX_DISTANCE_MM = 0.01
MAX_ANGLE_RAD = 1e-4
"""Largest difference of a transform that repeats one of the session."""

MAX_EDGES = 256
"""Transforms of other nodes that are remembered, besides those of the session's own frames."""


class _Foreign(NamedTuple):
    """Latest transform of a child frame by another sender; ``latched`` if it is static."""

    parent: str
    transform: Transform | None
    latched: bool
    heard_ns: int


class StaticWatch:
    """Compares the transforms that other nodes publish with the session's own static ones.

    Another node contradicts the session if it places one of the session's static frames elsewhere
    (another parent or another pose), on ``/tf_static`` or ``/tf``, or if it gives a measured frame
    a static transform. A static one is valid as long as its publisher exists: it is remembered also
    while it repeats the session's own, which another registration may change. The session never
    uses such a transform, but every other node on the graph may do so. Not thread-safe; times are
    monotonic.
    """

    def __init__(self, moving: SenderNames, static: SenderNames) -> None:
        self._names = {False: moving, True: static}
        self._foreign: dict[tuple[bytes | None, str], _Foreign] = {}

    def observe(
        self,
        pose: PoseValues,
        origin: Origin,
        own: Mapping[str, Transform],
        now_ns: int,
        *,
        latched: bool,
    ) -> bool:
        """Process a transform; True if it contradicts ``own`` (static transforms by child)."""
        sender, child = origin.sender, pose.source
        if self._names[latched].is_own(sender) or not (latched or child in own):
            return False
        key = (sender, child)
        if child not in own and key not in self._foreign and len(self._foreign) >= MAX_EDGES:
            return False
        try:
            transform = pose.sample().transform
        except MarginGuardError:  # names that cannot be frames; the reader counts them
            return False
        self._foreign[key] = _Foreign(pose.target, transform, latched, now_ns)
        return _contradicts(self._foreign[key], own.get(child))

    def problems(
        self, own: Mapping[str, Transform], measured: Collection[str], now_ns: int
    ) -> Iterator[str]:
        """One line for each contradiction to ``own`` or to the ``measured`` child frames."""
        for (sender, child), found in self._foreign.items():
            if _contradicts(found, own.get(child)) or (child in measured and child not in own):
                names = self._names[found.latched]
                expected = (
                    f"{own[child].target} -> {child} of this session alone"
                    if child in own
                    else "no static transform of a measured frame"
                )
                yield (
                    f"second sender of {found.parent} -> {child} on {names.topic}, "
                    f"{names.text([sender])}: it contradicts the session; expected {expected}"
                )

    def remove_ended(self, own: Mapping[str, Transform], now_ns: int) -> bool:
        """Remove the transforms whose sender has ended; True if one contradicts ``own``."""
        ended = {
            key: found
            for key, found in self._foreign.items()
            if self._has_ended(key[0], found, now_ns)
        }
        for key in ended:
            del self._foreign[key]
        return any(_contradicts(found, own.get(child)) for (_, child), found in ended.items())

    def _has_ended(self, sender: bytes | None, found: _Foreign, now_ns: int) -> bool:
        is_present = self._names[found.latched].is_present
        if found.latched:  # silent by nature
            return now_ns - found.heard_ns >= SILENT_NS and not is_present(sender)
        return has_ended(sender, found.heard_ns, now_ns, is_present)


def _contradicts(found: _Foreign, own: Transform | None) -> bool:
    """True if ``own``, the session's transform of that frame, exists and is another one."""
    if own is None:
        return False
    transform = found.transform
    if transform is None or found.parent != own.target:
        return True
    repeats = (
        transform.distance_mm_to(own) <= MAX_DISTANCE_MM
        and transform.angle_to(own) <= MAX_ANGLE_RAD
    )
    return not repeats
