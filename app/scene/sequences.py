"""A recording as Slicer sequences: measured transforms and displayed margin over time.

A sequence of transforms keeps six digits and no status. A lost sample is not an item of it; its
time and status are in an attribute of the sequence. `app.case` reads both.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from typing import TypeVar

from slicer import (
    vtkMRMLDisplayableNode,
    vtkMRMLLinearTransformNode,
    vtkMRMLNode,
    vtkMRMLScene,
    vtkMRMLSequenceBrowserNode,
    vtkMRMLSequenceNode,
    vtkMRMLTextNode,
)

from app.fixture import MarginState, Reason
from app.geometry import (
    NS_PER_S,
    TrackedTransform,
    TrackingStatus,
    Transform,
    join_transform_name,
    poses_in,
)
from app.scene.convert import vtk_matrix
from app.scene.models import Rgb
from app.scene.offscreen import SceneError
from app.scene.scene import TOOL_COLOR, MarginGuardScene
from app.scene.shown_margin import banner

MAX_POSES = 200_000
"""Limit of all sequences together. MRML creates a node for each pose, also on loading."""

SAME_INDEX_S = 1e-9
"""Times of a sequence that are no further apart are one time."""
BROWSER_NAME = "MarginGuard"
CLOCK_NAME = "ReplayTime"
"""A text node: seconds since the recording's first frame, while it is played."""
LOST_ATTRIBUTE = "MarginGuard.Lost"
"""Attribute of a sequence: its lost samples, ``1.020000000=INVALID 1.040000000=MISSING``."""
DERIVED_ATTRIBUTE = "MarginGuard.Derived"
"""Attribute of a sequence that was computed from measured ones to move a node."""
StateSample = tuple[int, MarginState, tuple[Reason, ...]]
"""A stamp in ns, the state at that time, and its reasons."""
_T = TypeVar("_T")


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


def add_sequences(
    scene: MarginGuardScene,
    frames: Iterable[Sequence[TrackedTransform]],
    states: Iterable[StateSample],
    now_ns: int,
) -> vtkMRMLSequenceBrowserNode:
    """Add a recording to ``scene``, which shows the step at ``now_ns``; Slicer can play it.

    ``frames`` are the samples of one acquisition each, with increasing stamps; ``states`` the
    margin's states over time. Every measured edge becomes a sequence, and so does every pose in the
    reference that a node of the scene shows, marked as derived. During playback colours and banner
    follow the states, grey before the first one. Distance, line, plane and robots are known only at
    ``now_ns`` and hidden at other times.

    Raises `SceneError`, and adds nothing, if stamps do not increase, for more than
    `MAX_POSES` poses, and without a good sample of a frame in the scene.
    """
    tracks = tracks_of(scene, frames)
    played = {name: track for name, track in tracks.items() if track.node is not None}
    if not played:
        raise SceneError("recording: 0 good samples of the frames in the scene; expected 1 or more")
    sequences = {name: _transforms(scene.scene, name, track) for name, track in tracks.items()}
    stamps = sorted({ns for track in played.values() for ns in track.poses})
    browser = scene.scene.AddNewNodeByClass("vtkMRMLSequenceBrowserNode", BROWSER_NAME)
    browser.SetIndexDisplayFormat("%.3f")
    if len(stamps) > 1:
        browser.SetPlaybackRateFps((len(stamps) - 1) * NS_PER_S / (stamps[-1] - stamps[0]))
    # The first sequence is the master. It may not be one of transforms: their reader empties the
    # sequence first, and a browser that is loaded would then move the node to the first item.
    clock = scene.scene.AddNewNodeByClass("vtkMRMLTextNode", CLOCK_NAME)
    times = {ns: f"{(ns - stamps[0]) / NS_PER_S:.3f} s" for ns in stamps}
    _play(browser, _texts(scene.scene, CLOCK_NAME, times), clock)
    for name, track in played.items():
        _play(browser, sequences[name], track.node)
    for sequence, node in _margin(scene, list(states), stamps, now_ns):
        _play(browser, sequence, node)
    browser.SetSelectedItemByIndexValue(index_text(now_ns), False)
    return browser


