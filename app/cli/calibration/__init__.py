"""Calibrations from a recording: methods, inputs, results; here the declaration of a method."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from app.cli.calibration.calibration_inputs import CalibrationInputs
    from app.cli.calibration.calibration_result import CalibrationResult


class Input(Enum):
    """Input of a method beside the recording. It decides which options the method has."""

    TOOL_TRACK = auto()
    """Poses of one tracked tool: ``--tool``, ``--reference``, ``--max-age-ms``."""
    TIP = auto()
    """Position of the tool's tip: ``--tip-from``, ``--plus-config``."""
    JOINTS = auto()
    """Joint positions of a robot: the recording has to be a case with ``robot.joint_states``."""


@dataclass(frozen=True, slots=True)
class CalibrationMethod:
    """One calibration method.

    ``name``
        METHOD on the command line.
    ``summary``
        What the method finds, as a noun phrase without a full stop.
    ``inputs``
        What it reads beside the recording.
    ``run``
        Computes the result. Raises `InputError` for input that cannot be used.
    ``add_arguments``
        Declares options that only this method has.
    ``finds_clock_offset``
        True if the result is an offset between clocks and not a transform. ``--save`` then writes
        YAML only.
    """

    name: str
    summary: str
    inputs: frozenset[Input]
    run: "Callable[[CalibrationInputs], CalibrationResult]"
    add_arguments: Callable[[argparse.ArgumentParser], None] = lambda parser: None
    finds_clock_offset: bool = False
