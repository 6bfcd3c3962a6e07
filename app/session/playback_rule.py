"""Recorded poses that another node plays on the graph of a live session."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

from app.case import TrackingFrame
from app.geometry import TrackedTransform, TrackingStatus


def _none_found() -> str:
    return ""


@dataclass(frozen=True, slots=True)
class PlaybackRule:
    """Whether a live session uses samples while a recording is played on its graph.

    ``found`` returns a description of the playback, empty if there is none. Without
    ``accepted`` every sample counts as `TrackingStatus.INVALID` while there is one, whatever its
    sender is: the state is UNKNOWN and then on hold, and no recorded pose enters the session.
    """

    found: Callable[[], str] = _none_found
    accepted: bool = False

    def refuses(self) -> bool:
        """True while samples must not enter the session. Thread-safe if ``found`` is."""
        return not self.accepted and bool(self.found())

    def checked(
        self, frame: TrackingFrame, playback: str, edges: Collection[tuple[str, str]] = ()
    ) -> TrackingFrame:
        """``frame``, or one without joints whose poses are all lost if ``playback`` is refused.

        ``edges`` (target, source) are lost as well then, whether ``frame`` has samples of them or
        not: the poses from before the playback must not remain in use.
        """
        if self.accepted or not playback:
            return frame
        lost = dict.fromkeys(edges, frame.stamp)
        lost |= {(each.target, each.source): each.stamp for each in frame.poses}
        poses = tuple(
            TrackedTransform.lost(*edge, stamp, TrackingStatus.INVALID)
            for edge, stamp in lost.items()
        )
        return replace(frame, poses=poses, joints=())

    def problem(self, playback: str) -> str:
        """The reason why no sample is used; empty if samples are used."""
        if self.accepted or not playback:
            return ""
        return f"PLAYBACK refused: {playback}; expected provenance.kind 'simulated' in live.yaml"


NO_PLAYBACK = PlaybackRule()
"""For a source that no recording can be played on."""
