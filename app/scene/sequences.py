"""A recording as Slicer sequences: what was tracked, and what the scene showed, over time.

A sequence of transforms keeps six digits and no status, so a lost sample is not in it: when it was
lost, and how, stands in an attribute of the sequence. `app.case` reads both again.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
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
from app.geometry import NS_PER_S, TrackedTransform
from app.scene.errors import SceneError
from app.scene.margin.shown_margin import banner
from app.scene.nodes.convert import vtk_matrix
from app.scene.nodes.models import Rgb
from app.scene.scene import TOOL_COLOR, MarginGuardScene
from app.scene.tracks import SAME_INDEX_S, Track, index_text, tracks_of

BROWSER_NAME = "MarginGuard"
CLOCK_NAME = "ReplayTime"
"""A text node: seconds since the recording's first frame, while it is played."""
LOST_ATTRIBUTE = "MarginGuard.Lost"
"""Of a sequence: ``1.020000000=INVALID 1.040000000=MISSING``, the samples that it does not hold."""
DERIVED_ATTRIBUTE = "MarginGuard.Derived"
"""Marks a sequence that was computed of measured ones: it moves the scene, it is no measurement."""

Judged = tuple[int, MarginState, tuple[Reason, ...]]
"""A stamp in ns, what was judged then, and why."""

_T = TypeVar("_T")


def add_sequences(
    scene: MarginGuardScene,
    frames: Iterable[Sequence[TrackedTransform]],
    states: Iterable[Judged],
    now_ns: int,
) -> vtkMRMLSequenceBrowserNode:
    """Add a recording to ``scene``, which shows its moment ``now_ns``; Slicer plays the result.

    ``frames`` are the samples of one acquisition each, stamps rising; ``states`` is what was judged
    when (ns), and why. Every measured edge becomes a sequence, and so does every pose in the
    reference that a node of the scene shows, marked as derived. While they are played, colours and
    banner follow the states, grey before the first; distance, line, plane and robots are known,
    and shown, at ``now_ns`` alone.
    Raises `SceneError`, and adds nothing, where times do not rise, for sequences are ordered by
    time, for more than `app.scene.tracks.MOST_ITEMS` poses, and for a recording without a good
    sample of the frames in the scene.
    """
    tracks = tracks_of(scene, frames)
    played = {name: track for name, track in tracks.items() if track.node is not None}
    if not played:
        raise SceneError("the recording has no good sample of the frames in the scene")
    sequences = {name: _transforms(scene.scene, name, track) for name, track in tracks.items()}
    stamps = sorted({ns for track in played.values() for ns in track.poses})
    browser = scene.scene.AddNewNodeByClass("vtkMRMLSequenceBrowserNode", BROWSER_NAME)
    browser.SetIndexDisplayFormat("%.3f")
    if len(stamps) > 1:
        browser.SetPlaybackRateFps((len(stamps) - 1) * NS_PER_S / (stamps[-1] - stamps[0]))
    # The first one is the master. Of transforms it may not be: their reader empties the sequence
    # first, so that a browser that is loaded would go to its first item, and take the node along.
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
    node = vtkMRMLLinearTransformNode()  # the sequence keeps copies
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
    states: Sequence[Judged],
    stamps: Sequence[int],
    now_ns: int,
) -> Iterator[tuple[vtkMRMLSequenceNode, vtkMRMLNode]]:
    """What the margin showed, with the node that shows it; entries only where it changed."""
    margin, tumor = scene.margin, scene.tumor
    if margin is None or tumor is None:
        return
    if not states or states[0][0] > stamps[0]:
        states = [(stamps[0], MarginState.UNKNOWN, ()), *states]
    after_ns = next((ns for ns in stamps if ns > now_ns), None)
    told = {ns: banner(state, None, reasons) for ns, state, reasons in states}
    texts = _changes(told)
    texts[now_ns] = margin.status.GetText()
    if after_ns in told:
        texts[after_ns] = told[after_ns]
    yield _texts(scene.scene, margin.status.GetName(), texts), margin.status

    began = _changes({ns: state for ns, state, _ in states})
    colors = {ns: state.color for ns, state in began.items()}
    yield _displays(scene.scene, tumor, colors), tumor.GetDisplayNode()
    if scene.tool is not None:
        tool = {
            ns: state.color if state is MarginState.UNKNOWN else TOOL_COLOR
            for ns, state in began.items()
        }
        yield _displays(scene.scene, scene.tool, tool), scene.tool.GetDisplayNode()
    links = [model for robot in scene.robots.values() for model in robot.models.values()]
    for node in (margin.line, margin.plane.node, *links):
        visible = {stamps[0]: False, now_ns: bool(node.GetDisplayNode().GetVisibility())}
        if after_ns is not None:
            visible[after_ns] = False
        yield _displays(scene.scene, node, visible), node.GetDisplayNode()


def _changes(values: Mapping[int, _T]) -> dict[int, _T]:
    """The first of ``values``, and each that is another than the one before."""
    times = list(values)
    return {
        ns: values[ns]
        for place, ns in enumerate(times)
        if place == 0 or values[ns] != values[times[place - 1]]
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
    """The display of ``node`` as it is, but for another colour, or whether it is seen."""
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
    """An empty sequence over time, named as Slicer would name it when it is read again."""
    sequence = scene.AddNewNodeByClass("vtkMRMLSequenceNode", f"{BROWSER_NAME}-{source}-Seq")
    sequence.SetAttribute("Sequences.Source", source)
    sequence.SetIndexName("time")
    sequence.SetIndexUnit("s")
    sequence.SetNumericIndexValueTolerance(SAME_INDEX_S)
    return sequence


def _play(
    browser: vtkMRMLSequenceBrowserNode, sequence: vtkMRMLSequenceNode, node: vtkMRMLNode
) -> None:
    modifying = browser.StartModify()  # or the sequences logic would make a node of its own
    browser.AddSynchronizedSequenceNode(sequence.GetID())
    browser.AddProxyNode(node, sequence, False)
    browser.EndModify(modifying)
