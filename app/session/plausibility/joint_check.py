"""Joints against tracker: the independent measurement of the tool's pose by its robot."""

from collections.abc import Mapping

from app.geometry import Stamp, Transform
from app.registration import RegistrationDrift, check_drift
from app.session.plausibility.mean_drift import SHARE_OF_BOUND, MeanDrift
from app.session.setup import RobotSetup


class JointCheck:
    """Compares the tracked tip with its prediction by joints and registration.

    ``mean_mm`` is the limit of `MeanDrift`; None takes `SHARE_OF_BOUND` of the bound of a single
    difference.
    """

    def __init__(self, robot: RobotSetup | None, mean_mm: float | None) -> None:
        self._robot = robot
        self._reference_from_root = _reference_from_root(robot)
        bound_mm = 1.0 if robot is None else robot.max_drift.translation_mm
        self._mean = MeanDrift(SHARE_OF_BOUND * bound_mm if mean_mm is None else mean_mm)
        self._drift: RegistrationDrift | None = None
        self._silent = False

    @property
    def is_configured(self) -> bool:
        """True if the robot has joints and a registration: it can contradict the tracker."""
        robot = self._robot
        return robot is not None and not robot.follows_tool and robot.registration is not None

    @property
    def is_silent(self) -> bool:
        """True if the configured joints are not known now: nothing checks the tracker."""
        return self._silent

    def drifts(self) -> dict[str, str]:
        """The last difference and the mean that are beyond their limits, one line each, by name.

        A drift does not end when the joint states stop.
        """
        drifts = {}
        if self._drift is not None and not self._drift.accepted:
            drifts["single"] = self._drift.reason
        if self._mean.exceeded:
            drifts["mean"] = self._mean.text
        return drifts

    def update(
        self, links: Mapping[str, Transform], reference_from_tip: Transform | None, now: Stamp
    ) -> RegistrationDrift | None:
        """Difference at ``now`` between the tracked ``reference_from_tip`` and its prediction.

        ``links`` are ``root_from_link``, empty while the joints are not known. None where one of
        the two is not known.
        """
        self._silent = self.is_configured and not links
        robot = self._robot
        if (
            robot is None
            or robot.follows_tool
            or self._reference_from_root is None
            or not links
            or reference_from_tip is None
        ):
            return None
        link = self._reference_from_root @ links[robot.tool_link]
        # Without a known mount the link gives the tip's position, not its orientation.
        predicted = (
            Transform.unchecked(
                link.target,
                reference_from_tip.source,
                reference_from_tip.rotation,
                link.translation_mm,
            )
            if robot.link_from_tip is None
            else link @ robot.link_from_tip
        )
        x, y, z = (reference_from_tip.translation_mm - predicted.translation_mm).tolist()
        self._mean.update((x, y, z), now)
        self._drift = check_drift(predicted, reference_from_tip, robot.max_drift)
        return self._drift


def _reference_from_root(robot: RobotSetup | None) -> Transform | None:
    """The registration with the base renamed to the robot's root link: they are one frame."""
    if robot is None or robot.registration is None:
        return None
    return robot.registration.transform.renamed(source=robot.robot.root_link)
