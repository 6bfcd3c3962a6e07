"""Closed loops stay closed under motion and load, by the solref that the model states."""

import numpy as np
import pytest

from app.robot import AdfError, load_robot
from app.simulation import JointVelocityCommand, World, WorldError
from app.simulation.world_model import STIFF_SOLREF
from tests.simulation.conftest import PARALLELOGRAMS, arm, world_of

pytestmark = pytest.mark.long

MAX_GAP_MM = 0.05


@pytest.mark.parametrize("force_n", [0.0, 20.0])
@pytest.mark.parametrize("name", ["parallelogram", "two_arms"])
def test_loops_stay_closed_while_the_arm_moves(name, force_n):
    robot = load_robot(PARALLELOGRAMS / f"{name}.yaml")
    world = World(world_of(arm(robot, collision="none")))
    equality = world.model.eq_solref
    assert np.array_equal(equality, np.tile(STIFF_SOLREF, (len(equality), 1)))
    joints = robot.actuated_joint_names
    instrument = next(link.name for link in robot.links if "roll" in link.name)
    row = world.model.body(f"arm/{instrument}").id
    world.data.xfrc_applied[row, :3] = force_n * np.array([0.6, 0.64, 0.48])
    largest, reached = 0.0, 0.0
    for step in range(1500):
        speed = 2.0 * float(np.cos(2.0 * np.pi * step / 1500))
        velocities = tuple(0.1 * speed if "insertion" in each else speed for each in joints)
        state = world.step({"arm": JointVelocityCommand(world.time_ns, joints, velocities)})
        links = state.arms["arm"].links
        reached = max(reached, float(np.abs(state.arms["arm"].positions).max()))
        for each in robot.closures:
            gap_mm, _ = each.gap(links[each.parent].matrix, links[each.child].matrix)
            largest = max(largest, gap_mm)
    assert reached > 0.4
    assert largest <= MAX_GAP_MM
    assert largest > 0.0


def test_loop_that_cannot_close_is_refused_in_one_line(tmp_path):
    text = (PARALLELOGRAMS / "parallelogram.yaml").read_text()
    broken = text.replace(
        "parent pivot: {x: 0.2, y: 0.0, z: 0.0}", "parent pivot: {x: 3.0, y: 0.0, z: 0.0}"
    )
    assert broken != text
    path = tmp_path / "broken.yaml"
    path.write_text(broken)
    with pytest.raises((AdfError, WorldError), match=r"loop|joint") as refused:
        World(world_of(arm(load_robot(path))))
    assert "\n" not in str(refused.value)
