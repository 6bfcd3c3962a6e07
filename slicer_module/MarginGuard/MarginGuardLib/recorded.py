"""A recorded case as the panel opens it."""

from dataclasses import dataclass
from pathlib import Path

from app.case import ImageSource, open_case_images
from app.runtime import PreparedCase, prepare_case
from app.session import BreachList
from app.workflow import recorded_breaches


@dataclass(frozen=True, slots=True, eq=False)
class RecordedCase:
    """``breaches`` are those of the whole recording, ``images`` None without any."""

    case: PreparedCase
    breaches: BreachList
    images: ImageSource | None = None


def prepare_recorded(folder: Path) -> RecordedCase:
    """Open and register the case and step through it; an empty recording is refused here."""
    case = prepare_case(folder)
    _ = case.extent
    return RecordedCase(case, recorded_breaches(case), open_case_images(case.case))
