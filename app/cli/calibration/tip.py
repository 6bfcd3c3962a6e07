"""The tip of a tool, read from a file of its own, a PLUS configuration or the case."""

from pathlib import Path

from app.cli.calibration.recording import Recording
from app.files import PlusConfiguration, read_plus_config, read_transform
from app.geometry import InputError, Transform


def tip_frame_of(tool: str) -> str:
    """Name of the tip's frame: ``stylus_tip`` for ``stylus``."""
    return f"{tool}_tip"


def read_tip(
    recording: Recording, tool: str, *, tip_from: Path | None, plus: PlusConfiguration | None
) -> Transform:
    """``tool_from_tip``, from ``tip_from``, else ``plus``, else the case of ``recording``.

    Raises `InputError` if none of them has it.
    """
    tip = tip_frame_of(tool)
    if tip_from is not None and tip_from.suffix.lower() == ".xml":
        return read_plus_config(tip_from).transform(tool, tip)
    if tip_from is not None:
        return read_transform(tip_from, target=tool, source=tip)
    if plus is not None:
        return plus.transform(tool, tip)
    case = recording.case
    if case is not None and case.manifest.tool.frame == tool:
        return case.manifest.tool.tool_from_tip
    raise InputError(f"tip of {tool!r}: not known; expected --tip-from FILE or --plus-config FILE")
