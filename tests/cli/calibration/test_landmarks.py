"""``calibrate landmarks`` on a real recording, compared with the registration published with it."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from app.files import read_transform
from app.geometry import Transform
from tests.cli.calibration.recordings import TIP_MM, frames, write_igsio
from tests.cli.command import refused, run, run_json
from tests.cli.real_case import CONFIGURATION, PUBLISHED, RECORDING, plus_transform

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def plus(shared_data: Path) -> Path:
    return shared_data / "plus"


def arguments(plus: Path, *more: object) -> list[object]:
    return ["calibrate", "landmarks", plus / RECORDING, *more]


def test_landmarks_reproduce_the_published_registration(plus, tmp_path):
    saved, plot = tmp_path / "PhantomToReference.tfm", tmp_path / "residuals.png"
    options = ("--plus-config", plus / CONFIGURATION, "--save", saved, "--plot", plot)
    found = run_json(*arguments(plus, *options))
    assert found["transform"]["name"] == "PhantomToReference"
    assert found["numbers"]["matched"] == found["numbers"]["landmarks"] == 8
    published = Transform.from_matrix(
        plus_transform(plus / PUBLISHED, "Phantom"), target="reference", source="phantom"
    )
    pose = read_transform(saved, target="reference", source="phantom")
    assert pose.distance_mm_to(published) <= 0.10
    assert np.degrees(pose.angle_to(published)) <= 0.30
    assert np.mean(found["residuals"]["values"]) <= 0.21
    assert found["residuals"]["labels"] == [f"#{number}" for number in range(1, 9)]
    assert found["elapsed_s"] > 0.0
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_landmarks_may_come_from_slicer_and_the_tip_from_its_own_file(plus, tmp_path):
    """Six of eight landmarks, in LPS, renamed and reversed: two dwells match no landmark."""
    text = (plus / CONFIGURATION).read_text()
    points = [
        entry.split('"')[1].split() for entry in text.split("<Landmark ")[1:]
        for entry in [entry.split("Position=")[1]]
    ]  # fmt: skip
    controls = [
        {"label": f"F-{n}", "position": [-float(x), -float(y), float(z)]}
        for n, (x, y, z) in list(enumerate(points, start=1))[5::-1]
    ]
    landmarks = tmp_path / "phantom.mrk.json"
    landmarks.write_text(
        json.dumps({"markups": [{"coordinateSystem": "LPS", "controlPoints": controls}]})
    )
    tip = tmp_path / "tip.txt"
    np.savetxt(tip, plus_transform(plus / CONFIGURATION, "StylusTip"))
    options = ["--landmarks", landmarks, "--tip-from", tip, "--phantom", "block"]
    found = run_json(*arguments(plus, *options))
    assert found["transform"]["name"] == "BlockToReference"
    assert found["residuals"]["labels"] == [f"F-{number}" for number in range(1, 7)]
    assert sum("is on no landmark" in note for note in found["notes"]) == 2


def test_wrong_landmarks_are_not_accepted(plus, tmp_path):
    landmarks = tmp_path / "wrong.yaml"
    corners = [(0, 0, 0), (500, 0, 0), (500, 400, 0), (0, 400, 0)]
    landmarks.write_text(
        json.dumps({"landmarks": [{"name": str(c), "position_mm": list(c)} for c in corners]})
    )
    saved = tmp_path / "no.tfm"
    options = ["--plus-config", plus / CONFIGURATION, "--landmarks", landmarks, "--save", saved]
    found = run_json(*arguments(plus, *options), status=1)
    assert found["transform"] is None and not found["accepted"]
    assert "dwells fit on landmarks within 2 mm" in found["reason"]
    assert not saved.exists()


def test_missing_landmarks_and_tips_are_errors(plus, tmp_path):
    tip = tmp_path / "tip.txt"
    np.savetxt(tip, np.eye(4))
    expected = "expected --landmarks FILE or --plus-config FILE"
    assert expected in refused(*arguments(plus, "--tip-from", tip))
    options = ("--plus-config", plus / PUBLISHED, "--tool", "reference")
    assert "no ReferenceTipToReference" in refused(*arguments(plus, *options))


def test_generated_dwells_give_the_phantom_and_a_still_shaft_is_named(tmp_path):
    """The twin of the tests above on data of the project: dwells with and without rotation."""
    landmarks = {"A": [0, 0, 0], "B": [80.0, 0, 0], "C": [0, 55.0, 0], "D": [20, 30, 40]}
    phantom = Transform.from_rotation_vector(
        [0.2, -0.4, 0.1], [15.0, -30.0, 60.0], target="reference", source="phantom"
    )
    tip, points = tmp_path / "tip.txt", tmp_path / "landmarks.yaml"
    tip_pose = np.eye(4)
    tip_pose[:3, 3] = TIP_MM
    np.savetxt(tip, tip_pose)
    entries = [{"name": name, "position_mm": at} for name, at in landmarks.items()]
    points.write_text(yaml.safe_dump({"landmarks": entries}))
    options = ["--tip-from", tip, "--landmarks", points]

    def recorded(name: str, turn_rad: float) -> Path:
        poses = []
        for at in landmarks.values():
            for angle in np.linspace(0.0, turn_rad, 40):
                turn = Rotation.from_rotvec([angle, 0.3, 0.0])
                origin = phantom.apply(at) - turn.apply(TIP_MM)
                poses.append(Transform("reference", "stylus", turn.as_matrix(), origin))
        return write_igsio(tmp_path / name, frames(poses, {}))

    words = ("calibrate", "landmarks", recorded("turned.igs.mha", 0.5), *options)
    found = np.reshape(run_json(*words)["transform"]["matrix"], (4, 4))
    np.testing.assert_allclose(found, phantom.matrix, atol=1e-3)
    printed = run(*words).out
    assert printed.splitlines()[0] == "landmarks: PhantomToReference  accepted"
    assert all(f"residual {name}" in printed for name in landmarks)
    assert "s to read the recording and compute the result" in printed
    error = refused("calibrate", "landmarks", recorded("still.igs.mha", 0.02), *options)
    assert "0 dwells in 160 samples (the tip rested at 4 more places" in error
    assert "the shaft turned by at most 1.08 degrees; a dwell needs 17.2" in error
