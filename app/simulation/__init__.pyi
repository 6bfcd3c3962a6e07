from .command_gate import COMMAND_LIFETIME_NS
from .commands import (
    ArmCommand,
    ArmStatus,
    JointPositionCommand,
    JointVelocityCommand,
    StateCommand,
    ToolPoseCommand,
    ToolTwistCommand,
    ToolWrenchCommand,
)
from .errors import CommandError, EditError, SimulationError, UnstableError, WorldError
from .hand import ScriptedHand
from .haptic_coupling import HapticCoupling, HapticParameters
from .manual_hands import KEYS, JoyHand, KeyHand
from .state import ArmState, Contact, WorldState, Wrench
from .tracker import TRACKER_FRAME, WorldTracker
from .world import World
from .world_entries import (
    BodyEntry,
    BreathingEntry,
    RobotEntry,
    TissueEntry,
    TissueShift,
    ToolEntry,
    TrackerEntry,
    WorldDescription,
)
from .world_file import WORLD, open_world, world_schema_text
from .world_hand import DeviceEntry, HandEntry, JoyEntry, Push

__all__ = [
    "COMMAND_LIFETIME_NS",
    "KEYS",
    "TRACKER_FRAME",
    "WORLD",
    "ArmCommand",
    "ArmState",
    "ArmStatus",
    "BodyEntry",
    "BreathingEntry",
    "CommandError",
    "Contact",
    "DeviceEntry",
    "EditError",
    "HandEntry",
    "HapticCoupling",
    "HapticParameters",
    "JointPositionCommand",
    "JointVelocityCommand",
    "JoyEntry",
    "JoyHand",
    "KeyHand",
    "Push",
    "RobotEntry",
    "ScriptedHand",
    "SimulationError",
    "StateCommand",
    "TissueEntry",
    "TissueShift",
    "ToolEntry",
    "ToolPoseCommand",
    "ToolTwistCommand",
    "ToolWrenchCommand",
    "TrackerEntry",
    "UnstableError",
    "World",
    "WorldDescription",
    "WorldError",
    "WorldState",
    "WorldTracker",
    "Wrench",
    "open_world",
    "world_schema_text",
]
