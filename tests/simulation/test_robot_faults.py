"""Robots that cannot be simulated are refused in one line that names link or joint."""

from pathlib import Path

import pytest

from app.robot import load_robot
from app.simulation import World, WorldError
from tests.simulation.conftest import arm, world_of

GOOD = """<robot name="test">
  <link name="base"/>
  <link name="rod"><inertial><mass value="0.5"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="swing" type="revolute"><parent link="base"/><child link="rod"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="3" velocity="2"/>
    <dynamics damping="0.1"/></joint>
</robot>"""

FAULTS = {
    'value="0.5"': ('value="0"', r"link 'rod' of robot 'arm' has a mass of 0 kg; expected more"),
    'mass value="0.5"': ('mass value="-1"', r"has a mass of -1 kg; expected more than 0"),
    'ixx="0.01"': ('ixx="0.5"', r"has the principal moments of inertia .*; expected moments above"),
    'izz="0.01"': ("", r"has the principal moments of inertia nan, .*; expected moments above 0"),
    'effort="3"': ('effort="0"', r"joint 'swing' of robot 'arm' has the effort limit 0\.0; expect"),
    'damping="0.1"': ('damping="-1"', r"joint 'swing' of robot 'arm' has damping -1 and friction"),
}


def built(folder: Path, text: str) -> World:
    path = folder / "robot.urdf"
    path.write_text(text)
    robot = load_robot(path)
    return World(world_of(arm(robot, density_kg_m3=None, max_effort=None)))


@pytest.mark.parametrize("part", FAULTS)
def test_fault_is_refused_in_one_line(tmp_path, part):
    change, message = FAULTS[part]
    assert GOOD.count(part) == 1
    with pytest.raises(WorldError, match=message) as refused:
        built(tmp_path, GOOD.replace(part, change))
    assert "\n" not in str(refused.value)


def test_file_without_fault_gives_its_limits_to_the_drives(tmp_path):
    world = built(tmp_path, GOOD)
    assert world.model.actuator_forcerange.tolist() == [[-3.0, 3.0]]
    assert world.model.jnt_range.tolist() == [[-1.0, 1.0]]
    assert world.model.body_mass[world.model.body("arm/rod").id] == 0.5


def test_link_without_inertial_needs_a_density(tmp_path):
    start, end = GOOD.index("<inertial>"), GOOD.index("</inertial>") + len("</inertial>")
    box = '<collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision>'
    text = GOOD[:start] + box + GOOD[end:]
    with pytest.raises(WorldError, match=r"link 'rod' of robot 'arm' has no mass; expected one in"):
        built(tmp_path, text)
    robot = load_robot(tmp_path / "robot.urdf")
    world = World(world_of(arm(robot, density_kg_m3=500.0)))
    rod = world.model.body("arm/rod").id
    assert world.model.body_mass[rod] == pytest.approx(3.0)
    moments = sorted(world.model.body_inertia[rod].tolist())
    assert moments == pytest.approx([0.25 * s for s in (0.05, 0.1, 0.13)])
