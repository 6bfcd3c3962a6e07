"""A recording of a session contains what an operator has accepted in it, before and meanwhile."""

import json
import math
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

from app.bridge.live.live_node import live_node
from app.case import open_case
from app.fixture import ProximityEngine
from app.geometry import SurfaceMesh, Transform
from app.registration import register_points
from app.runtime import StructureContent, prepare_live
from app.session import Role
from tests.bridge.live.replayed_margins import plain
from tests.bridge.live.test_record_command import TRACKED
from tests.python_process import run_python
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.long

REPLAY = Path(__file__).resolve().parent / "replayed_margins.py"
MAX_ERROR_MM = 1e-9
FRAMES = 60


class Margins:
    """Runs the session of ``node`` in a thread and keeps its steps with a known margin."""

    def __init__(self, node):
        self._changed = threading.Condition()
        self._steps = []
        self._thread = threading.Thread(target=self._run, args=(node,))
        self._thread.start()

    def _run(self, node):
        for step in node.steps():
            values = plain(step)
            if values is not None:
                with self._changed:
                    self._steps.append(values)
                    self._changed.notify_all()

    def between(self, from_ns, until_ns):
        """The steps by the stamps of their poses, all of them within these times."""
        return {
            tuple(each["stamps_ns"]): each
            for each in self._steps
            if from_ns < min(each["stamps_ns"]) and max(each["stamps_ns"]) < until_ns
        }

    def wait_for_breach_after(self, since_ns):
        """Wait for `FRAMES` steps, outside and inside the tumour, with later stamps."""

        def is_known():
            late = [each["distance_mm"] for each in self.between(since_ns, math.inf).values()]
            return len(late) >= FRAMES and min(late) < 0.0 < max(late)

        with self._changed:
            assert self._changed.wait_for(is_known, DEADLINE_S)

    def join(self):
        self._thread.join(DEADLINE_S)
        assert not self._thread.is_alive()


def moved(tumor: SurfaceMesh) -> SurfaceMesh:
    """Another surface, whose coordinates no mesh file of single precision holds."""
    shift = np.array([0.3, -0.2, 0.1]) / 3.0
    return SurfaceMesh(tumor.frame, tumor.vertices_mm * 1.0123456789 + shift, tumor.faces)


def slightly_other_registration(known: Transform):
    """A registration by touched points with errors, near the ``known`` one."""
    noise = np.random.default_rng(3).normal(0.0, 0.1, (6, 3))
    moving = np.array(
        [[200, 0, 0], [260, 10, 0], [200, 60, 5], [210, 20, 70], [250, 70, 40], [190, -30, 30]],
        dtype=float,
    )
    return register_points(
        known.apply(moving) + noise, moving, fixed_frame=known.target, moving_frame=known.source
    )


@pytest.fixture
def session(start_sender, live_yaml, tmp_path):
    """A running session with a tracker, its margins and the folder of its recordings."""
    with live_node(
        prepare_live(live_yaml(TRACKED)),
        namespace="",
        constraint_hz=100.0,
        audit=tmp_path / "audit.jsonl",
        cases=tmp_path / "cases",
    ) as node:
        margins = Margins(node)
        try:
            start_sender("tracked", "again")
            margins.wait_for_breach_after(0)
            yield node.commands, margins
        finally:
            node.stop()
            margins.join()


def replayed(of_session, folder: Path):
    """Pairs of a step of the session and the same step of a replay of the case ``folder``."""
    done = run_python(REPLAY, folder)
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    of_case = {tuple(row["stamps_ns"]): row for row in rows}
    pairs = [(of_session[key], of_case[key]) for key in sorted(of_session.keys() & of_case.keys())]
    assert len(pairs) >= FRAMES // 2
    return pairs


def assert_same(of_session, content, folder: Path):
    """A replay of the case ``folder`` in another process has the margins of the session."""
    pairs = replayed(of_session, folder)
    case = open_case(folder)
    # The search of a session begins at the closest point of the step before, which may be another
    # one here: the same search, pose by pose, shows whether the contents are the same.
    engines = (
        ProximityEngine(content.tumor, content.tool),
        ProximityEngine(case.tumor_mesh(), case.tool_mesh()),
    )
    margins = np.array(
        [
            [
                [distance_mm(engine, step["pose"]), *step["margin_mm"]]
                for engine, step in zip(engines, steps, strict=True)
            ]
            for steps in pairs
        ]
    )
    error_mm = np.abs(margins[:, 0] - margins[:, 1]).max()
    print(f"{len(pairs)} frames, largest difference {error_mm:.3g} mm")
    assert margins[:, :, 0].min() < 0.0 < margins[:, :, 0].max()
    assert error_mm <= MAX_ERROR_MM