def _transforms(scene: vtkMRMLScene, name: str, track: Track) -> vtkMRMLSequenceNode:
    node = vtkMRMLLinearTransformNode()  # the sequence stores copies
    node.SetName(name)
    sequence = _sequence(scene, name)
    for ns, pose in track.poses.items():
        node.SetMatrixTransformToParent(vtk_matrix(pose))
        sequence.SetDataNodeAtValue(node, index_text(ns))
    if track.lost:
        lost = " ".join(f"{index_text(ns)}={status.name}" for ns, status in track.lost.items())
        sequence.SetAttribute(LOST_ATTRIBUTE, lost)
    if track.derived:
        sequence.SetAttribute(DERIVED_ATTRIBUTE, "true")
    return sequence


def _margin(
    scene: MarginGuardScene,
    states: Sequence[StateSample],
    stamps: Sequence[int],
    now_ns: int,
) -> Iterator[tuple[vtkMRMLSequenceNode, vtkMRMLNode]]:
    """Sequences of what the margin showed, each with its node; one item per change."""
    margin, tumor = scene.margin, scene.tumor
    if margin is None or tumor is None:
        return
    if not states or states[0][0] > stamps[0]:
        states = [(stamps[0], MarginState.UNKNOWN, ()), *states]
    after_ns = next((ns for ns in stamps if ns > now_ns), None)
    banners = {ns: banner(state, None, reasons) for ns, state, reasons in states}
    texts = _changes(banners)
    texts[now_ns] = margin.status.GetText()
    if after_ns in banners:
        texts[after_ns] = banners[after_ns]
    yield _texts(scene.scene, margin.status.GetName(), texts), margin.status

    changes = _changes({ns: state for ns, state, _ in states})
    colors = {ns: state.color for ns, state in changes.items()}
    yield _displays(scene.scene, tumor, colors), tumor.GetDisplayNode()
    for model, color, _ in ((scene.tool, TOOL_COLOR, True), *scene.items.rods()):
        if model is not None:
            shown = {
                ns: state.color if state is MarginState.UNKNOWN else color
                for ns, state in changes.items()
            }
            yield _displays(scene.scene, model, shown), model.GetDisplayNode()
    for node in (margin.line, margin.plane.node, *scene.link_models):
        visible = {stamps[0]: False, now_ns: bool(node.GetDisplayNode().GetVisibility())}
        if after_ns is not None:
            visible[after_ns] = False
        yield _displays(scene.scene, node, visible), node.GetDisplayNode()


def _changes(values: Mapping[int, _T]) -> dict[int, _T]:
    """The first of ``values``, and each that differs from the one before."""
    times = list(values)
    return {
        ns: values[ns]
        for index, ns in enumerate(times)
        if index == 0 or values[ns] != values[times[index - 1]]
    }


def _texts(scene: vtkMRMLScene, name: str, texts: Mapping[int, str]) -> vtkMRMLSequenceNode:
    sequence = _sequence(scene, name)
    node = vtkMRMLTextNode()
    for ns in sorted(texts):
        node.SetText(texts[ns])
        sequence.SetDataNodeAtValue(node, index_text(ns))
    return sequence


def _displays(
    scene: vtkMRMLScene, node: vtkMRMLDisplayableNode, changes: Mapping[int, Rgb | bool]
) -> vtkMRMLSequenceNode:
    """Copies of the display of ``node`` with another colour or another visibility."""
    sequence = _sequence(scene, f"{node.GetName()}Display")
    for ns in sorted(changes):
        display = node.GetDisplayNode().NewInstance()
        display.Copy(node.GetDisplayNode())
        change = changes[ns]
        if isinstance(change, bool):
            display.SetVisibility(change)
        else:
            display.SetColor(*change)
        sequence.SetDataNodeAtValue(display, index_text(ns))
    return sequence


def _sequence(scene: vtkMRMLScene, source: str) -> vtkMRMLSequenceNode:
    """An empty sequence over time with the name that Slicer gives it when it is loaded."""
    sequence = scene.AddNewNodeByClass("vtkMRMLSequenceNode", f"{BROWSER_NAME}-{source}-Seq")
    sequence.SetAttribute("Sequences.Source", source)
    sequence.SetIndexName("time")
    sequence.SetIndexUnit("s")
    sequence.SetNumericIndexValueTolerance(SAME_INDEX_S)
    return sequence


def _play(
    browser: vtkMRMLSequenceBrowserNode, sequence: vtkMRMLSequenceNode, node: vtkMRMLNode
) -> None:
    modifying = browser.StartModify()  # otherwise the sequences logic creates a node of its own
    browser.AddSynchronizedSequenceNode(sequence.GetID())
    browser.AddProxyNode(node, sequence, False)
    browser.EndModify(modifying)
