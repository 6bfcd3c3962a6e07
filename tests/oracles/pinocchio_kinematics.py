"""Forward kinematics by Pinocchio, which parses the same URDF with a parser of its own."""

import math

import numpy as np
import pytest


def random_positions(robot, rng):
    """Positions (rad, m) of the actuated joints within their limits, -3 to 3 without limits."""
    return {
        joint.name: rng.uniform(*np.nan_to_num((joint.lower, joint.upper), neginf=-3, posinf=3))
        for joint in robot.joints
        if joint.moves and joint.mimic is None
    }


def assert_agrees_with_pinocchio(urdf, robot, rng, samples=5):
    """Compare the poses of all links at random positions: 1e-6 mm, and 1e-9 in the rotation."""
    pin = pytest.importorskip("pinocchio", reason="the pin wheel is not installed")
    model = pin.buildModelFromUrdf(str(urdf))
    data = model.createData()
    followers = {joint.name: joint.mimic for joint in robot.joints if joint.mimic is not None}
    for _ in range(samples):
        given = random_positions(robot, rng)
        positions = dict(given)
        for name, mimic in followers.items():
            positions[name] = given[mimic.leader] * mimic.multiplier + mimic.offset
        configuration = pin.neutral(model)
        for name, position in positions.items():
            joint = model.joints[model.getJointId(name)]
            value = [position] if joint.nq == 1 else [math.cos(position), math.sin(position)]
            configuration[joint.idx_q : joint.idx_q + joint.nq] = value
        pin.framesForwardKinematics(model, data, configuration)
        root = data.oMf[model.getFrameId(robot.root_link, pin.FrameType.BODY)]
        links = robot.forward_kinematics(given)
        assert set(links) == {link.name for link in robot.links}
        for name, root_from_link in links.items():
            peer = root.actInv(data.oMf[model.getFrameId(name, pin.FrameType.BODY)])
            assert root_from_link.target == robot.root_link
            assert root_from_link.source == name
            # 1e-9 m is 1e-6 mm
            np.testing.assert_allclose(
                root_from_link.translation_mm, 1000.0 * peer.translation, rtol=0, atol=1e-6
            )
            np.testing.assert_allclose(root_from_link.rotation, peer.rotation, rtol=0, atol=1e-9)
