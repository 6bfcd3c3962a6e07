"""Drawing of simulated cases: independent streams, pairs, limits."""

from dataclasses import replace

import pytest

from app.cohort import OPTION_RANGES, Design
from app.geometry import InputError

RANGES = {"tumor_mm": (20.0, 30.0), "skill": (0.0, 1.0)}
DESIGN = Design(200, 7, ("white", "aurora"), surgeons=5, fixture="alternate", ranges=RANGES)


def values(case):
    return dict(case.synthetic.values)


def test_case_does_not_depend_on_the_number_of_cases():
    assert [replace(DESIGN, count=9000).case(i) for i in range(9)] == [
        DESIGN.case(i) for i in range(9)
    ]


def test_another_range_leaves_the_values_of_the_first_unchanged():
    more = replace(DESIGN, ranges={**RANGES, "elongation": (1.0, 2.0), "breath_mm": (0.0, 5.0)})
    for index in range(20):
        before, after = DESIGN.case(index), more.case(index)
        assert values(after).items() > values(before).items()
        assert after.synthetic.seed == before.synthetic.seed


def test_values_fill_their_range_and_seeds_differ():
    cases = [DESIGN.case(index) for index in range(DESIGN.count)]
    tumors = [values(case)["tumor_mm"] for case in cases]
    assert 20.0 <= min(tumors) < 21.0 and 29.0 < max(tumors) <= 30.0
    assert len({case.synthetic.seed for case in cases}) == len({case.name for case in cases}) == 200
    assert {case.synthetic.tracker for case in cases} == {"white", "aurora"}


def test_skill_belongs_to_the_surgeon():
    skills = {}
    for index in range(DESIGN.count):
        case = DESIGN.case(index)
        skills.setdefault(case.surgeon, set()).add(values(case)["surgeon.skill"])
    assert len(skills) == 5 and all(len(found) == 1 for found in skills.values())


def test_pairs_differ_in_the_fixture_only():
    paired = replace(DESIGN, fixture="paired")
    for index in range(0, 20, 2):
        without, with_fixture = paired.case(index), paired.case(index + 1)
        assert (without.group, with_fixture.group) == ("fixture_off", "fixture_on")
        assert without.pair == with_fixture.pair != paired.case(index + 2).pair
        assert without.synthetic == replace(with_fixture.synthetic, fixture=False)
        assert with_fixture.synthetic.fixture


@pytest.mark.parametrize(("fixture", "given"), [("on", True), ("off", False)])
def test_one_fixture_for_all_makes_no_groups(fixture, given):
    cases = [replace(DESIGN, fixture=fixture).case(index) for index in range(4)]
    assert {case.synthetic.fixture for case in cases} == {given}
    assert {case.group for case in cases} == {case.pair for case in cases} == {""}


def test_every_range_sets_an_option_within_its_limits():
    ranges = {key: (option.low, option.high) for key, option in OPTION_RANGES.items()}
    ranges["tumor_mm"] = (30.0, 40.0)
    options = Design(1, 1, ("polaris",), ranges=ranges).case(0).synthetic.options()
    assert options.tumor_mm is not None and options.duration_s is not None
    assert options.surgeon.skill is not None and options.patient.elongation is not None
    for key, option in OPTION_RANGES.items():
        for value in (option.low, option.high):
            if key != "tumor_mm":
                Design(1, 1, ranges={key: (value, value)}).case(0).synthetic.options()


@pytest.mark.parametrize("bounds", [(30.0, 20.0), (1.0, 20.0), (20.0, 99.0), (float("nan"), 20.0)])
def test_wrong_range_is_refused(bounds):
    with pytest.raises(InputError, match=r"tumor_mm is .*; expected .* within 8 to 40"):
        replace(DESIGN, ranges={"tumor_mm": bounds})


def test_index_out_of_range_is_refused():
    with pytest.raises(InputError, match="case 200; expected 0 to 199"):
        DESIGN.case(200)
