"""Forward kinematics by Pinocchio, which parses the same URDF with a parser of its own."""

import importlib.metadata
import math
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from app.robot import robot_from_text

BOUND = 1e-9
"""Largest difference: distance in m, and entry of a rotation matrix."""


def random_positions(robot, rng):
    """Positions (rad, m) of the actuated joints within their limits, and those of all joints."""
    given = {
        joint.name: rng.uniform(
            *np.nan_to_num((joint.lower, joint.upper), neginf=-math.pi, posinf=math.pi)
        )
        for joint in robot.joints
        if joint.moves and joint.mimic is None
    }
    positions = dict(given)
    pending = {joint.name: joint.mimic for joint in robot.joints if joint.moves and joint.mimic}
    while pending:  # the leader of a mimic joint may be one, too
        ready = {name: mimic for name, mimic in pending.items() if mimic.leader in positions}
        for name, mimic in ready.items():
            positions[name] = mimic.multiplier * positions[mimic.leader] + mimic.offset
            del pending[name]
    return given, positions


def link_poses(model, robot, positions):
    """Poses of all links in the root link, by name, by Pinocchio's ``model``.

    Its own poses are relative to the universe, not the root link.
    """
    data, configuration = model.createData(), pin.neutral(model)
    for name, position in positions.items():
        joint = model.joints[model.getJointId(name)]
        if joint.shortname() == "JointModelMimic":
            continue  # computed by Pinocchio
        value = [position] if joint.nq == 1 else [math.cos(position), math.sin(position)]
        configuration[joint.idx_q : joint.idx_q + joint.nq] = value
    pin.framesForwardKinematics(model, data, configuration)
    poses = {
        link.name: data.oMf[model.getFrameId(link.name, pin.FrameType.BODY)] for link in robot.links
    }
    return {name: poses[robot.root_link].actInv(pose) for name, pose in poses.items()}


def largest_differences(model, robot, rng, samples):
    """Largest distance in m and difference of rotations to ``model``, over all links."""
    worst = np.zeros(2)
    for _ in range(samples):
        given, positions = random_positions(robot, rng)
        peers = link_poses(model, robot, positions)
        links = robot.forward_kinematics(given)
        assert set(links) == set(peers)
        for name, ours in links.items():
            assert (ours.target, ours.source) == (robot.root_link, name)
            distance_m = np.linalg.norm(ours.translation_mm / 1000.0 - peers[name].translation)
            turned = np.abs(ours.rotation - peers[name].rotation).max()
            worst = np.maximum(worst, (distance_m, turned))
    return worst


def assert_agrees_with_pinocchio(urdf, robot, rng, samples=5):
    """Compare the poses of all links at random positions."""
    model = pin.buildModelFromUrdf(str(urdf))
    assert max(largest_differences(model, robot, rng, samples)) <= BOUND


def bare_text(urdf):
    """Text of the URDF with links and joints only: kinematics does not use shapes."""
    parser = etree.XMLParser(remove_comments=True, resolve_entities=False)
    root = etree.fromstring(urdf.read_bytes(), parser)
    for element in list(root):
        if element.tag not in ("link", "joint"):
            root.remove(element)
        elif element.tag == "link":
            for part in list(element):
                element.remove(part)
    return etree.tostring(root, encoding="unicode")


def model_from_text(text):
    """Pinocchio's model; None if it does not load the text.

    It couples mimic joints only if their leader is above them in the tree; else they are free.
    """
    for mimic in (True, False):
        try:
            return pin.buildModelFromXML(text, mimic=mimic)
        except (ValueError, RuntimeError):
            pass
    return None


def assert_example_robots_agree(rng, samples):
    """Compare every URDF of example-robot-data that Pinocchio loads."""
    files = importlib.metadata.files("example-robot-data") or []
    robots = mimics = 0
    for urdf in sorted(Path(str(f.locate())) for f in files if f.name.endswith(".urdf")):
        text = bare_text(urdf)
        model = model_from_text(text)
        if model is None:
            continue
        robot = robot_from_text(text, name=urdf.name)
        worst = largest_differences(model, robot, rng, samples)
        assert max(worst) <= BOUND, (urdf.parts[-3:], worst)
        robots += 1
        mimics += sum(joint.mimic is not None for joint in robot.joints)
    assert robots > 40
    assert mimics > 20
