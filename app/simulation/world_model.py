"""The MuJoCo model of a world: its bodies, and its robots from `app.robot`'s description.

MuJoCo's own URDF reader is not used: so names, poses and joint positions are those of `Robot`.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import mujoco
import numpy as np

from app.geometry import MarginGuardError, Transform
from app.robot import ClosureType, Joint, Link, LoopClosure
from app.simulation.body_model import BodyWriter, quaternion_wxyz
from app.simulation.errors import WorldError
from app.simulation.rigid_body import M_PER_MM, link_inertia, of_hulls
from app.simulation.world_entries import RobotEntry, WorldDescription

STIFF_SOLREF = (0.002, 1.0)
STIFF_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""Constraints of loops, mimic joints and limits: time constant of 2 ms, critically damped, with a
force of 0.9999 of the ideal one. MuJoCo's defaults leave a loop open by more than a millimetre."""

AXIS_ARM_MM = 50.0
"""A hinge that closes a loop holds two points of its axis, at this distance."""
NS_TO_S = 1e-9


@dataclass(frozen=True, slots=True)
class JointDrive:
    """An actuated joint; limits in N m and rad/s, N and m/s for sliding joints."""

    name: str
    effort: float
    velocity: float
    lower: float
    upper: float


@dataclass(frozen=True, slots=True, eq=False)
class RobotModel:
    """Names that `add_robot` has added: links with a body, joints and drives."""

    entry: RobotEntry
    links: tuple[str, ...]
    joints: tuple[str, ...]
    drives: tuple[JointDrive, ...]


def add_robot(writer: BodyWriter, entry: RobotEntry) -> RobotModel:
    """Add ``entry`` to the model. Raises `WorldError` for what cannot be simulated.

    A link without mass and shape between two moving joints gets no body: its joint is one of the
    next link's, as a ball joint is three hinges of one body.
    """
    return _RobotWriter(writer, entry).write()


