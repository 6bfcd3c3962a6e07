"""Errors of worlds, of their physics and of commands to their arms."""

from app.geometry import InputError, MarginGuardError


class SimulationError(MarginGuardError):
    """Base class of the errors of this package."""


class WorldError(SimulationError, InputError):
    """A world file, or a robot or mesh that it names, cannot be simulated."""


class EditError(SimulationError, InputError):
    """A change of the bodies of a running world is refused; the world has not changed."""


class CommandError(SimulationError, InputError):
    """A command is not one for its arm. The arm stops and stays in `ArmStatus.FAULT`."""


class UnstableError(SimulationError):
    """The physics has diverged; the world must be reset."""
