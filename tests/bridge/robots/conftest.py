"""Small robot with a revolute, a prismatic and a mimic joint."""

import pytest

from app.robot import robot_from_text

LIMIT = '<limit lower="-3" upper="3" effort="1" velocity="1"/>'
URDF = f"""<robot name="arm">
  <link name="base"/><link name="arm"/><link name="slide"/><link name="finger"/><link name="tip"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
    <origin xyz="0 0 0.1" rpy="0.1 0.2 0.3"/><axis xyz="0 0 1"/>{LIMIT}</joint>
  <joint name="push" type="prismatic"><parent link="arm"/><child link="slide"/>
    <origin xyz="0.2 0 0"/><axis xyz="1 1 0"/>{LIMIT}</joint>
  <joint name="follow" type="revolute"><parent link="base"/><child link="finger"/>
    <origin xyz="0 0.3 0"/><axis xyz="1 0 0"/>{LIMIT}
    <mimic joint="turn" multiplier="-2" offset="0.5"/></joint>
  <joint name="end" type="fixed"><parent link="slide"/><child link="tip"/>
    <origin xyz="0 0 0.05"/></joint>
</robot>"""


@pytest.fixture
def urdf():
    return URDF


@pytest.fixture
def robot(urdf):
    return robot_from_text(urdf)
