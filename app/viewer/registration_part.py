"""The part of the page on which operators register the robot: one registration, which all show."""

from collections.abc import Callable
from typing import Any

from app.runtime import (
    Compute,
    RobotRegistration,
    SessionContent,
    UseRegistration,
    fit_registration,
)
from app.runtime.workflow.guided_fits import GuidedFits
from app.viewer.readout.registration import registration_values


class RegistrationPart:
    """Detects the points of ``guide`` while they are touched. The page's thread owns it.

    ``use`` replaces the registration of the session.
    """

    def __init__(
        self,
        guide: RobotRegistration,
        compute: Compute,
        on_computed: Callable[[], None],
        use: UseRegistration,
    ) -> None:
        self.guide = guide
        self.use = use
        self._fits = GuidedFits(guide, fit_registration, compute, on_computed)

    @property
    def revision(self) -> object:
        """A value that changes when the page needs an update without a new step."""
        return self.guide.status().revision, self._fits.is_done

    def update(self, content: SessionContent) -> None:
        """Use the session's present content, take a fit that is done, and begin the next one."""
        self.guide.use_content(content)
        self._fits.follow()

    def values(self) -> dict[str, Any]:
        """The values of the page that belong to the last `update`."""
        values = registration_values(self.guide.status(), can_undo=self.guide.can_undo)
        return {"registration": values}

    def close(self) -> None:
        """End the thread."""
        self._fits.close()
