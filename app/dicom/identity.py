"""Patient, study and unique identifiers: the same for the same input, without a clock."""

import datetime
import re
import uuid
from dataclasses import dataclass

from app.geometry import InputError

_NAMESPACE = uuid.UUID("6c1e3d0a-2c0f-5d5e-9a56-0f0f7f1c8b52")
_SEPARATORS = re.compile(r"[\\^=\x00-\x1f\x7f]+")
_MAX_CHARS = 64
_UID = re.compile(r"(0|[1-9]\d*)(\.(0|[1-9]\d*))+")


@dataclass(frozen=True, slots=True)
class Identity:
    """Whose structures they are, and of which study.

    ``patient`` is name and ID. ``content`` is a digest of everything that the files contain: it
    makes the UIDs, so that other content has other UIDs. ``space`` is a digest of what the
    coordinates refer to. ``frame_of_reference_uid`` replaces the UID made from it where the
    coordinates are those of images that exist. ``date`` is that of the study, or unknown.
    """

    patient: str
    content: str
    space: str
    frame_of_reference_uid: str | None = None
    date: datetime.date | None = None

    def __post_init__(self) -> None:
        given = self.frame_of_reference_uid
        if given is not None and not (_UID.fullmatch(given) and len(given) <= _MAX_CHARS):
            raise InputError(
                f"frame of reference: {given!r}; expected a DICOM UID of 64 digits and dots at most"
            )

    @property
    def frame_of_reference(self) -> str:
        """UID of the frame of reference of all files."""
        return self.frame_of_reference_uid or make_uid("frame of reference", self.space)

    def uid(self, what: str) -> str:
        """UID of ``what``, a name within this study."""
        return make_uid(what, self.content)

    @property
    def patient_text(self) -> str:
        """``patient`` without the separators of DICOM, 64 characters at most."""
        text = " ".join(_SEPARATORS.sub(" ", self.patient).split())
        return text[:_MAX_CHARS].strip() or "unknown"

    @property
    def person_name(self) -> str:
        """``patient_text`` as a family name without a given name."""
        return f"{self.patient_text[: _MAX_CHARS - 1]}^"

    @property
    def date_text(self) -> str:
        """``YYYYMMDD``, empty if it is not known."""
        return "" if self.date is None else self.date.strftime("%Y%m%d")


def make_uid(*parts: str) -> str:
    """UID that only depends on ``parts``: a name-based UUID below 2.25 (DICOM PS3.5, B.2)."""
    name = "\n".join(parts)
    return f"2.25.{uuid.uuid5(_NAMESPACE, name).int}"
