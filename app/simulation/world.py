"""A simulated world that is stepped by its caller; it has no clock of its own."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from app.geometry import FloatArray, Transform
from app.robot.kinematic_tree import LinkPoses
from app.simulation.arm_motion import ArmMotion, VelocityServo
from app.simulation.body_model import TissueMotion, copy_state, place_body
from app.simulation.command_gate import ArmCommand, CommandGate, StateCommand
from app.simulation.errors import CommandError, EditError, UnstableError, WorldError
from app.simulation.rigid_body import M_PER_MM
from app.simulation.state import ArmState, Contact, WorldState, Wrench
from app.simulation.world_entries import WORLD_FRAME, BodyEntry, WorldDescription
from app.simulation.world_model import NS_TO_S, RobotModel, build_world

MAX_OVERLAP_MM = 1.0
"""A body that is placed deeper in another one would be thrown out by the contact."""

MAX_SPEED = 1e4
"""Largest generalized velocity (rad/s, m/s) of a state that has not diverged."""


class World:
    """The physics of a world. The same description and calls give the same states, bit by bit.

    Raises `WorldError` for a description that cannot be simulated. Not thread-safe.
    """

    def __init__(self, description: WorldDescription) -> None:
        self._gates: dict[str, CommandGate] = {}
        self._steps = 0
        self._build(description)
        self._gates = {each.entry.name: self._gate(each) for each in self._robots}
        self.reset()

    def _build(self, description: WorldDescription) -> None:
        """Compile ``description``; nothing changes if it cannot be simulated."""
        built = build_world(description)
        self.description = description
        self._model: Any = built.model
        self._data: Any = mujoco.MjData(built.model)
        self._robots = built.robots
        self._servos = {each.entry.name: VelocityServo(built.model, each) for each in built.robots}
        self._motions = {each.entry.name: self._motion(each) for each in built.robots}
        self._setpoints = {
            name: np.zeros(len(servo.joints)) for name, servo in self._servos.items()
        }
        self._tissues = [
            (int(self._model.body_mocapid[self._body(each.name)]),
             TissueMotion(each, description.breathing))
            for each in description.tissues
        ]  # fmt: skip
        self._body_rows = {name: self._body(name) for name in built.bodies}
        self._link_rows = {
            each.entry.name: {link: self._body(f"{each.entry.name}/{link}") for link in each.links}
            for each in built.robots
        }
        self._inertia = np.zeros((self._model.nv, self._model.nv))

    @property
    def model(self) -> Any:
        """The MuJoCo model, for judges of the physics; read only."""
        return self._model

    @property
    def data(self) -> Any:
        """The MuJoCo data, for judges of the physics; read only."""
        return self._data

    @property
    def time_ns(self) -> int:
        """Simulated time since the start or the last reset."""
        return self._steps * self.description.timestep_ns

    def reset(self, positions: Mapping[str, Mapping[str, float]] | None = None) -> WorldState:
        """Return to time 0; ``positions`` by arm and joint replace those of the description.

        Raises `WorldError` for an unknown arm, and the robot's error for joint positions.
        """
        mujoco.mj_resetData(self._model, self._data)
        self._steps = 0
        for name in positions or {}:
            self._arm(name)
        for robot in self._robots:
            name = robot.entry.name
            given = {**robot.entry.positions, **(positions or {}).get(name, {})}
            for joint, position in robot.entry.robot.complete_positions(given).items():
                self._data.qpos[self._model.jnt_qposadr[self._joint(f"{name}/{joint}")]] = position
            self._servos[name].reset()
            self._gates[name].enable()
        self._move_tissues()
        mujoco.mj_step1(self._model, self._data)
        return self.state()

    def enable(self, arm: str) -> None:
        """Let ``arm`` leave FAULT."""
        self._arm(arm).enable()

    def request(self, arm: str, command: StateCommand) -> None:
        """Change the state of ``arm`` by ``command``.

        Raises `CommandError`, and changes nothing, where its state does not allow that.
        """
        self._arm(arm).request(command)

    def fail(self, arm: str, reason: str) -> None:
        """Stop ``arm`` and put it into FAULT."""
        self._arm(arm).fail(reason)

    def move_bodies(self, poses: Mapping[str, Transform]) -> WorldState:
        """Put bodies at ``poses``, ``world_from_body`` by name; free ones are at rest there.

        Raises `EditError`, and moves nothing, for a name that is no body of the world, for another
        frame than the world's, and for a place at which a body overlaps another one by more than
        `MAX_OVERLAP_MM`. A reset puts all bodies back.
        """
        for name, pose in poses.items():
            self._require_body(name)
            if pose.target != WORLD_FRAME:
                raise EditError(
                    f"body {name!r} is placed in frame {pose.target!r}; expected {WORLD_FRAME!r}"
                )
        data = self._data
        before = data.qpos.copy(), data.qvel.copy(), data.mocap_pos.copy(), data.mocap_quat.copy()
        for name, pose in poses.items():
            place_body(self._model, data, name, pose)
        mujoco.mj_step1(self._model, data)
        overlap = self._overlap(set(poses))
        if overlap:
            data.qpos[:], data.qvel[:], data.mocap_pos[:], data.mocap_quat[:] = before
            mujoco.mj_step1(self._model, data)
            raise EditError(overlap)
        return self.state()

    def change_bodies(self, bodies: tuple[BodyEntry, ...]) -> WorldState:
        """Continue with ``bodies`` instead of the present ones; arms and bodies keep their states.

        The model is compiled again, which takes many time steps. A new body is where its entry
        places it. Raises `EditError`, and changes nothing, for bodies that cannot be simulated or
        overlap by more than `MAX_OVERLAP_MM`, and without one that the tracker or the hand uses.
        """
        self._require_used({each.name for each in bodies})
        before, model, data = dict(vars(self)), self._model, self._data
        known = {each.name for each in self.description.bodies}
        try:
            self._build(replace(self.description, bodies=bodies))
            copy_state(model, data, self._model, self._data)
            self._move_tissues()
            mujoco.mj_step1(self._model, self._data)
            overlap = self._overlap({each.name for each in bodies} - known)
        except WorldError as error:
            overlap = str(error)
        if overlap:
            vars(self).update(before)
            raise EditError(overlap)
        return self.state()

    def step(
        self,
        commands: Mapping[str, ArmCommand] | None = None,
        wrenches: Mapping[str, Wrench] | None = None,
    ) -> WorldState:
        """Advance by one time step with new ``commands`` by arm and ``wrenches`` by body.

        A command holds until it is older than `COMMAND_LIFETIME_NS`, a wrench for this step. Raises
        `CommandError` for a command that is refused, after its arm has been put into FAULT and
        without a step, `WorldError` for an unknown body, and `UnstableError`.
        """
        now_ns, data = self.time_ns, self._data
        refused: CommandError | None = None
        for arm, command in (commands or {}).items():
            try:
                self._arm(arm).accept(command, now_ns)
            except CommandError as error:
                refused = refused or error
        if refused is not None:
            raise refused
        self._apply_wrenches(wrenches or {})
        if self._servos:
            mujoco.mj_fullM(self._model, data, self._inertia)
        for arm, servo in self._servos.items():
            followed = self._gates[arm].command(now_ns)
            target = self._motions[arm].target(followed, self._model, data)
            self._setpoints[arm] = target.velocities
            servo.apply(data, self._inertia, target.velocities, target.efforts)
        mujoco.mj_step2(self._model, data)
        self._check_stable()
        self._steps += 1
        self._move_tissues()
        mujoco.mj_step1(self._model, data)
        return self.state()

    def state(self) -> WorldState:
        """The true state now."""
        data = self._data
        matrices = np.zeros((self._model.nbody, 4, 4))
        matrices[:, :3, :3] = data.xmat.reshape(-1, 3, 3)
        matrices[:, :3, 3] = data.xpos / M_PER_MM
        matrices[:, 3, 3] = 1.0
        arms = {}
        for arm, servo in self._servos.items():
            gate = self._gates[arm]
            command = gate.command(self.time_ns)
            setpoints = self._setpoints[arm]
            arms[arm] = ArmState(
                servo.joints,
                data.qpos[servo.positions],
                data.qvel[servo.dofs],
                servo.torques,
                np.zeros(len(servo.joints)) if command is None else setpoints,
                gate.status,
                gate.fault,
                LinkPoses(WORLD_FRAME, self._link_rows[arm], matrices),
                command,
            )
        return WorldState(self.time_ns, arms, LinkPoses(WORLD_FRAME, self._body_rows, matrices))

    def contacts(self) -> tuple[Contact, ...]:
        """Contacts now; bodies have the names of the model, ``robot/link`` for links."""
        found = []
        for contact in self._data.contact:
            names = [self._model.body(self._model.geom_bodyid[geom]).name for geom in contact.geom]
            found.append(
                Contact((names[0], names[1]), -contact.dist / M_PER_MM, contact.pos / M_PER_MM)
            )
        return tuple(found)

    def _apply_wrenches(self, wrenches: Mapping[str, Wrench]) -> None:
        data = self._data
        data.qfrc_applied[:] = 0.0
        for name, wrench in wrenches.items():
            if name not in self._body_rows:
                raise WorldError(
                    f"wrench on {name!r}: no such body; "
                    f"expected one of {', '.join(self._body_rows) or 'none'}"
                )
            force: FloatArray = np.asarray(wrench.force_n, dtype=np.float64)
            torque: FloatArray = np.asarray(wrench.torque_n_m, dtype=np.float64)
            if not (np.isfinite(force).all() and np.isfinite(torque).all()):
                raise WorldError(
                    f"wrench on {name!r} is {force.tolist()}, {torque.tolist()}; "
                    "expected finite numbers"
                )
            row = self._body_rows[name]
            mujoco.mj_applyFT(
                self._model, data, force, torque, data.xpos[row], row, data.qfrc_applied
            )

    def _move_tissues(self) -> None:
        time_s = NS_TO_S * self.time_ns
        for number, motion in self._tissues:
            position_mm, quaternion = motion.at(time_s)
            self._data.mocap_pos[number] = M_PER_MM * position_mm
            self._data.mocap_quat[number] = quaternion

    def _check_stable(self) -> None:
        """Raise `UnstableError` where the state is not finite or too fast."""
        speed = float(np.abs(self._data.qvel).max(initial=0.0))
        if not speed <= MAX_SPEED:  # also for NaN
            raise UnstableError(
                f"physics of world {self.description.name!r} has diverged at "
                f"{NS_TO_S * self.time_ns:.3f} s; expected a shorter time step than "
                f"{1e-6 * self.description.timestep_ns:g} ms, or stiffer or heavier bodies"
            )

    def _overlap(self, placed: set[str]) -> str:
        """A text about an overlap of bodies where they were ``placed``; empty without one."""
        for contact in self.contacts():
            if contact.depth_mm > MAX_OVERLAP_MM and placed & set(contact.bodies):
                name = next(each for each in contact.bodies if each in placed)
                other = next((each for each in contact.bodies if each != name), name)
                return (
                    f"body {name!r} overlaps {other!r} by {contact.depth_mm:.1f} mm; expected at "
                    f"most {MAX_OVERLAP_MM:g} mm"
                )
        return ""

    def _require_body(self, name: str) -> None:
        bodies = [each.name for each in self.description.bodies]
        if name in bodies:
            return
        reason = "no such body"
        if name in {each.name for each in self.description.tissues}:
            reason = "tissue moves by itself, and a guarded tumour changes through set_tumor alone"
        elif name in self._body_rows or name in self._servos:
            reason = "an arm moves it"
        raise EditError(f"{name!r}: {reason}; expected one of {', '.join(bodies) or 'none'}")

    def _require_used(self, bodies: set[str]) -> None:
        about = self.description
        used = [*(about.tracker.tracked if about.tracker else ())]
        used += [push.towards for push in (about.hand.pushes if about.hand else ())]
        missing = {each.name for each in about.bodies} - bodies
        name = next((each for each in used if each in missing), None)
        if name is not None:
            raise EditError(f"body {name!r}: the tracker or the hand uses it; expected another one")

    def _arm(self, name: str) -> CommandGate:
        """The gate of an arm; `WorldError` for another name."""
        if name not in self._gates:
            raise WorldError(
                f"arm {name!r}: no such robot; expected one of {', '.join(self._gates) or 'none'}"
            )
        return self._gates[name]

    def _gate(self, robot: RobotModel) -> CommandGate:
        entry = robot.entry
        tool = None if entry.tool is None else entry.tool.name
        joints = self._servos[entry.name].joints
        return CommandGate(entry.name, joints, entry.robot.root_link, tool)

    def _motion(self, robot: RobotModel) -> ArmMotion:
        entry = robot.entry
        tool = None if entry.tool is None else self._body(entry.tool.name)
        base = entry.world_from_base
        return ArmMotion(self._servos[entry.name], tool, base.rotation, base.translation_mm)

    def _body(self, name: str) -> int:
        return int(mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_BODY, name))

    def _joint(self, name: str) -> int:
        return int(mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_JOINT, name))
