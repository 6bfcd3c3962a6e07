"""Simulated hands that touch a haptic device: the energy that the device gives out.

A handle (mass and damping, exact between the samples) is touched by hands of random stiffness that
move at random; the force is held for a period and comes late by the delay. Two of our forces: the
spring to a tool that an admittance moves and the fixture stops (`HapticCoupling`, `FixtureRule`),
and the guidance force in front of a margin (`Guidance`).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from app.fixture import (
    Constraint,
    FixtureRule,
    Guidance,
    GuidanceParameters,
    MarginState,
    PlainConstraint,
)
from app.geometry import NS_PER_MS, NS_PER_S, FloatArray
from app.simulation import HapticCoupling, HapticParameters

TOUCH_S = 0.4
SUBSTEP_S = 1e-4
CONTROL_NS = 5 * NS_PER_MS
ADMITTANCE_MM_S_N = 10.0
RESPONSE_S = 0.03
ROUNDING_J = 1e-12

COUPLING = HapticParameters(
    stiffness_n_m=100.0, force_n=10.0, scale=0.5, period_s=0.002, delay_s=0.005, damping_n_s_m=0.2
)
"""Coupling of the shipped world."""

GUIDANCE = GuidanceParameters(
    force_n=2.0, range_mm=10.0, rate_n_s=20.0, period_s=0.02, delay_s=0.005, damping_n_s_m=5.0
)
"""Guidance of the documentation."""

MASS_KG = 0.05


@dataclass(frozen=True, slots=True)
class Device:
    """The handle as it is; ``period_s`` and ``delay_s`` are those of the force on it."""

    damping_n_s_m: float
    period_s: float
    delay_s: float

    @classmethod
    def stated(cls, parameters: HapticParameters | GuidanceParameters) -> "Device":
        """The device that ``parameters`` describe."""
        return cls(parameters.damping_n_s_m, parameters.period_s, parameters.delay_s)


class SpringTouch:
    """The force of `HapticCoupling` on a handle, whose tool the fixture stops at the origin."""

    def __init__(self, normal: FloatArray) -> None:
        self._coupling = HapticCoupling(COUPLING)
        self._rule = FixtureRule(frame="tumor", accept_simulated=True)
        self._normal, self._tool_mm = normal, 8.0 * normal
        self._now_ns = 0
        self._control_ns = 0
        self._velocity: FloatArray = np.zeros(3)
        self._seq = 0

    def force(self, handle_mm: FloatArray, step_ns: int) -> FloatArray:
        """The force in N on the handle, ``step_ns`` after the last one."""
        on_tool, on_handle = self._coupling.update(handle_mm, self._tool_mm)
        self._now_ns += step_ns
        if self._now_ns - self._control_ns >= CONTROL_NS:
            self._control(on_tool, (self._now_ns - self._control_ns) / NS_PER_S)
            self._control_ns = self._now_ns
        self._tool_mm = self._tool_mm + self._velocity * step_ns / NS_PER_S
        return on_handle

    def _control(self, on_tool: FloatArray, step_s: float) -> None:
        """One step of the admittance and of the rule, with a constraint of the present."""
        share = -np.expm1(-step_s / RESPONSE_S)
        goal = self._velocity + share * (ADMITTANCE_MM_S_N * on_tool - self._velocity)
        self._seq += 1
        now_ns = NS_PER_S + self._now_ns
        planes = self._normal[None]
        self._rule.receive(
            PlainConstraint(
                "passivity", self._seq, "tumor", now_ns, now_ns + 50 * NS_PER_MS,
                int(MarginState.NEGATIVE), False, True, True, planes, np.zeros(1),
                self._tool_mm[None], np.zeros((1, 3)), 1e4, 1.0, 250.0, 2.0, "setup",
            ),
            now_ns,
        )  # fmt: skip
        twist = np.concatenate([goal, np.zeros(3)])
        self._velocity = self._rule.allow(twist, self._tool_mm, now_ns).twist[:3]


class GuidanceTouch:
    """The force of `Guidance` on a handle that is the tool; its plane is through the origin."""

    def __init__(self, normal: FloatArray) -> None:
        self._guidance, self._normal = Guidance(GUIDANCE), normal

    def force(self, handle_mm: FloatArray, step_ns: int) -> FloatArray:
        """The force in N on the handle, ``step_ns`` after the last one."""
        place = handle_mm + GUIDANCE.range_mm * self._normal  # relaxed at the start
        planes = Constraint("tumor", [self._normal], [0.0], [place], [[0, 0, 0]], hold=False)
        return self._guidance.update(planes, place, step_ns)[:3]


Touch = SpringTouch | GuidanceTouch


def touched(
    device: Device, touch: Callable[[FloatArray], Touch], count: int, seed: int
) -> FloatArray:
    """Largest energy in J that each of ``count`` touches had got out of ``device`` (count,)."""
    random = np.random.default_rng(seed)
    normals = random.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    touches = [touch(normal) for normal in normals]
    stiffness = random.uniform(20.0, 600.0, (count, 1))
    damping = random.uniform(0.0, 4.0, (count, 1))
    change_s = random.uniform(0.02, 0.15, count)
    position, velocity = np.zeros((count, 3)), np.zeros((count, 3))
    target, changed = np.zeros((count, 3)), np.zeros(count)
    rendered, given = np.zeros((count, 3)), np.zeros(count)
    highest = np.zeros(count)
    waiting: list[tuple[int, FloatArray]] = []
    every = round(device.period_s / SUBSTEP_S)
    late = round(device.delay_s / SUBSTEP_S)
    # Exact response of a damped mass to a force that is constant for a substep.
    rate = device.damping_n_s_m / MASS_KG
    decay = np.exp(-rate * SUBSTEP_S)
    for step in range(round(TOUCH_S / SUBSTEP_S)):
        if step % every == 0:
            forces = [
                each.force(1000.0 * place, max(1, round(device.period_s * NS_PER_S)))
                for each, place in zip(touches, position, strict=True)
            ]
            waiting.append((step + late, np.array(forces)))
        while waiting and waiting[0][0] <= step:
            rendered = waiting.pop(0)[1]
        new = step * SUBSTEP_S - changed > change_s
        if new.any():
            changed[new] = step * SUBSTEP_S
            into = -normals[new] * random.uniform(-0.02, 0.05, (int(new.sum()), 1))
            target[new] = into + random.normal(0.0, 0.004, into.shape)
        hand = stiffness * (target - position) - damping * velocity
        terminal = (hand + rendered) / device.damping_n_s_m
        moved = terminal * SUBSTEP_S + (velocity - terminal) * (1.0 - decay) / rate
        velocity = terminal + (velocity - terminal) * decay
        position = position + moved
        given -= np.einsum("ij,ij->i", hand, moved)
        highest = np.maximum(highest, given)
    return highest
