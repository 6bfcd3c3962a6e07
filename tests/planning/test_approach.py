"""Approaches: valid between their samples too, within all limits, refused with a reason."""

import itertools
import math
from functools import cache

import numpy as np
import pytest
import trimesh

from app.geometry import FrameError, InputError, MarginGuardError, MeshError, SurfaceMesh, Transform
from app.planning import ApproachError, CollisionModel, MotionLimits, plan_approach, prove_path
from app.robot import JointType, robot_from_text
from tests.planning.approach_scenes import (
    LINKS,
    STEP_MM,
    CoalScene,
    arm_joints,
    limits_of,
    load,
    random_problem,
    random_queries,
    random_state,
)

pytestmark = pytest.mark.slow

ROBOTS = ("touch", "ur5", "panda")
CLEARANCE_MM = 2.0


def after(count):
    """A search that is over after so many questions, whatever the load of the machine."""
    asked = itertools.count()
    return lambda: next(asked) > count


def plan(robot, start, goal, structures, **changed):
    options = {"clearance_mm": CLEARANCE_MM, "limits": limits_of(robot), "is_over": after(3000)}
    return plan_approach(robot, start, goal, structures, **(options | changed))


def ball(robot, center, radius=20.0):
    shape = trimesh.creation.icosphere(3, radius)
    return SurfaceMesh(robot.root_link, shape.vertices + center, shape.faces)


@cache
def problem(name):
    """A robot among ten structures: robot, structures, start, goal and model."""
    robot = load(name)
    seed = {"touch": 207, "ur5": 3, "panda": 2}[name]  # whose first structures leave states free
    return robot, *random_problem(robot, np.random.default_rng(seed), CLEARANCE_MM)


def excess_mm(robot, structures, start, goal, step_mm=STEP_MM):
    """The least excess of a plan over its clearance, with its pair; by coal."""
    made = plan(robot, start, goal, structures)
    assert made.positions[0].tolist() == [start[joint] for joint in made.joints]
    assert made.positions[-1].tolist() == [goal[joint] for joint in made.joints]
    scene = CoalScene(robot, structures, step_mm)
    return scene.closest_mm(made.positions, made.held, made.joints, CLEARANCE_MM)


@pytest.fixture(scope="module")
def touch():
    return load("touch")


@pytest.fixture
def start(touch):
    return {**dict.fromkeys(touch.actuated_joint_names, 0.0), "elbow": 0.5, "waist": -0.5}


@pytest.mark.parametrize("name", ["touch", "panda"])
def test_coal_finds_the_clearance_kept(name):
    robot, structures, start, goal, _ = problem(name)
    excess, pair = excess_mm(robot, structures, start, goal, step_mm=1.5)
    assert excess > -1e-6, pair


def test_path_that_leads_through_structures_between_its_tests_is_searched_again(monkeypatch):
    from app.planning import path_search  # a reference in this module: OMPL reports leaks at exit

    robot, searches = load("touch"), []
    structures, queries, model = random_queries(robot, np.random.default_rng(207), CLEARANCE_MM)

    def search(*arguments):
        searches.append(tested_path(*arguments))
        return searches[-1]

    tested_path = path_search._tested_path
    monkeypatch.setattr(path_search, "_tested_path", search)
    monkeypatch.setattr(path_search, "ASSUMED_MM", 1e4)
    limits = tuple(
        np.array([getattr(robot.tree.joint(joint), side) for joint in model.joints])
        for side in ("lower", "upper")
    )
    scene, coarse = CoalScene(robot, structures, step_mm=2.0), 0.0
    for start, goal in queries:  # which of them leads through a structure depends on chance
        first, last = (np.array([each[joint] for joint in model.joints]) for each in (start, goal))
        path = path_search.find_path(model, first, last[None], limits, after(20_000))
        assert scene.closest_mm(path, {}, model.joints, CLEARANCE_MM)[0] > -1e-6
        if searches:
            coarse, _ = scene.closest_mm(searches[0], {}, model.joints, CLEARANCE_MM)
        if coarse < 0.0:
            break
        searches.clear()
    assert coarse < 0.0


