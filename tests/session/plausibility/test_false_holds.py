"""No false hold in a minute of operation and in recordings; each fault is found once."""

from dataclasses import replace
from itertools import islice

import pytest

from tests.session.plausibility.long_runs import (
    MUST_FIND,
    RELATIONS,
    Run,
    faults_to_find,
    recorded_runs,
    run_session,
    simulated_operation,
    times_to_find,
    with_sources,
)
from tests.shipped_case import DROPOUTS

pytestmark = pytest.mark.long


def test_no_false_hold_in_a_minute_of_the_simulated_operation(motion, prepared):
    setup = replace(prepared.setup, plausibility=RELATIONS)
    assert run_session(setup, simulated_operation(motion, 1)) == Run(3000, {}, 0)


def test_no_false_hold_in_the_recorded_case_whose_dropouts_hold(prepared):
    run = run_session(prepared.setup, prepared.case.frames())
    assert run.plausibility_holds == {}
    assert run.other_holds == len({(each["start_s"], each["end_s"]) for each in DROPOUTS})


@pytest.mark.parametrize(
    ("name", "frames", "count"),
    [
        ("EightLandmarkPointsTrackedForPhantomRegistration.igs.mha", 1000, 2),  # of 8, for time
        ("ReferenceToRASCalibration.igs.mha", 93, 8),
    ],
)
def test_no_false_hold_in_a_real_recording(prepared, real_recording, name, frames, count):
    mesh = prepared.case.tumor_mesh()
    runs = list(islice(recorded_runs(real_recording(name), prepared.setup.margins, mesh), count))
    assert [(run.frames, run.plausibility_holds) for run in runs] == [(frames, {})] * count


@pytest.mark.parametrize("sources", MUST_FIND)
def test_each_fault_that_must_be_found_is_found(motion, prepared, sources):
    setup = with_sources(prepared.setup, sources)
    for fault in faults_to_find(sources):
        (found_s,) = times_to_find(motion, setup, fault, 1)
        assert found_s is not None, fault.name
        assert fault.rate_mm_s * found_s < 5.5
