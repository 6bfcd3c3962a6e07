"""Short form of ``marginguard bench plausibility``: no false hold, and each fault is found."""

from dataclasses import replace
from itertools import islice

import pytest
from benchmarks.case_options import RECORDED_CASE

from app.case import PlausibilityEntry
from app.runtime import prepare_case
from app.session import Session
from benchmarks.plausibility import (
    MUST_FIND,
    RELATIONS,
    Found,
    Run,
    failures,
    find,
    recorded_runs,
    run_session,
    simulated_hour,
)
from benchmarks.plausibility_faults import FAULTS
from benchmarks.plausibility_motion import SimulatedMotion
from tests.shipped_case import DROPOUTS


@pytest.fixture(scope="module")
def motion():
    return SimulatedMotion(50)


@pytest.fixture(scope="module")
def prepared():
    return prepare_case(RECORDED_CASE, tip_only=True)


def test_no_false_hold_in_a_minute_of_the_simulated_operation(motion, prepared):
    setup = replace(prepared.setup, plausibility=RELATIONS)
    run = run_session(Session(setup), simulated_hour(motion, 1.0), "a minute")
    assert run.frames == 3000
    assert (run.plausibility_holds, run.other_holds) == ({}, 0)


def test_no_false_hold_in_the_recorded_case_whose_dropouts_hold(prepared):
    run = run_session(Session(prepared.setup), prepared.case.frames(), "recorded")
    assert run.plausibility_holds == {}
    assert run.other_holds == len({(each["start_s"], each["end_s"]) for each in DROPOUTS})


@pytest.mark.parametrize(
    ("name", "frames", "count"),
    [
        ("EightLandmarkPointsTrackedForPhantomRegistration.igs.mha", 1000, 2),  # of 8, for time
        ("ReferenceToRASCalibration.igs.mha", 93, 8),
    ],
)
def test_no_false_hold_in_a_real_recording(prepared, real_recording, tmp_path, name, frames, count):
    (tmp_path / name).symlink_to(real_recording(name))
    mesh = prepared.case.tumor_mesh()
    runs = list(islice(recorded_runs(tmp_path, prepared.setup.margins, mesh), count))
    assert {run.frames for run in runs} == {frames}
    assert len(runs) == count
    assert [run.name for run in runs if run.plausibility_holds] == []


@pytest.mark.parametrize("sources", MUST_FIND)
def test_each_fault_that_must_be_found_is_found(motion, prepared, sources):
    setup = replace(prepared.setup, plausibility=PlausibilityEntry())
    if sources == "tracker alone":
        setup = replace(setup, robot=None)
    for fault in FAULTS:
        if fault.name in MUST_FIND[sources]:
            found = find(motion, setup, fault, sources, 50, 1)
            assert found.found == 1, fault.name
            assert found.max_error_mm is None or found.max_error_mm < 5.5


def test_false_holds_and_faults_that_are_not_found_are_failures():
    clean = Run("clean", 1.0, 50, {}, 3)
    assert failures([clean], []) == []
    assert failures([replace(clean, plausibility_holds={"implausible": 1})], []) == [
        "clean: false holds {'implausible': 1}; expected none"
    ]
    missed = Found("jump of 100 mm", "tracker alone", 50, 5, 4, 0.0, 0.0, None)
    assert failures([], [missed]) == ["jump of 100 mm, tracker alone, 50 Hz: found in 4 of 5"]
    assert failures([], [replace(missed, fault="creep of 2 mm/s")]) == []
