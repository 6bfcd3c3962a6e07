"""A planned approach beside a session: the robot at one of its times, as displays draw it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.control import Plan, PlannedMotion, named_faults, parse_plan, read_plan
from app.geometry import NS_PER_S, InputError, MarginGuardError, Transform
from app.planning import shown_samples
from app.runtime import SessionContent

_MAX_TEXT = 300


@dataclass(frozen=True, slots=True, eq=False)
class ShownPlan:
    """A plan as displays show it: ``motion`` at its samples ``samples`` (k,).

    ``nearest`` (k) are the nearest structure there and its distance in mm from the robot; empty
    where no structure is tested, None in a plan without distances. ``clearance_mm`` is proven for
    the whole way.
    """

    motion: PlannedMotion
    samples: NDArray[np.intp]
    nearest: tuple[tuple[str, float], ...] | None
    clearance_mm: float

    @classmethod
    def of(cls, plan: Plan, place: str) -> "ShownPlan":
        """``plan`` for a display. Raises `InputError`, which names ``place``, for a fault."""
        with named_faults(place):
            return cls(plan.motion, *_preview(plan))


def _preview(plan: Plan) -> tuple[NDArray[np.intp], tuple[tuple[str, float], ...] | None, float]:
    """Samples, nearest structures and clearance of ``plan``, checked."""
    preview, count = plan.values.get("preview"), len(plan.motion.times_ns)
    clearance_mm = float(plan.values["clearance_mm"])
    if not np.isfinite(clearance_mm):
        raise ValueError("clearance_mm is not finite")
    if preview is None:
        return shown_samples(count), None, clearance_mm
    samples = np.array(preview["samples"])
    nearest = tuple((name, float(mm)) for name, mm in preview["nearest"])
    shown = samples.size
    if not all(isinstance(name, str) for name, _ in nearest):
        raise TypeError("the name of a structure is no text")
    if samples.dtype != np.int64 or samples.ndim != 1 or (np.diff(samples) <= 0).any():
        raise TypeError("samples of the preview are no increasing integers")
    if shown == 0 or samples[0] < 0 or samples[-1] >= count or len(nearest) not in (0, shown):
        raise ValueError(
            f"preview has {shown} samples of 0 to {count - 1}, and {len(nearest)} distances"
        )
    if not np.isfinite([mm for _, mm in nearest]).all():
        raise ValueError("a distance is not finite")
    return samples, nearest, clearance_mm


@dataclass(frozen=True, slots=True)
class GhostShown:
    """Texts of a plan; ``problem`` is the reason why it is not drawn, empty if it is.

    ``place`` of 0 to ``last`` is the number of the time that is drawn. ``title``: where the plan
    is from.
    """

    title: str
    problem: str
    place: int
    last: int
    time: str
    nearest: str
    clearance: str


class ApproachGhost:
    """The plan of a file, or the one that an arm is executing now, which goes first.

    Call it in the display's thread, `execute` in any one.
    """

    def __init__(self) -> None:
        self._chosen: ShownPlan | None = None
        self._executed: ShownPlan | str | None = None
        """A text is the reason why the executed plan cannot be read."""
        self._drawn: ShownPlan | str | None = None
        self._content: SessionContent | None = None
        self._place = self._drawn_place = 0
        self._problem = self._title = self._source = ""
        self.links: Mapping[str, Transform] = {}
        """``root_from_link`` at the shown time; another object at another time, empty without."""
        self.revision = 0
        """Changes when a display has to be updated without a step."""

    def read(self, path: Path) -> None:
        """Use the plan of a file, at its goal. Raises `InputError` for a file that is none."""
        self._chosen, self._source = ShownPlan.of(read_plan(path), str(path)), "plan of a file"
        self.revision += 1

    def choose(self, text: str) -> None:
        """Use the plan in ``text``, at its goal. Raises `InputError` for a text that is none."""
        self._chosen, self._source = ShownPlan.of(parse_plan(text), "plan"), "plan to the goal"
        self.revision += 1

    @property
    def is_executed(self) -> bool:
        """True while an arm executes a plan."""
        return self._executed is not None

    def remove(self) -> None:
        """Show no plan of a file."""
        self._chosen = None
        self.revision += 1

    def execute(self, text: str) -> None:
        """Use the plan in ``text``, which an arm executes from now on; none if it is empty."""
        try:
            self._executed = ShownPlan.of(parse_plan(text), "plan") if text else None
        except InputError as error:
            self._executed = str(error)
        self.revision += 1

    def go_to(self, place: int) -> None:
        """Show the robot at the time of number ``place``; the last one if there are fewer."""
        self._place = place
        self.revision += 1

    def update(self, content: SessionContent) -> None:
        """Compare the plan with ``content``, the session's present one."""
        executed = self._executed
        plan = self._chosen if executed is None else executed
        self._title = self._source if executed is None else "the arm executes this plan"
        self._place = _last(plan) if plan is not self._drawn else min(self._place, _last(plan))
        drawn = self._drawn, self._content, self._drawn_place
        if drawn == (plan, content, self._place):
            return
        self._drawn, self._content, self._drawn_place = plan, content, self._place
        self._problem, self.links = "", {}
        try:
            if isinstance(plan, str):
                raise InputError(plan)
            if plan is not None:
                self.links = _links(plan, content, self._place)
        except MarginGuardError as error:
            self._problem = str(error)

    def shown(self) -> GhostShown | None:
        """Texts of the plan at the last `update`; None without one."""
        plan = self._drawn
        if plan is None:
            return None
        if isinstance(plan, str) or self._problem:
            return GhostShown(self._title, sendable(self._problem), 0, 0, "", "", "")
        times_ns, at = plan.motion.times_ns, plan.samples[self._drawn_place]
        nearest = "no structure" if plan.nearest is not None else "no distances in the plan"
        if plan.nearest:
            name, distance_mm = plan.nearest[self._drawn_place]
            nearest = sendable(f"{distance_mm:.1f} mm from {name}")
        return GhostShown(
            self._title,
            "",
            self._drawn_place,
            _last(plan),
            f"{times_ns[at] / NS_PER_S:.2f} of {times_ns[-1] / NS_PER_S:.2f} s",
            nearest,
            f"at least {plan.clearance_mm:g} mm on the whole way",
        )


