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
from .errors import CommandError, SimulationError, UnstableError, WorldError
from .hand import ScriptedHand
from .state import ArmState, Contact, WorldState, Wrench
from .tracker import WorldTracker
from .world import World
from .world_entries import (
    BodyEntry,
    BreathingEntry,
    HandEntry,
    Push,
    RobotEntry,
    TissueEntry,
    TissueShift,
    ToolEntry,
    TrackerEntry,
    WorldDescription,
)
from .world_file import open_world
from .world_keys import WORLD, world_schema_text

__all__ = [
    "COMMAND_LIFETIME_NS",
    "WORLD",
    "ArmCommand",
    "ArmState",
    "ArmStatus",
    "BodyEntry",
    "BreathingEntry",
    "CommandError",
    "Contact",
    "HandEntry",
    "JointPositionCommand",
    "JointVelocityCommand",
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
