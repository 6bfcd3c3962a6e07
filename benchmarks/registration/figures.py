"""One figure of the benchmark, and values that several topics share."""

from dataclasses import dataclass

import numpy as np

from app.registration import PoseNoise

EM_NOISE = PoseNoise.from_rms(rotation_deg=0.3, translation_mm=0.5)


POSITION_NOISE = PoseNoise.from_rms(rotation_deg=1e-6, translation_mm=0.5)


FRAMES = {"fixed_frame": "fixed", "moving_frame": "moving"}


@dataclass(frozen=True)
class Figure:
    """One figure; ``good`` is None without a limit.

    Field names are the keys of the JSON output. ``wanted`` is the limit as text.
    """

    topic: str
    what: str
    ours: str
    wanted: str
    peer: str
    good: bool | None

    def __post_init__(self) -> None:
        if self.good is not None:
            object.__setattr__(self, "good", bool(self.good))


def rms(values: list[float]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
