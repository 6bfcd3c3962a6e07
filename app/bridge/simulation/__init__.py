"""A simulated world as ROS nodes see it: arms, a tracker and the truth for judges."""

from app.bridge.simulation.hand_inputs import DeviceHand, JoyInput
from app.bridge.simulation.real_time import RealTime
from app.bridge.simulation.simulation_node import NODE_NAME, Hand, SimulationNode

__all__ = ["NODE_NAME", "DeviceHand", "Hand", "JoyInput", "RealTime", "SimulationNode"]
