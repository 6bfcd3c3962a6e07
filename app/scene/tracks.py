"""A recording as poses over time, edge by edge: what a sequence is made of."""

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
)
from app.scene.errors import SceneError
from app.scene.frames.frame_graph import poses_in
from app.scene.scene import MarginGuardScene

MOST_ITEMS = 200_000
"""Poses of all sequences together. MRML makes a node of each, and so does who loads the scene."""

SAME_INDEX_S = 1e-9
"""Of a sequence: times that are no further apart are one."""


@dataclass(slots=True)
class Track:
    """One edge over time, by stamp in ns; ``node`` shows it, where one does."""

    derived: bool
    node: vtkMRMLLinearTransformNode | None
    poses: dict[int, Transform] = field(default_factory=dict)
    lost: dict[int, TrackingStatus] = field(default_factory=dict)


def tracks_of(
    scene: MarginGuardScene, frames: Iterable[Sequence[TrackedTransform]]
) -> dict[str, Track]:
    """Every edge with a good sample, by its name, and every pose that a node of ``scene`` shows.

    Raises `SceneError` where times do not rise, and for more than `MOST_ITEMS` poses.
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
                f"a frame at {index_text(ns)} s comes after one at {index_text(last_ns)} s: "
                "sequences are ordered by time, which is a double"
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
        if sum(len(track.poses) for track in (*measured.values(), *derived.values())) > MOST_ITEMS:
            raise SceneError(
                f"the recording is longer than {index_text(ns - first_ns)} s: "
                f"{MOST_ITEMS} poses are allowed in a scene, which takes 9 kB for each"
            )
    # A pose that was measured as the node shows it is not told twice.
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