def test_path_that_leads_away_from_start_and_goal_is_found_within_all_limits(monkeypatch):
    from app.planning import path_search

    robot = load("touch")
    _, queries, model = random_queries(robot, np.random.default_rng(207), CLEARANCE_MM)
    limits = tuple(
        np.array([getattr(robot.tree.joint(joint), side) for joint in model.joints])
        for side in ("lower", "upper")
    )
    monkeypatch.setattr(path_search, "_NEAR", 0.0)  # between start and goal alone
    monkeypatch.setattr(path_search, "_MOTIONS", 20)
    away = 0
    for start, goal in queries:
        ends = np.array([[each[joint] for joint in model.joints] for each in (start, goal)])
        path = path_search.find_path(model, ends[0], ends[1:], limits, after(20_000))
        assert (path >= limits[0]).all()
        assert (path <= limits[1]).all()
        away += bool((path < ends.min(axis=0)).any() or (path > ends.max(axis=0)).any())
    assert away


@pytest.mark.parametrize("name", ROBOTS)
def test_states_are_blocked_where_coal_finds_a_pair_too_near(name):
    robot, structures, _, _, model = problem(name)
    rng, scene = np.random.default_rng(8), CoalScene(robot, structures)
    blocked = 0
    for _ in range(15):
        state = random_state(robot, rng)
        held = {joint: value for joint, value in state.items() if joint not in model.joints}
        held |= {joint: robot.tree.joint(joint).upper for joint in held}
        positions = np.array([[state[joint] for joint in model.joints]])
        # A tiny motion, because coal's scene leaves out what does not move.
        positions = np.concatenate([positions, positions + 1e-9])
        excess, _ = scene.closest_mm(positions, held, model.joints, CLEARANCE_MM)
        if abs(excess) > 0.2:  # links may come nearer to each other than `SELF_CLEARANCE_MM`
            assert model.motion_keeps_clearance(*positions[[0, 0]]) == (excess > 0.0)
            blocked += excess < 0.0
    assert 2 < blocked < 13


def test_thin_obstacle_between_two_free_states_blocks_the_motion(touch, start):
    ends = [{**start, "waist": waist} for waist in (-0.5, 0.5)]
    tip = touch.forward_kinematics({**start, "waist": 0.0})["stylus"].translation_mm
    sheet = trimesh.creation.box((40.0, 0.02, 40.0))
    structures = {"sheet": SurfaceMesh(touch.root_link, sheet.vertices + tip, sheet.faces)}
    model = CollisionModel(touch, tuple(start), {}, structures, clearance_mm=0.01, carried={})
    states = [np.array(list(each.values())) for each in ends]
    assert model.contact_at(states[0]) is None
    assert model.contact_at(states[1]) is None
    assert not model.motion_keeps_clearance(*states)
    made = plan(touch, *ends, structures, clearance_mm=0.01)
    assert "not free" in made.reasons[1]


def test_trajectory_keeps_limits_of_velocity_acceleration_and_jerk():
    robot, structures, start, goal, _ = problem("panda")
    made = plan(robot, start, goal, structures)
    assert made.times_ns.dtype == np.int64
    steps_s = np.diff(made.times_ns) * 1e-9
    np.testing.assert_allclose(steps_s, steps_s[0])
    rates = [made.positions]
    for _ in range(3):
        rates.append(np.diff(rates[-1], axis=0) / steps_s[0])
    velocity = [robot.tree.joint(joint).dynamics.velocity for joint in made.joints]
    for rate, limit in zip(rates[1:], (velocity, 5.0, 50.0), strict=True):
        assert (np.abs(rate) <= np.array(limit) * (1.0 + 1e-6)).all()
    # One joint is at its limit of acceleration for some time: no time is wasted.
    assert np.abs(rates[2]).max() > 4.9
    middle = 0.5 * (made.velocities[1:] + made.velocities[:-1])
    np.testing.assert_allclose(middle, rates[1], atol=50.0 * steps_s[0] ** 2)
    assert made.velocities[[0, -1]].tolist() == [[0.0] * 7] * 2


def test_smaller_of_two_velocity_limits_holds(touch, start):
    limits = {joint: MotionLimits(5.0, 50.0, velocity=0.1) for joint in start}
    made = plan(touch, start, {"waist": 0.5}, {}, limits=limits)
    assert made.joints == ("waist",)
    assert np.abs(made.velocities).max() == pytest.approx(0.1, rel=1e-3)


