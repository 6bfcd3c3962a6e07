"""Inputs of a calibration method, read from the files that the options name."""

import argparse
from functools import cached_property

from app.case import Case, open_case
from app.cli.calibration.recording import (
    Recording,
    TimeSpan,
    ToolTrack,
    extract_tool_track,
    open_recording,
)
from app.cli.calibration.tip import read_tip
from app.files import PlusConfiguration, read_plus_config
from app.geometry import Transform


class CalibrationInputs:
    """The inputs that ``options`` of ``marginguard calibrate METHOD`` name, each read on first use.

    A method may use only the properties that belong to its declared inputs: the options for the
    others do not exist. Every property raises `InputError` for a file that cannot be used.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        """Parsed command line, for options that only one method has."""

    @property
    def span(self) -> TimeSpan:
        """The part of the recording that is used."""
        return TimeSpan(self.options.from_s, self.options.to_s)

    @cached_property
    def case(self) -> Case:
        """The recording as a case, with the clock offset that the case states."""
        return open_case(self.options.recording, package_dirs=self.options.package_dirs)

    @cached_property
    def recording(self) -> Recording:
        """The frames of the recording within `span`."""
        return open_recording(
            self.options.recording,
            self.span,
            package_dirs=self.options.package_dirs,
            rate_hz=self.options.rate_hz,
        )

    @cached_property
    def tool_track(self) -> ToolTrack:
        """The poses of the tool in the reference frame (`Input.TOOL_TRACK`)."""
        return extract_tool_track(
            self.recording,
            tool=self.options.tool or self._tool_of_plus(),
            reference=self.options.reference,
            max_age_ms=self.options.max_age_ms,
        )

    @cached_property
    def plus_configuration(self) -> PlusConfiguration | None:
        """The PLUS configuration, or None if none was given (`Input.TIP`)."""
        path = self.options.plus_config
        return None if path is None else read_plus_config(path)

    def _tool_of_plus(self) -> str | None:
        """The tool of the PLUS configuration, if one was given and its recording has the frame."""
        if getattr(self.options, "plus_config", None) is None or self.plus_configuration is None:
            return None
        tool = self.plus_configuration.tool
        tracked = {source for _, source in self.recording.edges}
        return tool if tool in tracked else None

    @cached_property
    def tool_from_tip(self) -> Transform:
        """The tip of the tool (`Input.TIP` with `Input.TOOL_TRACK`)."""
        return read_tip(
            self.recording,
            self.tool_track.tool,
            tip_from=self.options.tip_from,
            plus=self.plus_configuration,
        )
