"""Cases of every preset and of more seeds; the suite and the long tier have one of each kind."""

import pytest

from app.synthetic import simulate_case
from app.synthetic.case_options import CaseOptions
from app.synthetic.tracker_model import PRESETS
from tests.synthetic.test_cases_of_trackers import check_made_case
from tests.synthetic.test_writing import FILES, check_unrecorded

pytestmark = [pytest.mark.exhaustive, pytest.mark.timeout(900)]


@pytest.mark.parametrize("tracker", PRESETS)
def test_frames_of_an_unrecorded_case_are_those_that_are_read_of_its_recording(
    tracker, tmp_path, gantry
):
    options = CaseOptions.of_tracker(tracker).with_values({"duration_s": 50.0})
    folders = [tmp_path / name for name in ("written", "again")]
    for folder in folders:
        simulate_case(folder, seed=2, arm=gantry, options=options)
    for name in FILES:
        assert folders[0].joinpath(name).read_bytes() == folders[1].joinpath(name).read_bytes()
    check_unrecorded(folders[0], tmp_path / "kept", seed=2, arm=gantry, options=options)


@pytest.mark.parametrize(
    ("tracker", "seed", "more"),
    [
        ("aurora", 2, ["--duration", "50", "--tumor-mm", "12"]),
        ("trakstar", 2, ["--duration", "50", "--tumor-mm", "20"]),
        ("polaris", 2, ["--duration", "50", "--tumor-mm", "8"]),
        ("aurora", 3, ["--duration", "180", "--tumor-mm", "15"]),
    ],
)
def test_every_expectation_of_a_made_case_holds(tracker, seed, more, tmp_path):
    check_made_case(tracker, seed, more, tmp_path)