def sendable(text: str) -> str:
    """The beginning of ``text``, which may have any length, and characters that UTF-8 has not."""
    return text[:_MAX_TEXT].encode(errors="replace").decode()


def _last(plan: ShownPlan | str | None) -> int:
    return len(plan.samples) - 1 if isinstance(plan, ShownPlan) else 0


def _links(plan: ShownPlan, content: SessionContent, place: int) -> Mapping[str, Transform]:
    """Poses at the time of number ``place``; `InputError` for a plan of another setup."""
    motion = plan.motion
    if content.robot is None:
        raise InputError(f"plan: is of robot {motion.robot!r}; expected a session with a robot")
    robot = content.robot.robot
    if motion.robot != robot.name:
        raise InputError(f"plan: is of robot {motion.robot!r}; expected {robot.name!r}")
    if {*motion.joints, *motion.held} != set(robot.actuated_joint_names):
        raise InputError(
            f"plan: has the joints {', '.join((*motion.joints, *motion.held))}; expected "
            f"{', '.join(robot.actuated_joint_names)}"
        )
    check_setup(motion.setup_id, content)
    if content.registration is None:
        raise InputError("robot: its base is not registered; expected a registration")
    state = motion.positions[plan.samples[place]].tolist()
    return robot.forward_kinematics({**motion.held, **dict(zip(motion.joints, state, strict=True))})


def check_setup(setup_id: str, content: SessionContent) -> None:
    """Raise `InputError` for a plan that is not of the setup of ``content``."""
    if not setup_id:
        raise InputError("plan: has no setup_id; expected one made with --guard")
    if setup_id != content.setup_id:
        raise InputError(
            f"plan: is of the setup {setup_id!r}; expected {content.setup_id!r} of the guard, or a "
            "new plan"
        )