class _RobotWriter:
    def __init__(self, writer: BodyWriter, entry: RobotEntry) -> None:
        self._writer, self._entry, self._robot = writer, entry, entry.robot
        self._links = {link.name: link for link in self._robot.links}
        self._children: dict[str, list[Joint]] = {name: [] for name in self._links}
        for joint in self._robot.joints:
            self._children[joint.parent].append(joint)
        self._bodies: dict[str, Any] = {}
        self._moving: set[str] = set()

    def write(self) -> RobotModel:
        entry, root = self._entry, self._robot.root_link
        for name in self._robot.links_without_collision:
            raise WorldError(f"{self._what(name)} has no readable collision mesh")
        self._add_body(self._writer.world, root, entry.world_from_base, [])
        pending = [root]
        for parent in pending:  # grows in the loop
            for joints, link, parent_from_link in self._next_bodies(parent):
                self._add_body(self._bodies[parent], link, parent_from_link, joints)
                pending.append(link)
        for joint in self._robot.joints:
            if joint.moves and joint.mimic is not None:
                self._add_mimic(joint)
        for closure in self._robot.closures:
            self._add_closure(closure)
        self._exclude_contacts()
        names = self._robot.actuated_joint_names
        by_name = {joint.name: joint for joint in self._robot.joints}
        return RobotModel(
            entry,
            tuple(self._bodies),
            tuple(joint.name for joint in self._robot.joints if joint.moves),
            tuple(self._drive(by_name[name]) for name in names),
        )

    def _next_bodies(
        self, parent: str
    ) -> Iterator[tuple[list[tuple[Joint, Transform]], str, Transform]]:
        """Yield the joints with ``joint_frame_from_link``, link and pose of each child body."""
        for first in self._children[parent]:
            joint, passed = first, [first]
            while joint.moves and self._is_virtual(self._links[joint.child]):
                (joint,) = self._children[joint.child]
                passed.append(joint)
            parent_from_link = Transform.identity(parent, parent)
            frames = []
            for each in passed:
                parent_from_link = parent_from_link @ each.origin
                frames.append(parent_from_link)
            joints = [
                (each, frame.inverse() @ parent_from_link)
                for each, frame in zip(passed, frames, strict=True)
                if each.moves
            ]
            yield joints, joint.child, parent_from_link

    def _is_virtual(self, link: Link) -> bool:
        children = self._children[link.name]
        is_empty = link.inertia is None and not (link.collisions or link.visuals)
        return is_empty and len(children) == 1 and children[0].moves

    def _add_body(
        self, parent: Any, name: str, pose: Transform, joints: list[tuple[Joint, Transform]]
    ) -> None:
        entry, link = self._entry, self._links[name]
        body = parent.add_body(
            name=self._name(name),
            pos=M_PER_MM * pose.translation_mm,
            quat=quaternion_wxyz(pose.rotation),
        )
        self._bodies[name] = body
        if joints or pose.target in self._moving:
            self._moving.add(name)
            inertia = link_inertia(link, entry.density_kg_m3, self._what(name), is_fixed=not joints)
            if inertia is not None:
                self._writer.set_inertia(body, inertia)
            elif joints and not self._carries_mass(name):
                raise WorldError(f"{self._what(name)} has a mass of 0 kg; expected more than 0")
        for joint, frame_from_link in joints:
            self._add_joint(body, joint, frame_from_link)
        for shape in link.collisions:
            self._writer.add_surface(
                body, shape.mesh, entry.collision, entry.friction, self._what(name)
            )
        tool = entry.tool
        if tool is not None and tool.link == name:
            self._writer.add_body(
                body,
                tool.name,
                tool.link_from_tool,
                tool.mesh,
                tool.collision,
                tool.friction,
                inertia=of_hulls([tool.mesh.vertices_mm], tool.name, mass_kg=tool.mass_kg),
            )

    def _carries_mass(self, name: str) -> bool:
        """True if a link that is fixed to ``name`` has a mass, or a tool does."""
        tool = self._entry.tool
        fixed = [joint.child for joint in self._children[name] if not joint.moves]
        return (tool is not None and tool.link == name) or any(
            link_inertia(
                self._links[each], self._entry.density_kg_m3, self._what(each), is_fixed=True
            )
            or self._carries_mass(each)
            for each in fixed
        )

    def _add_joint(self, body: Any, joint: Joint, frame_from_link: Transform) -> None:
        link_from_frame = frame_from_link.inverse()
        dynamics = joint.dynamics
        if not dynamics.is_finite or dynamics.damping < 0.0 or dynamics.friction < 0.0:
            raise WorldError(
                f"joint {joint.name!r} of robot {self._entry.name!r} has damping "
                f"{dynamics.damping:g} and friction {dynamics.friction:g}; "
                "expected finite numbers of at least 0"
            )
        kind = mujoco.mjtJoint.mjJNT_SLIDE if joint.slides else mujoco.mjtJoint.mjJNT_HINGE
        is_limited = math.isfinite(joint.lower) and math.isfinite(joint.upper)
        added = body.add_joint(
            name=self._name(joint.name),
            type=kind,
            axis=link_from_frame.rotate(joint.axis),
            pos=M_PER_MM * link_from_frame.apply(joint.pivot_mm),
            damping=[dynamics.damping, 0.0, 0.0],
            frictionloss=dynamics.friction,
            armature=self._entry.armature_kg_m2,
            limited=is_limited,
        )
        if is_limited:
            added.range = [joint.lower, joint.upper]
            added.solref_limit, added.solimp_limit = STIFF_SOLREF, STIFF_SOLIMP

    def _drive(self, joint: Joint) -> JointDrive:
        effort = joint.dynamics.effort or self._entry.max_effort
        if effort is None or effort < 0.0:
            raise WorldError(
                f"joint {joint.name!r} of robot {self._entry.name!r} has the effort limit "
                f"{joint.dynamics.effort}; expected one above 0 in the robot's file, or max_effort"
            )
        name = self._name(joint.name)
        self._writer.spec.add_actuator(
            name=name,
            target=name,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            forcelimited=True,
            forcerange=[-effort, effort],
        )
        velocity = joint.dynamics.velocity or math.inf
        return JointDrive(joint.name, effort, velocity, joint.lower, joint.upper)

    def _add_mimic(self, joint: Joint) -> None:
        mimic = joint.mimic
        assert mimic is not None
        self._writer.spec.add_equality(
            name=self._name(joint.name),
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=self._name(joint.name),
            name2=self._name(mimic.leader),
            data=[mimic.offset, mimic.multiplier, *[0.0] * 10],
            solref=STIFF_SOLREF,
            solimp=STIFF_SOLIMP,
        )

    def _add_closure(self, closure: LoopClosure) -> None:
        """Connect the points of a closing joint: one of a ball, two of a hinge, three if fixed."""
        if closure.type is ClosureType.PRISMATIC:
            raise WorldError(
                f"joint {closure.name!r} of robot {self._entry.name!r} is a sliding joint that "
                "closes a loop; expected a hinge, a ball or a fixed one"
            )
        count = {ClosureType.BALL: 1, ClosureType.REVOLUTE: 2, ClosureType.FIXED: 3}[closure.type]
        points = AXIS_ARM_MM * np.array([(0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)])
        for number, point in enumerate(points[:count]):
            sites: list[str] = []
            for link, frame in (
                (closure.parent, closure.parent_from_joint),
                (closure.child, closure.child_from_joint),
            ):
                if link not in self._bodies:
                    raise WorldError(
                        f"{self._what(link)} has no mass and closes a loop; expected a mass"
                    )
                place = frame[:3, :3] @ point + frame[:3, 3]
                name = f"{self._name(closure.name)}-{number}-{len(sites)}"
                self._bodies[link].add_site(name=name, pos=M_PER_MM * place)
                sites.append(name)
            self._writer.spec.add_equality(
                name=f"{self._name(closure.name)}-{number}",
                type=mujoco.mjtEq.mjEQ_CONNECT,
                objtype=mujoco.mjtObj.mjOBJ_SITE,
                name1=sites[0],
                name2=sites[1],
                solref=STIFF_SOLREF,
                solimp=STIFF_SOLIMP,
            )

    def _exclude_contacts(self) -> None:
        """Exclude contacts between links that a joint connects, or between all links."""
        joined = {frozenset((joint.parent, joint.child)) for joint in self._robot.joints}
        joined |= {frozenset((each.parent, each.child)) for each in self._robot.closures}
        names = {link: self._name(link) for link in self._bodies}
        tool = self._entry.tool
        if tool is not None:
            names[tool.name] = tool.name
            joined.add(frozenset((tool.name, tool.link)))
        for one, other in combinations(names, 2):
            if not self._entry.self_collision or frozenset((one, other)) in joined:
                self._writer.spec.add_exclude(bodyname1=names[one], bodyname2=names[other])

    def _name(self, name: str) -> str:
        return f"{self._entry.name}/{name}"

    def _what(self, link: str) -> str:
        return f"link {link!r} of robot {self._entry.name!r}"


