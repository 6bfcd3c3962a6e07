"""Which changes of a running session loosen what it permits, as texts for its operator.

A loosening latches a hold (`app.session.Session.use`), and looser margins apply only when an
operator who has seen the change re-arms. A change that only tightens takes effect at once.
"""

import math

from app.fixture import MarginParameters
from app.geometry import NS_PER_MS, Transform
from app.registration import RegistrationResult
from app.session.setup import RobotSetup, SessionSetup

LOOSER_BELOW = (
    "stop_mm",
    "warn_mm",
    "k_tre",
    "v_max_mm_s",
    "release_samples",
    "release_band_mm",
)
"""Margins whose lower value permits more, or ends a worse state earlier."""

LOOSER_ABOVE = ("stale_after_ns", "frozen_after_ns")
"""Margins whose higher value permits motion on older data."""


def loosenings(before: SessionSetup, after: SessionSetup, tumor_change: str = "") -> list[str]:
    """Texts of all that ``after`` loosens against ``before``; empty if it only tightens.

    One text each for margins, tool, tumour, robot, expected motion and tracker, so 6 at most.
    Every change of the tumour, the tool, the registration, the robot, the expected motion of the
    tumour or the errors of the tracker counts. ``tumor_change`` describes that of the tumour.
    """
    margins = loosened_margins(
        before.margins, after.margins, follows_tumor=after.tumor_motion is not None
    )
    found = [", ".join(margins)] if margins else []
    if before.tool_from_tip != after.tool_from_tip:
        found.append(_tip_change(before.tool_from_tip, after.tool_from_tip))
    if (before.proximity, before.frame_from_tumor) != (after.proximity, after.frame_from_tumor):
        found.append(tumor_change or "tumour replaced")
    elif after.tumor_sigma_mm < before.tumor_sigma_mm:
        found.append(
            f"uncertainty of the tumour lowered from {before.tumor_sigma_mm:.2f} to "
            f"{after.tumor_sigma_mm:.2f} mm"
        )
    if before.robot is not after.robot:
        found.append(_robot_change(before.robot, after.robot))
    if (before.tumor_motion, before.motion_frame) != (after.tumor_motion, after.motion_frame):
        found.append("expected motion of the tumour replaced")
    if before.tracking != after.tracking:
        found.append("latency or errors of the tracker replaced")
    return found


def tightest_margins(
    in_use: MarginParameters, requested: MarginParameters, *, follows_tumor: bool
) -> MarginParameters:
    """``requested`` without what loosens ``in_use``: what applies until a re-arm."""
    kept = {
        name: getattr(in_use, name)
        for name in MarginParameters.ranges()
        if _is_looser(name, in_use, requested, follows_tumor)
    }
    return requested.replaced(**kept)


def loosened_margins(
    before: MarginParameters, after: MarginParameters, *, follows_tumor: bool
) -> list[str]:
    """Texts of the margins that are looser in ``after``, such as "stop_mm lowered from 2 to 1".

    ``v_max_mm_s`` works both ways: a lower value adds less for the age of the data, a higher one
    lets the tool follow a receding tumour faster, in a session that ``follows_tumor``.
    """
    return [
        change_text(name, getattr(before, name), getattr(after, name))
        for name in MarginParameters.ranges()
        if _is_looser(name, before, after, follows_tumor)
    ]


def _is_looser(
    name: str, before: MarginParameters, after: MarginParameters, follows_tumor: bool
) -> bool:
    old, new = getattr(before, name), getattr(after, name)
    higher_is_looser = name in LOOSER_ABOVE or (name == "v_max_mm_s" and follows_tumor)
    return bool((name in LOOSER_BELOW and new < old) or (higher_is_looser and new > old))


def margin_changes(before: MarginParameters, after: MarginParameters) -> list[str]:
    """Texts of all margins that differ."""
    values = ((name, getattr(before, name), getattr(after, name)) for name in before.ranges())
    return [change_text(name, old, new) for name, old, new in values if old != new]


def change_text(name: str, old: float, new: float) -> str:
    """Name a margin as in `case.yaml`, times in ms, with its old and new value."""
    if name.endswith("_ns"):
        name, old, new = name.removesuffix("_ns") + "_ms", old / NS_PER_MS, new / NS_PER_MS
    return f"{name} {'lowered' if new < old else 'raised'} from {_number(old)} to {_number(new)}"


def _number(value: float) -> str:
    """All digits of ``value``: two different numbers have different texts."""
    return repr(int(value)) if float(value).is_integer() else repr(float(value))


def _tip_change(before: Transform, after: Transform) -> str:
    if (before.target, before.source) != (after.target, after.source):
        return "calibration of the tool replaced"
    return f"calibration of the tool replaced: {tip_change_text(before, after)}"


def tip_change_text(before: Transform, after: Transform) -> str:
    """How far a tip is moved, and how far its frame is turned."""
    shift_mm, turn_deg = before.distance_mm_to(after), math.degrees(before.angle_to(after))
    return f"the tip is moved by {shift_mm:.2f} mm and its axis turned by {turn_deg:.2f} degrees"


def moved_text(what: str, before: Transform, after: Transform) -> str:
    """How far ``what`` is moved and turned between two poses of the same frames."""
    shift_mm, turn_deg = before.distance_mm_to(after), math.degrees(before.angle_to(after))
    return f"{what} is moved by {shift_mm:.2f} mm and turned by {turn_deg:.2f} degrees"


def _robot_change(before: RobotSetup | None, after: RobotSetup | None) -> str:
    if before is None or after is None:
        return "robot added" if before is None else "robot removed"
    old, new = before.registration, after.registration
    if old is new:
        return "robot replaced"
    if old is None or new is None:
        return "registration set" if old is None else "registration removed"
    return f"registration replaced: {_registration_change(old, new)}"


def _registration_change(old: RegistrationResult, new: RegistrationResult) -> str:
    fre = "FRE not known" if new.fre_mm is None else f"FRE {new.fre_mm:.2f} mm"
    text = f"{moved_text('the base', old.transform, new.transform)}, {fre}"
    return f"{text}, uncertainty not known" if new.covariance is None else text
