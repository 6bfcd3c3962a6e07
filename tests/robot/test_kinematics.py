"""Forward kinematics of many robots beside Pinocchio's, and of a parallelogram beside geometry."""

import numpy as np
import pytest

from app.robot import load_robot, robot_from_text
from tests.robot.test_robot import assert_agrees_with_pinocchio

LIMIT = '<limit lower="-1.5" upper="1.5" effort="1" velocity="1"/>'


def test_every_example_robot_agrees_with_pinocchio(example_robots, rng):
    """The short form of ``marginguard bench kinematics``."""
    pytest.importorskip("pinocchio", reason="the pin wheel is not installed")
    from benchmarks.kinematics import BOUND, compare, example_urdfs

    compared = [each for urdf in example_urdfs() if (each := compare(urdf, 3, rng))]
    assert [(each.name, each.problem) for each in compared if not each.holds] == []
    assert len(compared) > 40
    assert sum(each.mimic_joints for each in compared) > 20
    assert all(each.worst_m <= BOUND for each in compared)


def test_the_comparison_can_fail(monkeypatch, panda_urdf, rng):
    pytest.importorskip("pinocchio", reason="the pin wheel is not installed")
    from benchmarks import kinematics

    text = kinematics.bare_text(panda_urdf)
    moved = text.replace('xyz="0 0 0.333"', 'xyz="0 0 0.333000002"')
    assert moved != text
    monkeypatch.setattr(
        kinematics, "robot_from_text", lambda text, name: robot_from_text(moved, name=name)
    )
    agreement = kinematics.compare(panda_urdf, 1, rng)
    assert agreement.worst_m == pytest.approx(2e-9, rel=1e-3)
    assert not agreement.holds


BAR, COUPLER = 0.15, 0.4


def turning(name, parent, child, xyz, mimic=""):
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="0 1 0"/>{LIMIT}{mimic}</joint>'
    )


def parallelogram():
    """The outer arm of the da Vinci PSM in its structure: a yaw, then a double parallelogram.

    ``pitch`` swings two equal bars; the coupler between their ends keeps its direction, and the
    instrument at its end turns as the bars do. The closing bar ``back`` hangs on the base.
    """
    links = "".join(
        f'<link name="{n}"/>' for n in ("base", "yaw", "bar", "coupler", "tool", "back")
    )
    mimic = '<mimic joint="pitch" multiplier="{}"/>'
    return links + "".join(
        (
            '<joint name="yaw" type="revolute"><parent link="base"/><child link="yaw"/>'
            f'<axis xyz="1 0 0"/>{LIMIT}</joint>',
            turning("pitch", "yaw", "bar", "0 0 0"),
            turning("level", "bar", "coupler", f"0 0 {BAR}", mimic.format(-1)),
            turning("insert", "coupler", "tool", f"{COUPLER} 0 0", mimic.format(1)),
            turning("back", "yaw", "back", f"{COUPLER} 0 0", mimic.format(1)),
        )
    )  # fmt: skip


def test_the_parallelogram_of_the_psm_agrees_with_pinocchio(write_urdf, rng):
    urdf = write_urdf(parallelogram())
    robot = load_robot(urdf)
    assert robot.actuated_joint_names == ("yaw", "pitch")
    assert_agrees_with_pinocchio(urdf, robot, rng, samples=100)


def test_the_parallelogram_of_the_psm_closes_and_has_a_remote_centre(write_urdf, rng):
    robot = load_robot(write_urdf(parallelogram()))
    for yaw, pitch in rng.uniform(-1.4, 1.4, size=(100, 2)):
        links = robot.forward_kinematics({"yaw": yaw, "pitch": pitch})
        # The closing bar's end is where the tool is joined, and both have turned alike.
        end_mm = links["back"].apply([0.0, 0.0, 1000.0 * BAR])
        np.testing.assert_allclose(end_mm, links["tool"].translation_mm, atol=1e-9)
        np.testing.assert_allclose(links["tool"].rotation, links["bar"].rotation, atol=1e-12)
        # The coupler keeps the direction that the yaw gives it.
        np.testing.assert_allclose(links["coupler"].rotation, links["yaw"].rotation, atol=1e-12)
        # The instrument passes through the same point on the yaw's axis at every pitch.
        centre_mm = links["tool"].apply([0.0, 0.0, -1000.0 * BAR])
        np.testing.assert_allclose(centre_mm, [1000.0 * COUPLER, 0.0, 0.0], atol=1e-9)


def test_a_mimic_of_no_joint_takes_a_position_of_its_own_and_is_said(write_urdf):
    body = '<link name="a"/><link name="b"/>' + turning(
        "j", "a", "b", "0 0 0", '<mimic joint="k"/>'
    )
    robot = load_robot(write_urdf(body))
    assert robot.actuated_joint_names == ("j",)
    assert robot.warnings == (
        "joint 'j' mimics 'k', which is no joint: it takes a position of its own",
    )
