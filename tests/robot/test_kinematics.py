"""Forward kinematics of a parallelogram linkage compared with Pinocchio."""

import numpy as np
import pytest

from app.robot import load_robot, robot_from_text
from tests.oracles.pinocchio_kinematics import (
    BOUND,
    assert_agrees_with_pinocchio,
    bare_text,
    largest_differences,
    model_from_text,
)

LIMIT = '<limit lower="-1.5" upper="1.5" effort="1" velocity="1"/>'


def test_comparison_detects_a_moved_origin(panda_urdf, rng):
    text = bare_text(panda_urdf)
    moved = text.replace('xyz="0 0 0.333"', 'xyz="0 0 0.333000002"')
    assert moved != text
    worst = largest_differences(model_from_text(text), robot_from_text(moved, name="panda"), rng, 1)
    assert worst[0] == pytest.approx(2e-9, rel=1e-3)
    assert worst[0] > BOUND


BAR, COUPLER = 0.15, 0.4


def turning(name, parent, child, xyz, mimic=""):
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="0 1 0"/>{LIMIT}{mimic}</joint>'
    )


def parallelogram():
    """URDF with the structure of the da Vinci PSM's outer arm: a yaw and a double parallelogram.

    ``pitch`` rotates two equal bars. The coupler between their ends keeps its direction, and the
    instrument at its end rotates as the bars do. The closing bar ``back`` is a child of ``yaw``.
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


def test_parallelogram_of_the_psm_agrees_with_pinocchio(write_urdf, rng):
    urdf = write_urdf(parallelogram())
    robot = load_robot(urdf)
    assert robot.actuated_joint_names == ("yaw", "pitch")
    assert_agrees_with_pinocchio(urdf, robot, rng, samples=100)


def test_parallelogram_of_the_psm_closes_and_has_a_remote_centre(write_urdf, rng):
    robot = load_robot(write_urdf(parallelogram()))
    for yaw, pitch in rng.uniform(-1.4, 1.4, size=(100, 2)):
        links = robot.forward_kinematics({"yaw": yaw, "pitch": pitch})
        # The end of the closing bar is at the joint of the tool, with the same rotation.
        end_mm = links["back"].apply([0.0, 0.0, 1000.0 * BAR])
        np.testing.assert_allclose(end_mm, links["tool"].translation_mm, atol=1e-9)
        np.testing.assert_allclose(links["tool"].rotation, links["bar"].rotation, atol=1e-12)
        # The coupler keeps the orientation of the yaw link.
        np.testing.assert_allclose(links["coupler"].rotation, links["yaw"].rotation, atol=1e-12)
        # The instrument passes through one point of the yaw axis at every pitch.
        centre_mm = links["tool"].apply([0.0, 0.0, -1000.0 * BAR])
        np.testing.assert_allclose(centre_mm, [1000.0 * COUPLER, 0.0, 0.0], atol=1e-9)


def test_mimic_joint_without_leader_is_actuated_with_a_warning(write_urdf):
    body = '<link name="a"/><link name="b"/>' + turning(
        "j", "a", "b", "0 0 0", '<mimic joint="k"/>'
    )
    robot = load_robot(write_urdf(body))
    assert robot.actuated_joint_names == ("j",)
    assert robot.warnings == (
        "joint 'j' mimics 'k', which is not a joint: it is treated as an actuated joint",
    )
