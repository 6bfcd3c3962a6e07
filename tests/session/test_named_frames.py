"""Frames of a case that its recording does not contain, or measures a second time."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from app.case import Case, open_case, open_live
from app.fixture import MarginState, Reason
from app.geometry import FrameError, InputError
from app.session import Session, robot_from_case, setup_from_case
from app.session.named_frames import check_frames
from tests.cli.small_case import identity, write_small_case

POSE = " ".join(f"{number:g}" for number in np.eye(4).ravel())

Recorded = Callable[..., Case]


@pytest.fixture
def recorded(tmp_path: Path) -> Recorded:
    """A case whose recording has these transforms in each of its frames."""

    def written(*frames: str, **blocks: object) -> Case:
        folder = write_small_case(tmp_path / "case", lambda manifest: manifest.update(blocks))
        lines = ["ObjectType = Image", "NDims = 3"]
        for index, names in enumerate(frames):
            lines += [f"Seq_Frame{index:04}_{name}Transform = {POSE}" for name in names.split()]
            lines.append(f"Seq_Frame{index:04}_Timestamp = {100 + 0.05 * index:.3f}")
        text = "\n".join([*lines, "ElementDataFile = LOCAL", ""])
        (folder / "tracking.igs.mha").write_text(text)
        return open_case(folder)

    return written


def robot(base_frame: str) -> dict[str, object]:
    return {
        "robot": {
            "urdf": "package://marginguard/robots/touch/touch.urdf",
            "base_frame": base_frame,
            "tool_link": "stylus",
        },
        "registration": {"method": "given", "matrix": identity()},
    }


BOTH = "NeedleToTracker RodToTracker"
ALL = f"ReferenceToTracker {BOTH}"


def test_frames_that_come_late_or_alternate_are_found(recorded):
    check_frames(recorded("NeedleToTracker", "NeedleToTracker", "RodToNeedle"))


@pytest.mark.parametrize(
    ("frames", "blocks", "message"),
    [
        (["NeedleToTracker"] * 3, {}, r"tool\.frame is 'rod': .* expected one of needle, tracker$"),
        (["RodToTracker"] * 3, {}, r"tumor\.frame is 'needle': .* expected one of rod, tracker$"),
        (
            ["NeedleToTracker RodToCamera"],
            {},
            r"tumor\.frame is 'needle': not connected to tool\.frame 'rod' .*, which has "
            "tracker -> needle, camera -> rod$",
        ),
        (
            [BOTH] * 3,
            robot("robot_base"),
            "a robot's registration is 'reference': .* expected one of needle,",
        ),
        ([ALL], robot("rod_tip"), r"robot\.base_frame is 'rod_tip'; .* rod -> rod_tip"),
        ([ALL], robot("tracker"), r"robot\.base_frame is 'tracker'; .* tracker -> reference"),
        ([f"{ALL} RobotBaseToTracker"], robot("robot_base"), r"robot\.base_frame is 'robot_base'"),
    ],
)
def test_frame_that_the_recording_does_not_connect_is_named(recorded, frames, blocks, message):
    case = recorded(*frames, **blocks)
    with pytest.raises(FrameError, match=rf"^case\.yaml: .*{message}"):
        setup_from_case(case, tip_only=True)


def test_recording_without_transforms_is_named(recorded):
    with pytest.raises(InputError, match=r"tracking\.igs\.mha holds 1 images without tracking"):
        setup_from_case(recorded(""), tip_only=True)


@pytest.mark.parametrize("late", ["RobotBaseToTracker", "TrackerToRobotBase", "RobotBaseToRodTip"])
def test_base_that_is_measured_late_makes_margin_unknown_from_then_on(recorded, late):
    """The first frame connects all required frames, so `check_frames` stops before the error."""
    case = recorded(*[ALL] * 5, *[f"{ALL} {late}"] * 2, *[ALL] * 3, **robot("robot_base"))
    session = Session(setup_from_case(case, tip_only=True))
    steps = [session.step(frame) for frame in case.recorded_frames()]
    early, late_on = steps[:5], steps[5:]
    assert {step.frames_problem for step in early} == {""}
    assert MarginState.UNKNOWN not in {step.decision.state for step in early}
    for step in late_on:
        assert step.decision.state is MarginState.UNKNOWN
        assert Reason.REGISTRATION_REFUSED in step.decision.reasons
        assert step.decision.hold
        assert "robot.base_frame is 'robot_base'" in step.frames_problem
    assert session.frames_problem == steps[-1].frames_problem


def test_recorded_link_below_the_base_is_no_error(recorded):
    case = recorded(f"{ALL} StylusToRobotBase", **robot("robot_base"))
    check_frames(case)
    session = Session(setup_from_case(case, tip_only=True))
    assert session.step(next(case.recorded_frames())).frames_problem == ""


def test_robot_is_registered_without_a_tracked_tumour(recorded):
    case = recorded("ReferenceToTracker RodToTracker", **robot("robot_base"))
    found = robot_from_case(case)
    assert found.registration.transform.source == "robot_base"
    with pytest.raises(FrameError, match=r"tumor\.frame is 'needle'"):
        setup_from_case(case, tip_only=True)


def test_case_without_robot_gives_no_robot_setup(recorded):
    assert robot_from_case(recorded("NeedleToTracker", BOTH)) is None


def test_reading_stops_at_the_frame_that_connects_all(recorded):
    """The recording is cut after its first frames: reading on raises."""
    case = recorded(*[BOTH] * 40)
    text = case.recording_path.read_text()
    case.recording_path.write_text(text[: text.index("Seq_Frame0005")])
    check_frames(case)
    with pytest.raises(InputError, match="is cut"):
        list(case.recorded_frames())


def test_live_case_passes_the_check(project_root):
    check_frames(open_live(project_root / "data" / "live_example" / "live.yaml").case)