@pytest.mark.parametrize("name", ROBOTS)
def test_goal_pose_of_the_tool_is_reached(name):
    robot, structures, start, goal, _ = problem(name)
    pose = robot.forward_kinematics({**start, **goal})[LINKS[name]]
    made = plan(robot, start, pose, structures)
    end = {**made.held, **dict(zip(made.joints, made.positions[-1].tolist(), strict=True))}
    reached = robot.forward_kinematics(end)[LINKS[name]]
    assert reached.distance_mm_to(pose) < 1e-6
    assert reached.angle_to(pose) < 1e-8
    assert set(made.joints) == set(arm_joints(robot))


def spinner(joint_type="continuous"):
    """A post with an arm of 200 mm that turns about it, and a wall on one side."""
    box = '<origin xyz="{} 0 0"/><geometry><box size="{} 0.02 0.02"/></geometry>'
    box = f"<collision>{box}</collision>"
    text = (
        f'<robot name="spinner"><link name="post">{box.format(0, 0.02)}</link>'
        f'<link name="arm">{box.format(0.15, 0.1)}</link>'
        f'<joint name="turn" type="{joint_type}"><parent link="post"/><child link="arm"/>'
        '<axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint></robot>'
    )
    return robot_from_text(text)


def test_continuous_joint_reaches_its_goal_the_other_way_round():
    robot = spinner()
    made = plan(robot, {"turn": -2.5}, {"turn": 2.5}, {})
    assert made.positions[-1, 0] == pytest.approx(2.5 - math.tau)
    wall = {"wall": ball(robot, [-150.0, 0.0, 0.0])}
    made = plan(robot, {"turn": -2.5}, {"turn": 2.5}, wall)
    assert made.positions[-1, 0] == pytest.approx(2.5)
    with pytest.raises(ApproachError, match="no path found in the time allowed"):
        walls = wall | {"other": ball(robot, [150.0, 0.0, 0.0])}
        plan(robot, {"turn": -2.0}, {"turn": 2.0}, walls, is_over=after(200))


def test_start_that_is_the_goal_needs_no_time(touch, start):
    made = plan(touch, start, start, {})
    assert made.times_ns.tolist() == [0]
    assert made.positions.tolist() == [list(start.values())]


def test_positions_stay_within_the_limits():
    robot = spinner("revolute")
    made = plan(robot, {"turn": -2.9}, {"turn": 2.9}, {})
    assert np.abs(made.positions).max() == pytest.approx(2.9)


def test_carried_body_is_kept_clear_too(touch, start):
    tool = trimesh.creation.cylinder(3.0, 100.0)
    tool.apply_translation([0.0, 0.0, 120.0])
    carried = {"probe": SurfaceMesh("stylus", tool.vertices, tool.faces)}
    pose = touch.forward_kinematics(start)["stylus"]
    blocked = {"ball": ball(touch, pose.apply(np.array([0.0, 0.0, 120.0])))}
    plan(touch, start, {"waist": -0.4}, blocked)
    with pytest.raises(ApproachError, match=r"^start: probe is 0\.00 mm from ball; expected"):
        plan(touch, start, {"waist": -0.4}, blocked, carried=carried)


@pytest.mark.parametrize("corners", [3, 4])
def test_flat_body_is_carried_too(touch, start, corners):
    square = [[-5.0, 0.0, 120.0], [5.0, 0.0, 120.0], [0.0, 0.0, 130.0], [0.0, 0.0, 110.0]]
    faces = [[0, 1, 2], [1, 0, 3]][: corners - 2]
    carried = {"sheet": SurfaceMesh("stylus", square[:corners], faces)}
    pose = touch.forward_kinematics(start)["stylus"]
    far = {"ball": ball(touch, pose.apply(np.array([0.0, 0.0, 1000.0])))}
    plan(touch, start, {"waist": -0.4}, far, carried=carried)
    blocked = {"ball": ball(touch, pose.apply(np.array([0.0, 0.0, 120.0])))}
    with pytest.raises(ApproachError, match=r"^start: sheet is 0\.00 mm from ball; expected"):
        plan(touch, start, {"waist": -0.4}, blocked, carried=carried)


def test_arm_inside_a_structure_is_in_collision(touch, start):
    around = {"room": ball(touch, [0.0, 0.0, 100.0], radius=2000.0)}
    with pytest.raises(ApproachError, match=r"^start: \w+ is 0\.00 mm from room"):
        plan(touch, start, {"waist": 0.0}, around)


