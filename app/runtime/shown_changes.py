"""Changes of what a session shows: no state, distance, constraint or hold depends on them."""

from collections.abc import Callable
from dataclasses import replace

from app.geometry import InputError, Transform
from app.hold import tip_change_text
from app.runtime.content import SessionContent

ShownChange = Callable[[SessionContent], tuple[SessionContent, str]]
"""From a content to the changed one, with a text on the change. Raises `InputError`."""


def longer_needle(by_mm: float) -> ShownChange:
    """Show the needle longer by ``by_mm``; refused without one and for a length out of range."""

    def change(content: SessionContent) -> tuple[SessionContent, str]:
        known = content.needle
        if known is None:
            raise InputError("needle: the session has none; expected 'needle' in live.yaml")
        needle = known.with_length(known.length_mm + by_mm)
        text = f"from {known.length_mm:g} to {needle.length_mm:g} mm"
        return replace(content, needle=needle), text

    return change


def other_depth(depth_mm: float) -> ShownChange:
    """Place images that are stamped from now on by the calibration of ``depth_mm``.

    Refused without listed depths, and for a depth that is not listed.
    """

    def change(content: SessionContent) -> tuple[SessionContent, str]:
        known = content.image_depth
        if known is None:
            raise InputError(
                "depth of the images: the session has one calibration; expected "
                "'images.calibrations' in live.yaml"
            )
        depth = known.chosen(depth_mm)
        text = f"from {known.depth_mm:g} to {depth.depth_mm:g} mm"
        return replace(content, image_depth=depth), text

    return change


def other_stylus_tip(frame_from_tip: Transform, sigma_mm: float) -> ShownChange:
    """Use this tip of the stylus; refused without a stylus, and as `Stylus.with_tip`."""

    def change(content: SessionContent) -> tuple[SessionContent, str]:
        known = content.known_stylus
        stylus = known.with_tip(frame_from_tip, sigma_mm)
        before = known.frame_from_tip
        text = "the first tip" if before is None else tip_change_text(before, frame_from_tip)
        return replace(content, stylus=stylus), f"{text}, sigma {sigma_mm:.2f} mm"

    return change
