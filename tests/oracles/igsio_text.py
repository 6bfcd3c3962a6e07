"""A second parser of IGSIO headers (``.igs.mha``), by regular expressions over the whole text.

Independent of `app.case.readers.igsio` and of the values of `app.geometry`: it shares neither code
nor the line-by-line approach, and yields the plain numbers of the file.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class IgsioSamples:
    """Samples of one transform: matrices (n, 4, 4) in mm and n statuses, in the file's order."""

    matrices: NDArray[np.float64]
    statuses: list[str]


def igsio_samples(path: Path, transform: str) -> IgsioSamples:
    """All samples of ``transform``, such as ``StylusToTracker``."""
    text = path.read_text(errors="replace")
    rows = re.findall(rf"Frame(\d+)_{transform}Transform = (.*)", text)
    statuses = dict(re.findall(rf"Frame(\d+)_{transform}TransformStatus = (\w+)", text))
    matrices = np.array([np.array(row.split(), float).reshape(4, 4) for _, row in rows])
    return IgsioSamples(matrices, [statuses[index] for index, _ in rows])


def igsio_times_s(path: Path) -> list[float]:
    """The ``Timestamp`` of every frame in s."""
    text = path.read_text(errors="replace")
    return [float(time) for time in re.findall(r"Frame\d+_Timestamp = (\S+)", text)]
