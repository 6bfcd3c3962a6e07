"""A recording as poses over time, edge by edge: the input of Slicer sequences."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from decimal import Decimal

from slicer import vtkMRMLLinearTransformNode

from app.geometry import (
    NS_PER_S,
    TrackedTransform,
    TrackingStatus,
    Transform,
    join_transform_name,
    poses_in,
)
from app.scene.errors import SceneError
from app.scene.scene import MarginGuardScene

MAX_POSES = 200_000
"""Limit of all sequences together. MRML creates a node for each pose, also on loading."""

SAME_INDEX_S = 1e-9
"""Times of a sequence that are no further apart are one time."""


@dataclass(slots=True)
class Track:
    """Poses and lost samples of one edge by stamp in ns; ``node`` shows it, None if none does."""

    derived: bool
    node: vtkMRMLLinearTransformNode | None
    poses: dict[int, Transform] = field(default_factory=dict)
    lost: dict[int, TrackingStatus] = field(default_factory=dict)


def tracks_of(
    scene: MarginGuardScene, frames: Iterable[Sequence[TrackedTransform]]
) -> dict[str, Track]:
    """Tracks by name: each edge with a good sample, and each pose that a node of ``scene`` shows.

    Raises `SceneError` if stamps do not increase, and for more than `MAX_POSES` poses.
    """
    measured: dict[str, Track] = {}
    derived: dict[str, Track] = {}
    first_ns = last_ns = None
    for samples in frames:
        if not samples:
            continue
        ns = samples[0].stamp.ns
        first_ns = ns if first_ns is None else first_ns
        if last_ns is not None and ns / NS_PER_S - last_ns / NS_PER_S <= SAME_INDEX_S:
            raise SceneError(
                f"recording: a frame at {index_text(ns)} s comes after one at "
                f"{index_text(last_ns)} s; expected increasing times, at least 1 ns apart"
            )
        last_ns = ns
        for sample in samples:
            track = _track(measured, scene, sample.target, sample.source)
            if sample.transform is None:
                track.lost[ns] = sample.status
            else:
                track.poses[ns] = sample.transform
        known = [sample.transform for sample in samples if sample.transform is not None]
        for frame, pose in poses_in(scene.reference, known).items():
            if frame != scene.reference and scene.tree.node(frame) is not None:
                _track(derived, scene, scene.reference, frame, derived=True).poses[ns] = pose
        if sum(len(track.poses) for track in (*measured.values(), *derived.values())) > MAX_POSES:
            raise SceneError(
                f"recording: more than {MAX_POSES} poses after {index_text(ns - first_ns)} s; "
                f"expected at most {MAX_POSES}, because a scene takes 9 kB for each"
            )
    # A measured edge that the node shows replaces the derived track of that name.
    return derived | {name: track for name, track in measured.items() if track.poses}


def _track(
    tracks: dict[str, Track],
    scene: MarginGuardScene,
    target: str,
    source: str,
    *,
    derived: bool = False,
) -> Track:
    name = join_transform_name(source, target)
    if name not in tracks:
        node = scene.tree.node(source)
        shown = node is not None and node.GetName() == name
        tracks[name] = Track(derived, node if shown else None)
    return tracks[name]


def index_text(ns: int) -> str:
    """Nanoseconds as decimal seconds, exactly."""
    return f"{Decimal(ns).scaleb(-9):f}"
