"""Recorded poses that another node plays on the graph of a live session."""

from collections.abc import Callable
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

    def checked(self, frame: TrackingFrame, playback: str) -> TrackingFrame:
        """``frame``, or a frame without poses and joints if ``playback`` is not accepted."""
        if self.accepted or not playback:
            return frame
        poses = tuple(
            TrackedTransform.lost(each.target, each.source, each.stamp, TrackingStatus.INVALID)
            for each in frame.poses
        )
        return replace(frame, poses=poses, joints=())

    def problem(self, playback: str) -> str:
        """Why no sample is used; empty if they are."""
        if self.accepted or not playback:
            return ""
        return f"PLAYBACK refused: {playback}; expected provenance.kind 'simulated' in live.yaml"


NO_PLAYBACK = PlaybackRule()
"""For a source that no recording can be played on."""