@dataclass(frozen=True, slots=True, eq=False)
class BuiltWorld:
    """The compiled model; ``bodies`` are the names of tools, bodies and tissues."""

    model: Any
    robots: tuple[RobotModel, ...]
    bodies: tuple[str, ...]


def build_world(description: WorldDescription) -> BuiltWorld:
    """Compile ``description``. Raises `WorldError` for what cannot be simulated."""
    spec = mujoco.MjSpec()
    spec.modelname = description.name
    spec.compiler.degree = False
    spec.compiler.autolimits = True
    spec.compiler.fusestatic = False
    spec.option.timestep = NS_TO_S * description.timestep_ns
    spec.option.gravity = [0.0, 0.0, -description.gravity_m_s2]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    # A diverged state is an error and not silently the initial one.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    writer = BodyWriter(spec)
    try:
        robots = tuple(add_robot(writer, entry) for entry in description.robots)
        bodies = [each.tool.name for each in description.robots if each.tool is not None]
        for body in description.bodies:
            inertia = None
            if body.mass_kg is not None:
                what = f"body {body.name!r}"
                inertia = of_hulls([body.mesh.vertices_mm], what, mass_kg=body.mass_kg)
            writer.add_body(
                writer.world,
                body.name,
                body.world_from_body,
                body.mesh,
                body.collision,
                body.friction,
                inertia=inertia,
                is_free=body.mass_kg is not None,
                is_driven=body.mass_kg is None,  # so that it can be moved while the world runs
            )
            bodies.append(body.name)
        for tissue in description.tissues:
            writer.add_body(
                writer.world, tissue.name, tissue.rest, tissue.mesh, "none", 0.0, is_driven=True
            )
            bodies.append(tissue.name)
        return BuiltWorld(spec.compile(), robots, tuple(bodies))
    except WorldError:
        raise
    except MarginGuardError as error:
        raise WorldError(f"world {description.name!r}: {error}") from error
    except ValueError as error:  # of MuJoCo's compiler
        raise WorldError(f"world {description.name!r} does not compile: {error}") from error
