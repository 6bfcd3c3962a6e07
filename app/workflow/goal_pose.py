"""A goal for the tool of a session's robot: an operator moves it, and the arm follows."""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from app.geometry import FloatArray, FrameError, InputError, MarginGuardError, Transform
from app.robot import IkOptions, UnreachableError
from app.runtime import SessionContent
from app.session import RobotSetup, StepResult
from app.workflow.approach_ghost import ApproachGhost, sendable

if TYPE_CHECKING:
    from app.planning import CollisionModel

_RESTARTS = 10
"""Further starts of inverse kinematics: one that fails must not delay the display."""

Answer = Callable[[str, str], None]
"""Takes the JSON of a plan, and a problem; one of them is empty."""

Plan = Callable[[Mapping[str, float], float, Answer], Callable[[], None]]
"""Plans an approach to joint positions with a clearance in mm, and answers in any thread.

Returns a function that cancels it.
"""


@dataclass(frozen=True, slots=True)
class GoalShown:
    """Texts of a goal; ``problem`` is the reason why the arm is not at it, empty if it is.

    ``is_active`` while there is a goal, ``can_plan`` if an approach to it can be asked for.
    ``status``: what has become of the last approach.
    """

    is_active: bool
    place: str
    problem: str
    status: str
    can_plan: bool


