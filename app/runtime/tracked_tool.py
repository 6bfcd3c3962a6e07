"""The tools that operators calibrate, and touch points with."""

from enum import StrEnum

import numpy as np

from app.fixture import MarginState, Reason
from app.geometry import FloatArray, FrameError, InputError, Transform
from app.runtime.content import SessionContent
from app.session import StepResult

REFUSED = frozenset({Reason.SECOND_SENDER, Reason.IMPLAUSIBLE})
"""Faults with which a pose may not be the tool's."""


class TrackedTool(StrEnum):
    """A tracked tool with a tip; the value is its name in texts."""

    CAUTERY = "cautery"
    """The tool of the session, which the margin is computed for."""
    STYLUS = "stylus"
    """No distance depends on it."""


def tip_of(content: SessionContent, tool: TrackedTool) -> Transform:
    """The tip of ``tool`` in its tracked frame.

    Raises `InputError` without a stylus, and for one that is not calibrated.
    """
    return content.tool_from_tip if tool is TrackedTool.CAUTERY else content.known_stylus.tip


def stylus_text(content: SessionContent) -> str:
    """Distance of the stylus' tip from its sensor and its uncertainty; empty without a stylus."""
    stylus = content.stylus
    if stylus is None:
        return ""
    if stylus.frame_from_tip is None:
        return "not calibrated"
    length_mm = float(np.linalg.norm(stylus.frame_from_tip.translation_mm))
    sigma = f"sigma {stylus.sigma_mm:.2f} mm" if stylus.sigma_mm else "uncertainty not known"
    return f"tip {length_mm:.1f} mm from the sensor, {sigma}"


def tip_mm(
    step: StepResult | None, content: SessionContent, tool: TrackedTool, frame: str
) -> FloatArray:
    """The place (3,) of the tip of ``tool`` in ``frame``, that the tumour moves with.

    ``step`` is None where the present is not known. Raises `InputError` with why it is not known.
    """
    tip = tip_of(content, tool)
    if step is None:
        raise InputError(f"{tool}: the tip's place is UNKNOWN; expected a known one")
    if tool is TrackedTool.CAUTERY:
        place = step.tumor_from_tip
        if step.decision.state is MarginState.UNKNOWN or place is None:
            raise InputError(f"{tool}: the tip's place is UNKNOWN; expected a known one")
        return (content.frame_from_tumor @ place).translation_mm
    refused = sorted(reason.text for reason in REFUSED.intersection(step.decision.reasons))
    if refused:
        raise InputError(f"{tool}: {', '.join(refused)}; expected a known place of its tip")
    try:
        pose, oldest = step.edges.between(frame, tip.target)
    except FrameError as error:
        raise InputError(f"{tool}: {error}; expected a known place of its tip") from error
    if oldest is None:
        raise InputError(f"{tool}: it is not tracked; expected a known place of its tip")
    return pose.apply(tip.translation_mm)