def test_plan_is_valid_for_the_ids_that_it_was_made_from(touch, start):
    made = plan(touch, start, {"waist": 0.0}, {}, made_from={"registration": "7"})
    assert made.is_valid_for({"registration": "7"})
    assert not made.is_valid_for({"registration": "8"})
    assert not made.is_valid_for({"registration": "7", "structure": "1"})
    assert not plan(touch, start, {"waist": 0.0}, {}).is_valid_for({})


def test_search_that_is_over_ends_with_an_error(touch, start):
    tip = touch.forward_kinematics({**start, "waist": 0.0})["stylus"].translation_mm
    blocked = {"ball": ball(touch, tip)}
    answers = itertools.chain([False] * 3, itertools.repeat(True))
    with pytest.raises(ApproachError, match="no path found in the time allowed"):
        plan(touch, start, {"waist": 0.5}, blocked, is_over=lambda: next(answers))


FAR = Transform("touch_base", "stylus", np.eye(3), [5000.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("changed", "error", "text"),
    [
        ({"start": {"wrong": 0.0}}, InputError, "start: joint 'wrong' is unknown; expected waist"),
        ({"start": {"waist": 0.0}}, InputError, "start: joint 'shoulder' has no position"),
        ({"goal": {"waist": 2.0}}, InputError, "goal: joint 'waist' is at 2; expected -1.3 to 1.3"),
        ({"goal": {"waist": math.nan}}, InputError, "goal: joint 'waist' is at nan; expected -1.3"),
        ({"goal": {}}, InputError, "goal: moves no joint; expected at least one"),
        ({"goal": FAR}, ApproachError, "goal: link 'stylus' cannot be moved to"),
        ({"clearance_mm": math.inf}, InputError, "clearance: is inf mm; expected a number above 0"),
        ({"clearance_mm": 0.0}, InputError, "clearance: is 0.0 mm; expected a number above 0"),
        ({"limits": {}}, InputError, "joint 'waist': has no acceleration and jerk limit"),
    ],
)  # fmt: skip
def test_bad_input_is_named_in_one_line(touch, start, changed, error, text):
    values = {"start": start, "goal": {"waist": 0.0}, "structures": {}} | changed
    with pytest.raises(error) as raised:
        plan(touch, values.pop("start"), values.pop("goal"), values.pop("structures"), **values)
    assert str(raised.value).startswith(text)
    assert "; expected" in str(raised.value)


def test_start_and_goal_in_collision_name_link_and_structure(touch, start):
    at = {**start, "waist": 0.5}
    wrist = touch.forward_kinematics(at)["wrist"].translation_mm
    structures = {"spine": ball(touch, wrist, radius=5.0)}
    with pytest.raises(ApproachError, match=r"^goal: \w+ is 0\.00 mm from spine; expected at"):
        plan(touch, start, {"waist": 0.5}, structures)
    with pytest.raises(ApproachError, match=r"^start: \w+ is 0\.00 mm from spine; expected at"):
        plan(touch, at, {"waist": -0.5}, structures)


def test_structures_are_closed_and_in_the_root_frame(touch, start):
    shape = ball(touch, [0.0, 0.0, 900.0])
    opened = SurfaceMesh(shape.frame, shape.vertices_mm, shape.faces[1:])
    with pytest.raises(MeshError, match="structure 'skin' is not closed"):
        plan(touch, start, {"waist": 0.0}, {"skin": opened})
    other = SurfaceMesh("tracker", shape.vertices_mm, shape.faces)
    with pytest.raises(FrameError, match="structure 'skin': is in 'tracker'; expected the robot's"):
        plan(touch, start, {"waist": 0.0}, {"skin": other})


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_motion_limits_are_finite_and_positive(value):
    with pytest.raises(MarginGuardError, match=r"jerk limit: is .*; expected a number above 0"):
        MotionLimits(1.0, value)


@pytest.mark.parametrize(
    ("acceleration", "problem"),
    [(1e-300, "give no motion; expected larger"), (1e-7, "takes .* s; expected larger ones")],
)
def test_limits_that_make_a_motion_endless_are_refused(touch, start, acceleration, problem):
    limits = limits_of(touch) | {"waist": MotionLimits(acceleration, 50.0)}
    with pytest.raises(InputError, match=f"motion limits: .*{problem}"):
        plan(touch, start, {"waist": start["waist"] + 0.3}, {}, limits=limits)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e308])
