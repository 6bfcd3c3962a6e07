"""Forward kinematics of every URDF of example-robot-data, compared with Pinocchio.

``marginguard bench kinematics``: computes each URDF that Pinocchio loads at random configurations
within its limits, including mimic joints. Prints the largest distance in m and the largest
difference of rotation matrix entries over all links. Exit status 1 if one is above 1e-9, or if a
robot that Pinocchio loads is not loaded by MarginGuard.

Shapes are removed, as kinematics does not use them. Both sides read the same text otherwise.
"""

import argparse
import importlib.metadata
import json
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from app.cli.progress import with_progress
from app.geometry import FloatArray, MarginGuardError
from app.robot import Robot, robot_from_text

BOUND = 1e-9


@dataclass(frozen=True, slots=True)
class Agreement:
    """Largest differences over the links of a robot; ``problem`` if it was not compared."""

    name: str
    links: int = 0
    mimic_joints: int = 0
    worst_m: float = 0.0
    worst_rotation: float = 0.0
    problem: str = ""

    @property
    def holds(self) -> bool:
        """True if the robot was compared and is within `BOUND`."""
        return not self.problem and max(self.worst_m, self.worst_rotation) <= BOUND


def example_urdfs() -> list[Path]:
    """Paths of all URDF files of the installed example-robot-data, sorted."""
    files = importlib.metadata.files("example-robot-data") or []
    return sorted(Path(str(f.locate())) for f in files if f.name.endswith(".urdf"))


def bare_text(urdf: Path) -> str:
    """Text of the URDF with links and joints only, without shapes."""
    parser = etree.XMLParser(remove_comments=True, resolve_entities=False)
    root = etree.fromstring(urdf.read_bytes(), parser)
    for element in list(root):
        if element.tag not in ("link", "joint"):
            root.remove(element)
        elif element.tag == "link":
            for part in list(element):
                element.remove(part)
    text: str = etree.tostring(root, encoding="unicode")
    return text


def compare(urdf: Path, samples: int, rng: np.random.Generator) -> Agreement | None:
    """Compare one robot; return None if Pinocchio does not load it."""
    import pinocchio as pin

    name = "/".join(urdf.parts[-3:])
    text = bare_text(urdf)
    model = _model(pin, text, mimic=True) or _model(pin, text, mimic=False)
    if model is None:
        return None
    try:
        robot = robot_from_text(text, name=name)
    except MarginGuardError as error:
        return Agreement(name, problem=str(error))
    data = model.createData()
    # Pinocchio has one frame per link; its poses are relative to the universe, not the root link.
    frames = {link.name: model.getFrameId(link.name, pin.FrameType.BODY) for link in robot.links}
    worst = np.zeros(2)
    for _ in range(samples):
        independent, positions = _random_positions(robot, rng)
        pin.framesForwardKinematics(model, data, _configuration(model, pin, positions))
        peer_root = data.oMf[frames[robot.root_link]]
        for link, ours in robot.forward_kinematics(independent).items():
            peer = peer_root.actInv(data.oMf[frames[link]])
            distance_m = float(np.linalg.norm(ours.translation_mm / 1000.0 - peer.translation))
            rotation_difference = float(np.abs(ours.rotation - peer.rotation).max())
            worst = np.maximum(worst, (distance_m, rotation_difference))
    mimics = sum(joint.mimic is not None for joint in robot.joints)
    return Agreement(name, len(robot.links), mimics, float(worst[0]), float(worst[1]))


def _model(pin: Any, text: str, *, mimic: bool) -> Any:
    """Model of Pinocchio, with mimic joints coupled by Pinocchio (``mimic``) or free.

    Pinocchio couples only joints whose leader is above them in the tree. Returns None if it does
    not load the text.
    """
    try:
        return pin.buildModelFromXML(text, mimic=mimic)
    except (ValueError, RuntimeError):
        return None


def _random_positions(
    robot: Robot, rng: np.random.Generator
) -> tuple[dict[str, float], dict[str, float]]:
    """Random positions of the independent joints, and of all joints with mimic joints added."""
    independent = {}
    for joint in robot.joints:
        if joint.moves and joint.mimic is None:
            low, high = np.nan_to_num((joint.lower, joint.upper), neginf=-math.pi, posinf=math.pi)
            independent[joint.name] = float(rng.uniform(low, high))
    positions = dict(independent)
    pending = {joint.name: joint.mimic for joint in robot.joints if joint.moves and joint.mimic}
    while pending:
        ready = {name: mimic for name, mimic in pending.items() if mimic.leader in positions}
        for name, mimic in ready.items():
            positions[name] = mimic.multiplier * positions[mimic.leader] + mimic.offset
            del pending[name]
    return independent, positions


def _configuration(model: Any, pin: Any, positions: dict[str, float]) -> FloatArray:
    configuration: FloatArray = pin.neutral(model)
    for name, position in positions.items():
        joint = model.joints[model.getJointId(name)]
        if joint.shortname() == "JointModelMimic":
            continue  # computed by Pinocchio
        value = [position] if joint.nq == 1 else [math.cos(position), math.sin(position)]
        configuration[joint.idx_q : joint.idx_q + joint.nq] = value
    return configuration


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare all robots and print one line per robot."""
    parser = argparse.ArgumentParser(prog="marginguard bench kinematics", description=__doc__)
    parser.add_argument("--samples", type=int, default=100, help="configurations per robot")
    parser.add_argument("--seed", type=int, default=1, help="seed of the configurations (1)")
    parser.add_argument("--json", type=Path, help="write the figures to this file, too")
    options = parser.parse_args(arguments)
    if options.samples < 1:
        parser.error(f"--samples is {options.samples}; expected 1 or more")
    rng = np.random.default_rng(options.seed)
    started = time.perf_counter()
    results, not_loaded = [], []
    for urdf in with_progress(example_urdfs(), "robot"):
        agreement = compare(urdf, options.samples, rng)
        if agreement is None:
            not_loaded.append("/".join(urdf.parts[-3:]))
            continue
        results.append(agreement)
        text = agreement.problem or (
            f"{agreement.worst_m:.1e} m  {agreement.worst_rotation:.1e}  "
            f"{agreement.links} links, {agreement.mimic_joints} mimic"
        )
        print(f"{'ok' if agreement.holds else 'NO':3}{agreement.name:70}{text}")
    failed = [each for each in results if not each.holds]
    print(
        f"{len(results) - len(failed)} of {len(results)} robots within {BOUND:g} at "
        f"{options.samples} configurations each, worst {max(r.worst_m for r in results):.1e} m, "
        f"{sum(r.mimic_joints for r in results)} mimic joints, "
        f"{time.perf_counter() - started:.1f} s; not loaded by Pinocchio: "
        f"{', '.join(not_loaded) or 'none'}"
    )
    if options.json is not None:
        figures = [{name: getattr(r, name) for name in Agreement.__slots__} for r in results]
        options.json.write_text(json.dumps(figures, indent=2) + "\n")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