def distance_mm(engine, pose):
    tumor_from_tip = Transform.from_matrix(pose, target="tumor", source="cautery_tip")
    return engine.evaluate(tumor_from_tip).signed_distance_mm


def test_replay_gives_the_margins_of_a_session_with_another_tumour_tip_and_registration(
    session, domain_id
):
    commands, margins = session
    before = commands.content
    known = before.tool_from_tip
    commands.set_tip(
        Transform(known.target, known.source, known.rotation, known.translation_mm + 0.7),
        sigma_mm=0.21,
        origin="a test",
    )
    commands.set_tumor(before.frame_from_tumor, moved(before.tumor), sigma_mm=0.4, origin="a test")
    commands.set_registration(
        slightly_other_registration(before.registration.transform), origin="a test"
    )
    commands.set_margins(before.margins.replaced(stop_mm=1.5, warn_mm=6.0), origin="a test")
    status = commands.start_recording("changed", origin="a test")
    since_ns = time.time_ns()
    margins.wait_for_breach_after(since_ns)
    commands.stop_recording(origin="a test")

    case = open_case(status.folder)
    assert {path.name for path in status.folder.iterdir()} >= {"case.yaml", "tumor_of_session.ply"}
    assert not (status.folder / "tracking" / "changes.yaml").exists()
    assert case.manifest.registration.method == "given"
    assert case.manifest.margins.stop_mm == 1.5
    of_session = margins.between(since_ns, time.time_ns())
    assert all(each["margin_mm"][1] > 2.0 * 0.45 for each in of_session.values())
    assert_same(of_session, commands.content, status.folder)


def test_replay_has_the_states_of_the_structures_that_the_session_guarded(session):
    commands, margins = session
    tumor, edge = commands.content.tumor, commands.content.frame_from_tumor
    for name, shift_mm, role in (
        ("lesion", 6.0, Role.TARGET),
        ("vessel", 14.0, Role.FORBIDDEN),
        ("nerve", 60.0, Role.FORBIDDEN),
    ):
        surface = moved(SurfaceMesh(name, tumor.vertices_mm, tumor.faces))
        pose = Transform(edge.target, name, edge.rotation, edge.translation_mm + shift_mm / 3)
        structure = StructureContent(surface, role, 1.25, 4.0, 0.3)
        commands.set_structure(structure, pose, origin="a test")
    commands.switch_structure("nerve", on=False, reason="far away", origin="a test")
    status = commands.start_recording("structures", origin="a test")
    since_ns = time.time_ns()
    margins.wait_for_breach_after(since_ns)
    until_ns = time.time_ns()
    commands.switch_structure("vessel", on=False, reason="resected", origin="a test")
    commands.stop_recording(origin="a test")

    case = open_case(status.folder)
    assert [each.name for each in case.manifest.structures] == ["lesion", "vessel"]
    noted = yaml.safe_load((status.folder / "tracking" / "changes.yaml").read_text())["changes"]
    assert [change["replaced"] for change in noted] == ["structures"]
    pairs = replayed(margins.between(since_ns, until_ns), status.folder)
    found = [list(zip(*(each["structures"] for each in pair), strict=True)) for pair in pairs]
    assert {len(each) for each in found} == {3}
    states = set()
    # The first steps of the replay do not know the hysteresis of the session.
    for mine, replayed_one in (each for step in found[10:] for each in step):
        assert mine[0] == replayed_one[0]
        assert mine[3] == replayed_one[3]
        # Each search begins at the closest point of the step before.
        assert mine[2] == pytest.approx(replayed_one[2], abs=0.05)
        states.add((mine[1], replayed_one[1]))
    same = [one[1] == other[1] for step in found[10:] for one, other in step]
    assert np.mean(same) > 0.98
    assert len({one for one, _ in states}) > 1


def test_change_during_a_recording_is_noted_with_its_time_and_not_in_the_case(session, domain_id):
    commands, margins = session
    known = commands.content.tool_from_tip
    status = commands.start_recording("noted", origin="a test")
    since_ns = time.time_ns()
    margins.wait_for_breach_after(since_ns)
    until_ns = time.time_ns()
    commands.set_tip(
        Transform(known.target, known.source, known.rotation, known.translation_mm + 0.7),
        origin="a test",
    )
    commands.set_margins(
        commands.content.margins.replaced(stop_mm=1.5, warn_mm=6.0), origin="a test"
    )
    commands.stop_recording(origin="a test")

    noted = yaml.safe_load((status.folder / "tracking" / "changes.yaml").read_text())["changes"]
    assert [change["replaced"] for change in noted] == ["tip", "margins"]
    assert all(until_ns <= change["received_ns"] <= time.time_ns() for change in noted)
    case = open_case(status.folder)
    assert np.array_equal(case.manifest.tool.tool_from_tip.matrix, known.matrix)
    assert_same(margins.between(since_ns, until_ns), commands.content, status.folder)
