"""Margins of the fixture, the same in ``case.yaml`` and in ``live.yaml``."""

from dataclasses import dataclass
from typing import Annotated

from app.case.manifest.key_rules import YEAR_MS
from app.files.declared import block_of
from app.files.document import Section
from app.files.keys import Integer, Number
from app.geometry import InputError

SESSION_LIMITS = (
    "a session accepts stop_mm up to 100, warn_mm up to 200, k_tre up to 10, "
    "v_max_mm_s up to 1000, stale_after_ms up to 10000, release_samples up to 1000, "
    "release_band_mm up to 10, frozen_after_ms up to 60000"
)


@dataclass(frozen=True, slots=True)
class MarginEntry:
    """The margins of the fixture, and the limits of freshness.

    A better state is entered only after ``release_samples`` samples that lie ``release_band_mm``
    beyond the boundary. A pose that is constant for ``frozen_after_ns`` is frozen.
    """

    stop_mm: Annotated[
        float,
        Number("distance at which the approach stops; must be less than warn_mm", minimum=0.0),
    ]
    warn_mm: Annotated[
        float,
        Number("distance below which the state is WARNING; must be more than stop_mm", minimum=0.0),
    ]
    k_tre: Annotated[
        float,
        Number("multiple of the registration's sigma that is added to both distances", minimum=0.0),
    ]
    v_max_mm_s: Annotated[
        float,
        Number(
            "maximum speed of approach; times the age of the data, added to both distances",
            minimum=0.0,
        ),
    ]
    stale_after_ns: Annotated[
        int, Number("age above which data are stale", above=0.0, maximum=YEAR_MS)
    ]
    release_samples: Annotated[
        int, Integer("number of consecutive better samples that end a worse state", 1, default=3)
    ]
    release_band_mm: Annotated[
        float,
        Number(
            "by how much the distance must exceed the threshold to count as better",
            default=0.5,
            minimum=0.0,
        ),
    ]
    frozen_after_ns: Annotated[
        int,
        Number(
            "time after which a pose that does not change counts as frozen",
            default=1000.0,
            above=0.0,
            maximum=YEAR_MS,
        ),
    ]

    def check(self, block: Section) -> None:
        """Raise `InputError` unless the warning comes before the stop."""
        if self.warn_mm <= self.stop_mm:
            raise InputError(
                f"{block.place('warn_mm')} is {self.warn_mm:g}; "
                f"expected more than stop_mm ({self.stop_mm:g})"
            )


MARGINS = block_of(
    MarginEntry,
    "margins of the fixture, and the age at which data are stale",
    rules=("warn_mm is more than stop_mm", SESSION_LIMITS),
)
