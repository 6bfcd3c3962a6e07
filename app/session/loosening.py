"""Changes of a running session that loosen its permissions, as texts for its operator.

A loosening latches a hold (`app.session.Session.use`). A change that only tightens takes effect at
once.
"""

from dataclasses import replace

from app.geometry import Transform
from app.hold import loosened_margins, moved_text, tip_change_text
from app.registration import RegistrationResult
from app.session.setup import RobotSetup, SessionSetup

_UNDONE = "a change that loosened the session was undone"


class AcknowledgedSetup:
    """The setup of the start or of the last re-arm, or a tighter one, and what differs from it."""

    def __init__(self, setup: SessionSetup) -> None:
        self._setup = setup
        self._tumor_change = ""
        self.changes: tuple[str, ...] = ()
        """Texts of all that an operator has to acknowledge."""

    def change(self, before: SessionSetup, after: SessionSetup, tumor_change: str) -> bool:
        """Note the change from ``before`` to ``after``; True if it loosens and has to be latched.

        ``tumor_change`` describes the new tumour against the one of the last re-arm.
        """
        self._tumor_change = tumor_change or self._tumor_change
        loosens = bool(loosenings(before, after))
        if not loosens and not self.changes:
            self._setup = after  # tightening needs no consent
            return False
        # Nor does an added structure, which is missed when it is replaced or off before the re-arm.
        known = {each.name for each in (*self._setup.structures, *before.structures)}
        added = tuple(each for each in after.structures if each.name not in known)
        self._setup = replace(self._setup, structures=(*self._setup.structures, *added))
        self.changes = tuple(loosenings(self._setup, after, self._tumor_change) or [_UNDONE])
        return loosens

    def acknowledge(self, setup: SessionSetup) -> None:
        """An operator has seen the changes, and has re-armed with ``setup``."""
        self._setup = setup
        self._tumor_change = ""
        self.changes = ()


def loosenings(before: SessionSetup, after: SessionSetup, tumor_change: str = "") -> list[str]:
    """Texts of all that ``after`` loosens against ``before``; empty if it only tightens.

    One text each for margins, tool, tumour, further structures, robot, expected motion and tracker.
    Every change of the tumour, the tool, the registration, the robot, the expected motion of the
    tumour or the errors of the tracker counts. ``tumor_change`` describes that of the tumour.
    """
    margins = loosened_margins(
        before.margins, after.margins, follows_tumor=after.tumor_motion is not None
    )
    found = [", ".join(margins)] if margins else []
    if before.tool_from_tip != after.tool_from_tip:
        found.append(_tip_change(before.tool_from_tip, after.tool_from_tip))
    elif after.tip_sigma_mm < before.tip_sigma_mm:
        found.append(_lowered("tip", before.tip_sigma_mm, after.tip_sigma_mm))
    if (before.proximity, before.frame_from_tumor) != (after.proximity, after.frame_from_tumor):
        found.append(tumor_change or "tumour replaced")
    elif after.tumor_sigma_mm < before.tumor_sigma_mm:
        found.append(_lowered("tumour", before.tumor_sigma_mm, after.tumor_sigma_mm))
    found += _structure_changes(before, after)
    if before.robot is not after.robot:
        found.append(_robot_change(before.robot, after.robot))
    if (before.tumor_motion, before.motion_frame) != (after.tumor_motion, after.motion_frame):
        found.append("expected motion of the tumour replaced")
    if before.tracking != after.tracking:
        found.append("latency or errors of the tracker replaced")
    return found


def _structure_changes(before: SessionSetup, after: SessionSetup) -> list[str]:
    """One text each for a further structure that is off or gone, replaced or guarded by less."""
    kept = {each.name: each for each in after.structures}
    found = []
    for old in before.structures:
        new = kept.get(old.name)
        if new is None:
            reason = after.off.get(old.name)
            gone = "removed" if reason is None else f"switched off: {reason}"
            found.append(f"structure {old.name!r} {gone}")
            continue
        changes = [
            f"{name} lowered from {getattr(old, name):g} to {getattr(new, name):g}"
            for name in ("stop_mm", "warn_mm", "sigma_mm")
            if getattr(new, name) < getattr(old, name)
        ]
        what = f"structure {old.name!r}: "
        if (old.proximity, old.frame_from_structure) != (new.proximity, new.frame_from_structure):
            what, changes = "", [new.change or f"{what}replaced", *changes]
        if changes:
            found.append(f"{what}{', '.join(changes)}")
    return found


def _lowered(what: str, before_mm: float, after_mm: float) -> str:
    return f"uncertainty of the {what} lowered from {before_mm:.2f} to {after_mm:.2f} mm"


def _tip_change(before: Transform, after: Transform) -> str:
    if (before.target, before.source) != (after.target, after.source):
        return "calibration of the tool replaced"
    return f"calibration of the tool replaced: {tip_change_text(before, after)}"


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