class GoalPose:
    """The goal ``root_from_link`` of the tool's link. It moves nothing: ``plan`` asks for a plan.

    The structures stand where they were at `hold`. Call it in the display's thread.
    """

    def __init__(self, plan: Plan, planned: Callable[[str], None]) -> None:
        self._plan, self._planned = plan, planned
        self._answers: deque[tuple[object, str, str]] = deque()
        self._content: SessionContent | None = None
        self._step: StepResult | None = None
        self.pose: Transform | None = None
        """The goal; None without one."""
        self._model: CollisionModel | None = None
        self._joints: Mapping[str, float] = {}
        self._reached: Mapping[str, float] = {}
        """The joints that move the tool's link, at the goal."""
        self._clearance_mm = 0.0
        self._silent = self._problem = self._status = ""
        self._request: object | None = None
        """The request for a plan whose answer is awaited; answers of all others are dropped."""
        self._cancel: Callable[[], None] = lambda: None
        self.links: Mapping[str, Transform] = {}
        """``root_from_link`` of the arm at the goal, or at the last one that it reaches."""
        self.revision = 0
        """Changes when a display has to be updated without a step."""

    def update(self, content: SessionContent, step: StepResult, silent: str) -> None:
        """Use the session's present, and a plan that has come; another content ends the goal.

        ``silent``: why the step is not the present, or empty.
        """
        known = self._content
        self._content, self._step, self._silent = content, step, silent
        if self.pose is not None and known is not content:
            self.end()
        while self._answers:
            request, text, problem = self._answers.popleft()
            if request is not self._request:
                continue
            self._request = None
            try:
                if not problem:
                    self._planned(text)
                    self.end()  # the plan's way is shown instead
            except InputError as error:
                problem = str(error)
            self._status = sendable(problem) or "planned; nothing has moved"

    def begin(self, clearance_mm: float) -> None:
        """Put the goal where the tool is now; `shown` says why not if that is not known."""
        self.revision += 1
        try:
            robot, step = self._robot()
        except InputError as error:
            self._status = str(error)
            return
        links = step.links
        if self._silent or robot.tool_link not in links:
            why = self._silent or "the robot's joints are not known"
            self._status = f"goal: {why}; expected the present place of the tool"
            return
        measured = {} if step.joints is None else step.joints.as_mapping()
        known = robot.robot.actuated_joint_names
        self._joints = {name: at for name, at in measured.items() if name in known}
        self._drop_request()
        self._clearance_mm, self._status = clearance_mm, ""
        self.links = dict(links)
        self.pose = links[robot.tool_link]
        self.hold()
        self._solve()

    def end(self) -> None:
        """Remove the goal; a request for its plan is cancelled."""
        self._drop_request()
        self.pose, self._model, self.links = None, None, {}
        self._problem = self._status = ""
        self.revision += 1

    def hold(self) -> None:
        """Look where the structures are now."""
        self._model = None

    @property
    def place_mm(self) -> FloatArray | None:
        """The goal of the tip (3,) in the root link; None without one."""
        return None if self.pose is None else self.pose.translation_mm

    def place(self, rotation: FloatArray, place_mm: FloatArray) -> None:
        """Move the goal, of ``rotation`` (3, 3), with its tip at ``place_mm`` in the root link.

        A request for a plan is cancelled: it is for the earlier place.
        """
        if self.pose is not None:
            if self._drop_request():
                self._status = "cancelled: the goal has moved; plan again"
            self.pose = Transform(self.pose.target, self.pose.source, rotation, place_mm)
            self._solve()

    def move_to(self, place_mm: FloatArray) -> None:
        """Move the goal's tip to ``place_mm`` (3,) in the root link."""
        if self.pose is not None:
            self.place(self.pose.rotation, place_mm)

    def turn(self, vector_rad: FloatArray) -> None:
        """Turn the goal about its tip by ``vector_rad`` (3,), along the axes of the root link."""
        if self.pose is not None:
            goal, root = self.pose, self.pose.target
            turn = Transform.from_rotation_vector(vector_rad, np.zeros(3), target=root, source=root)
            self.place(turn.rotation @ goal.rotation, goal.translation_mm)

    def links_before(self, ghost: ApproachGhost) -> Mapping[str, Transform]:
        """The links to draw: of the goal, unless there is none or an arm executes a plan."""
        return self.links if self.links and not ghost.is_executed else ghost.links

    def plan(self) -> None:
        """Ask for an approach to the goal. Raises `InputError` while the arm is not at it."""
        if self.pose is None or self._problem:
            raise InputError(f"goal: {self._problem or 'there is none'}; expected a free one")
        if self._request is not None:
            raise InputError("goal: an approach is being planned; expected its end")
        self._request, self._status = object(), "planning..."
        self.revision += 1
        answer = partial(self._answer, self._request)
        self._cancel = self._plan(dict(self._reached), self._clearance_mm, answer)

    def shown(self) -> GoalShown | None:
        """Texts at the last `update`; None for a session without a registered robot."""
        content = self._content
        if content is None or content.robot is None or content.registration is None:
            return None
        place = ""
        if self.pose is not None:
            x, y, z = self.pose.translation_mm.round(1).tolist()
            place = f"{x:g}, {y:g}, {z:g} mm from the root of the robot"
        can_plan = self.pose is not None and not self._problem and self._request is None
        return GoalShown(self.pose is not None, place, self._problem, self._status, can_plan)

    def _drop_request(self) -> bool:
        """Cancel the request for a plan; True if there was one."""
        dropped, self._request = self._request is not None, None
        if dropped:
            self._cancel()
        return dropped

    def _answer(self, request: object, text: str, problem: str) -> None:
        self._answers.append((request, text, problem))
        self.revision += 1

    def _robot(self) -> tuple[RobotSetup, StepResult]:
        content, step = self._content, self._step
        if content is None or step is None or content.robot is None:
            raise InputError("goal: the session has no robot; expected one")
        if content.registration is None:
            raise InputError("robot: its base is not registered; expected a registration")
        return content.robot, step

    def _solve(self) -> None:
        """Follow the goal with the arm, or keep it and say why not."""
        self.revision += 1
        try:
            setup, step = self._robot()
            robot, goal = setup.robot, self.pose
            assert goal is not None  # the callers have checked it
            try:
                self._reached = robot.inverse_kinematics(
                    goal.source, goal, seed=self._joints, options=IkOptions(restarts=_RESTARTS)
                )
            except UnreachableError as error:
                raise InputError(f"out of reach: {error}") from error
            known = {**self._joints, **self._reached}
            self._joints = dict.fromkeys(robot.actuated_joint_names, 0.0) | known
            self.links = robot.forward_kinematics(self._joints)
            if self._model is None:
                self._model = _model(setup, self._content, step, self._clearance_mm)
            state = np.array([self._joints[name] for name in self._model.joints])
            contact = self._model.contact_at(state)
            self._problem = "" if contact is None else f"collision: {contact}"
        except MarginGuardError as error:
            self._problem = str(error)


def _model(
    setup: RobotSetup, content: SessionContent | None, step: StepResult, clearance_mm: float
) -> "CollisionModel":
    """The robot among the structures at ``step``, with the tool's mesh if its place is known."""
    from app.planning import CollisionModel  # slow to load, and only a goal needs it

    assert content is not None
    robot = setup.robot
    try:
        structures = {
            name: mesh.transformed(
                step.edges.between(setup.base_frame, name)[0].renamed(target=robot.root_link)
            )
            for name, mesh in content.surfaces.items()
        }
    except FrameError as error:
        raise FrameError(f"collisions are not tested: {error}") from error
    carried = {}
    if content.tool is not None and setup.link_from_tip is not None:
        carried["tool"] = content.tool.transformed(setup.link_from_tip)
    return CollisionModel(
        robot,
        robot.actuated_joint_names,
        {},
        structures,
        clearance_mm=clearance_mm,
        carried=carried,
    )
