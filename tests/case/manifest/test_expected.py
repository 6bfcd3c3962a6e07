from pathlib import Path

import numpy as np
import pytest

from app.case import (
    Expected,
    ExpectedBreach,
    ExpectedBreaches,
    ExpectedDropout,
    ExpectedRegistration,
    load_expected,
    write_expected,
)
from app.geometry import InputError, Transform


def load(path: Path) -> Expected:
    return load_expected(path, reference="reference", robot_base="base")


def test_written_values_are_read_back(tmp_path: Path) -> None:
    pose = Transform.from_rotation_vector(
        [0.1, -0.7, 2.0], [1e-7, 5, -3], target="reference", source="base"
    )
    expected = Expected(
        ExpectedRegistration(pose, 1.0, 0.5),
        ExpectedBreaches(
            40.0, 0.5, (ExpectedBreach(1.0, 2.5, -3.25, True), ExpectedBreach(4.0, 4.5, -0.5))
        ),
        (ExpectedDropout("needle", "missing", 0.5, 0.75),),
        frames=120,
    )
    write_expected(tmp_path / "expected.yaml", expected)
    read = load(tmp_path / "expected.yaml")
    assert read.registration is not None
    np.testing.assert_allclose(
        read.registration.reference_from_base.matrix, pose.matrix, atol=1e-14
    )
    assert (read.breaches, read.dropouts, read.frames) == (
        expected.breaches,
        expected.dropouts,
        120,
    )
    assert [p.name for p in tmp_path.iterdir()] == ["expected.yaml"]


def test_all_blocks_are_optional(tmp_path: Path) -> None:
    (tmp_path / "e.yaml").write_text("{}\n")
    assert load(tmp_path / "e.yaml") == Expected()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("breach: {}", "breach is unknown"),
        ("frames: 1.5", "frames is 1.5"),
        ("breaches: {tolerance_ms: 1, intervals: []}", "depth_tolerance_mm is missing"),
        ("dropouts: [{frame: a, kind: gone, start_s: 1, end_s: 2}]", r"dropouts\[0\].kind"),
        (
            "dropouts: [{frame: a, kind: missing, start_s: 3, end_s: 2}]",
            r"expected start_s \(3\) or later",
        ),
    ],
)
def test_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "e.yaml").write_text(text)
    with pytest.raises(InputError, match=message):
        load(tmp_path / "e.yaml")