def test_state_without_a_place_is_not_proven(touch, start, value):
    structures = {"ball": ball(touch, [0.0, 0.0, 900.0])}
    bodies = {"clearance_mm": CLEARANCE_MM, "carried": {}}
    joints, good = tuple(start), np.array(list(start.values()))
    model = CollisionModel(touch, joints, {}, structures, **bodies)
    bad = np.where(np.array(joints) == "waist", value, good)
    for test in (model.contact_at, model.distances_mm):
        with pytest.raises(InputError, match=r"joint positions: are .*; expected finite numbers"):
            test(bad)
    for ends in ((good, bad), (bad, good)):
        with pytest.raises(InputError, match=r"joint positions: are .*; expected finite numbers"):
            model.motion_keeps_clearance(*ends)
    for at in range(3):
        states = np.array([bad if number == at else good for number in range(3)])
        with pytest.raises(InputError, match=r"joint positions: are .*; expected finite numbers"):
            prove_path(touch, joints, {}, states, structures, **bodies)


def test_motion_whose_bound_overflows_is_not_proven():
    box = (
        '<collision><origin xyz="{0} 0 0"/><geometry><box size="{0} 0.02 0.02"/></geometry>'
        "</collision>"
    )
    follow = '<mimic joint="j1" multiplier="1e200"/>'
    shapes, rules = ("", "", "", box.format(0.1)), ("", "", follow, follow)
    text, above = f'<link name="post">{box.format(0.02)}</link>', "post"
    for number, (shape, rule) in enumerate(zip(shapes, rules, strict=True)):
        text += (
            f'<link name="l{number}">{shape}</link><joint name="j{number}" type="continuous">'
            f'<parent link="{above}"/><child link="l{number}"/><axis xyz="0 0 1"/>{rule}</joint>'
        )
        above = f"l{number}"
    robot = robot_from_text(f'<robot name="fast">{text}</robot>')
    swept = {"ball": ball(robot, [0.0, 100.0, 0.0], radius=5.0)}
    model = CollisionModel(robot, ("j0", "j1"), {}, swept, clearance_mm=1.0, carried={})
    assert model.blocking_bodies(np.zeros(2), np.array([0.0, 1.0])) == ("l3", "ball")


@pytest.mark.parametrize("value", [math.nan, math.inf, 0.0, -1.0])
def test_path_is_not_proven_for_a_clearance_that_is_none(touch, start, value):
    states = np.array([list(start.values())] * 2)
    with pytest.raises(InputError, match=r"clearance: is .* mm; expected a number above 0"):
        prove_path(touch, tuple(start), {}, states, {}, clearance_mm=value, carried={})


def test_held_position_that_puts_a_link_nowhere_is_refused():
    robot = load("panda")
    slide = next(
        joint.name
        for joint in robot.tree.joints
        if joint.name in robot.actuated_joint_names and joint.type is JointType.PRISMATIC
    )
    joints = tuple(name for name in robot.actuated_joint_names if name != slide)
    states = np.zeros((2, len(joints)))
    with pytest.raises(InputError, match=r"; expected .* links within 1e\+12 mm of the root"):
        prove_path(robot, joints, {slide: 1e308}, states, {}, clearance_mm=1.0, carried={})


def test_path_of_another_planner_is_proven_or_refused(touch, start):
    made = plan(touch, start, {"waist": 0.5}, {})
    bodies = {"carried": {}, "clearance_mm": CLEARANCE_MM}
    tip = touch.forward_kinematics({**start, "waist": 0.0})["stylus"].translation_mm
    away, near = ball(touch, tip + np.array([0.0, 0.0, 300.0])), ball(touch, tip)
    prove_path(touch, made.joints, made.held, made.positions, {"ball": away}, **bodies)
    with pytest.raises(ApproachError, match=r"path: after \d+ of \d+ parts .* from ball; expected"):
        prove_path(touch, made.joints, made.held, made.positions, {"ball": near}, **bodies)
    with pytest.raises(ApproachError, match="path: its proof was ended"):
        prove_path(
            touch, made.joints, made.held, made.positions, {}, **bodies, is_over=lambda: True
        )
    middle = made.positions[[len(made.positions) // 2] * 2]
    with pytest.raises(ApproachError, match=r"start: .* from ball; expected at least 2 mm"):
        prove_path(touch, made.joints, made.held, middle, {"ball": near}, **bodies)
