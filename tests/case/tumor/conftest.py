"""Label maps written by pynrrd, with the header fields of 3D Slicer."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import nrrd
import numpy as np
import pytest
from numpy.typing import NDArray

Volume = NDArray[Any]


def lps_header(**changes: object) -> dict[str, Any]:
    """Voxels of 1 x 2 x 3 mm; index (0, 0, 0) at (10, 20, 30) mm in LPS axes."""
    header: dict[str, Any] = {
        "space": "left-posterior-superior",
        "space directions": np.diag([1.0, 2.0, 3.0]),
        "space origin": np.array([10.0, 20.0, 30.0]),
        "encoding": "gzip",
    }
    return {name: value for name, value in (header | changes).items() if value is not None}


def segment_fields(number: int, name: str, *, label: int = 1, layer: int = 0) -> dict[str, str]:
    return {
        f"Segment{number}_ID": f"Segment_{number + 1}",
        f"Segment{number}_Name": name,
        f"Segment{number}_LabelValue": str(label),
        f"Segment{number}_Layer": str(layer),
    }


@pytest.fixture
def write_nrrd(tmp_path: Path) -> Callable[..., Path]:
    """Write ``voxels`` with `lps_header`, with ``changes``; None removes a field."""

    def write(voxels: Volume, *, name: str = "labels.nrrd", **changes: object) -> Path:
        path = tmp_path / name
        nrrd.write(str(path), voxels, lps_header(**changes))
        return path

    return write


@pytest.fixture
def block() -> Volume:
    """A block of ones in a volume of 6 x 7 x 8, with a single 2 away from it."""
    voxels = np.zeros((6, 7, 8), dtype=np.uint8)
    voxels[1:4, 2:5, 3:6] = 1
    voxels[5, 6, 7] = 2
    return voxels
