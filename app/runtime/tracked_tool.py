"""The tools that operators calibrate, and touch with: names, places and distances of tips."""

from collections.abc import Mapping

from app.case import DISPLAY_ITEMS, ItemKind
from app.fixture import MarginState, Reason, margin_surface
from app.geometry import FloatArray, FrameError, InputError, SurfaceMesh, Transform
from app.runtime.content import SessionContent
from app.session import AxisDistances, StepResult

REFUSED = frozenset({Reason.SECOND_SENDER, Reason.IMPLAUSIBLE})
"""Faults with which a pose may not be the tool's."""


GUARDED_TOOL = "cautery"
"""Name in texts of the tool of the session, which the margin is computed for."""


def tool_names() -> tuple[str, ...]:
    """Names of the tracked tools with a tip: the guarded one, and the pointers of display items."""
    pointers = (each.name for each in DISPLAY_ITEMS if each.kind is ItemKind.POINTER)
    return GUARDED_TOOL, *pointers


def tools_of(content: SessionContent) -> tuple[str, ...]:
    """Those of `tool_names` that a session has."""
    return GUARDED_TOOL, *(each.name for each in content.items if each.is_pointer)


def tip_of(content: SessionContent, tool: str) -> Transform:
    """The tip of ``tool`` in its tracked frame.

    Raises `InputError` for a pointer that the session does not have, or that is not calibrated.
    """
    return content.tool_from_tip if tool == GUARDED_TOOL else content.item(tool).tip


def tip_mm(step: StepResult | None, content: SessionContent, tool: str, frame: str) -> FloatArray:
    """The place (3,) of the tip of ``tool`` in ``frame``, that the tumour moves with.

    ``step`` is None where the present is not known. Raises `InputError` with why it is not known.
    """
    tip = tip_of(content, tool)
    if step is None:
        raise InputError(f"{tool}: the tip's place is UNKNOWN; expected a known one")
    if tool == GUARDED_TOOL:
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


class TipDirections:
    """Measures along the axes of the tumour's frame. It keeps the tables of the last surface."""

    def __init__(self) -> None:
        self._distances: AxisDistances | None = None

    def at(
        self, step: StepResult, content: SessionContent, stop_surface: SurfaceMesh | None
    ) -> Mapping[str, float | None]:
        """Distances in mm by letter, as `AxisDistances.at`; empty while they are not known.

        ``stop_surface``: the surface at the stop margin; None while it is not computed. The
        tumour's own is used for a margin of 0.
        """
        decision = step.decision
        surface = content.tumor if content.margins.stop_mm == 0.0 else stop_surface
        is_known = decision.proximity is not None and decision.proximity.is_finite
        is_known = is_known and decision.state is not MarginState.UNKNOWN
        if surface is None or step.tumor_from_tip is None or not is_known:
            return {}
        if self._distances is None or self._distances.surface is not surface:
            self._distances = AxisDistances(surface)
        return self._distances.at(step.tumor_from_tip.translation_mm)


_SPACING_MM = 1.0
"""Coarse, because the translucent surface is drawn many times a second."""


def stop_surface(content: SessionContent) -> SurfaceMesh | None:
    """The surface ``stop_mm`` outside the tumour; None for a margin of 0. Takes about a second."""
    stop_mm = content.margins.stop_mm
    return margin_surface(content.tumor, stop_mm, spacing_mm=_SPACING_MM) if stop_mm > 0.0 else None
