"""The command that plans an approach: files in, JSON out, one line for bad input."""

import json

import numpy as np
import pytest
import trimesh

from app.cli.parsing import CommandParser
from app.cli.planning import approach
from app.control import parse_plan
from app.geometry import InputError
from app.workflow import ShownPlan
from tests.cli.command import refused, run
from tests.planning.approach_scenes import load
from tests.tiers import PROJECT_ROOT

pytestmark = pytest.mark.slow

ROBOT = PROJECT_ROOT / "data" / "robots" / "touch" / "touch.urdf"
CONTROL = PROJECT_ROOT / "data" / "worlds" / "lumpectomy"
JOINTS = ("waist", "shoulder", "elbow", "yaw", "pitch", "roll")


@pytest.fixture
def plan(tmp_path):
    (tmp_path / "start.yaml").write_text("".join(f"{name}: 0.1\n" for name in JOINTS))
    (tmp_path / "goal.json").write_text(json.dumps({"waist": 0.5}))
    limits = "".join(f"{name}: {{acceleration: 5, jerk: 50}}\n" for name in JOINTS)
    (tmp_path / "limits.yaml").write_text(limits)
    trimesh.creation.icosphere(2, 20.0).export(tmp_path / "ball.stl")
    (tmp_path / "pose.txt").write_text("1 0 0 0\n0 1 0 0\n0 0 1 900\n0 0 0 1\n")

    def run(*words):
        parser = CommandParser()
        approach.add_arguments(parser)
        given = [str(ROBOT), "--clearance-mm", "5"]
        names = ("start.yaml",) if "--control" in words else ("start.yaml", "limits.yaml")
        for name in names:
            given += [f"--{name.partition('.')[0]}", str(tmp_path / name)]
        names = [str(tmp_path / word) if "." in word else word for word in words]
        return approach.run(parser.parse_args([*given, *names]))

    return run


def test_trajectory_is_printed(plan, capsys):
    assert plan("--goal", "goal.json", "--structure", "ball.stl", "pose.txt") == 0
    made = json.loads(capsys.readouterr().out)
    assert made["joints"] == ["waist"]
    assert made["positions"][0] == [0.1]
    assert made["positions"][-1] == [0.5]
    assert made["held"] == dict.fromkeys(JOINTS[1:], 0.1)
    assert len(made["times_ns"]) == len(made["velocities"])
    shown = ShownPlan.of(parse_plan(json.dumps(made)), "plan")
    assert shown.samples[-1] == len(made["times_ns"]) - 1
    assert {name for name, _ in shown.nearest} == {"ball"}
    assert min(distance_mm for _, distance_mm in shown.nearest) > shown.clearance_mm == 5.0


def test_trajectory_to_a_pose_is_written(plan, tmp_path):
    robot = load("touch")
    pose = robot.forward_kinematics(dict.fromkeys(JOINTS, 0.3))["stylus"]
    np.savetxt(tmp_path / "goal.txt", pose.matrix)
    report = tmp_path / "report"
    words = ("--goal-pose", "stylus", "goal.txt", "--out", "plan.json", "--report", str(report))
    assert plan(*words) == 0
    made = json.loads((tmp_path / "plan.json").read_text())
    assert made["made_from"] == {}
    assert "touch: approach" in (report / "approach.html").read_text()
    end = dict(zip(made["joints"], made["positions"][-1], strict=True))
    assert robot.forward_kinematics(end)["stylus"].distance_mm_to(pose) < 1e-6


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("goal.json", "[1]", "is no mapping of joints; expected JOINT: NUMBER"),
        ("goal.json", '{"waist": "far"}', "waist is 'far'; expected a number"),
        ("limits.yaml", "waist: 3", "waist is 3; expected acceleration, jerk and maybe velocity"),
    ],
)
def test_bad_file_is_named(plan, tmp_path, name, text, problem):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError) as raised:
        plan("--goal", "goal.json")
    assert problem in str(raised.value)
    assert name in str(raised.value)


def test_execution_refuses_what_is_no_plan(tmp_path):
    plan = tmp_path / "plan.json"
    plan.write_text("[]")
    error = run("plan", "execute", plan, CONTROL, status=2).err
    assert "plan.json: is not a plan (TypeError" in error


def test_limits_of_a_control_file_are_used(plan, capsys):
    assert plan("--goal", "goal.json", "--control", str(CONTROL)) == 0
    limits = json.loads(capsys.readouterr().out)["limits"]
    assert limits == {"waist": {"acceleration": 5.0, "jerk": 50.0, "velocity": 10.0}}


def test_control_file_of_another_robot_is_refused(plan, tmp_path):
    (tmp_path / "other.urdf").write_text(ROBOT.read_text().replace('name="touch"', 'name="other"'))
    shipped = (CONTROL / "control.yaml").read_text()
    robot = "package://marginguard/robots/touch/touch.urdf"
    (tmp_path / "control.yaml").write_text(shipped.replace(robot, "other.urdf"))
    with pytest.raises(InputError, match="--control: is of robot 'other'; expected 'touch'"):
        plan("--goal", "goal.json", "--control", "control.yaml")


def test_arm_that_is_no_namespace_is_refused(tmp_path):
    (tmp_path / "goal.yaml").write_text("waist: 0.1\n")
    (tmp_path / "limits.yaml").write_text("waist: {acceleration: 5, jerk: 50}\n")
    files = [f"--{name}={tmp_path / name}.yaml" for name in ("goal", "limits")]
    error = refused("plan", "approach", ROBOT, "--arm", "arm", "--clearance-mm", "5", *files)
    assert "--arm is 'arm'; expected a namespace such as /arm" in error
