"""Every public name has a docstring with an example, and the examples hold."""

import doctest
from collections.abc import Iterator
from functools import cache

import pytest

import marginguard

pytestmark = pytest.mark.long

COMMANDS = {
    *("AddNote", "ChooseDepth", "LengthenNeedle", "Rearm", "Record", "SetMargins"),
    *("SetRegistration", "SetStructure", "SetStylusTip", "SetTip", "SetTumor", "SwitchStructure"),
}
PLANNING = {
    *("Corridor", "EntryRegion", "ForbiddenStructure", "Needle", "NeedlePlan", "NeedleTarget"),
    "NoCorridorError",
}
APPROACHES = {"Approach", "ApproachError", "MotionLimits", "Robot", "load_robot"}
SHOWN_IN = {
    **dict.fromkeys(("FixtureRule", "PlainConstraint", "RulePermission"), "plain_constraint"),
    **dict.fromkeys(COMMANDS, "LiveSession"),
    **dict.fromkeys(PLANNING, "plan_needle"),
    "NeedleGuidance": "guide_needle",
    **dict.fromkeys(APPROACHES, "plan_approach"),
}
"""Names -> the name whose example shows them together."""

EXAMPLES = {
    test.name: test
    for name in ("marginguard", *marginguard.__all__)
    if name != "__version__" and name not in SHOWN_IN
    for test in doctest.DocTestFinder(recurse=False).find(
        marginguard if name == "marginguard" else getattr(marginguard, name), name, module=False
    )
}


@pytest.fixture(scope="module", autouse=True)
def cases_are_opened_once() -> Iterator[None]:
    """The examples share each case that they open; it does not change."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(marginguard, "open_case", cache(marginguard.open_case))
        yield


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_of_docstrings_hold(name):
    assert EXAMPLES[name].examples, "no example"
    output: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    runner.run(EXAMPLES[name], out=output.append)
    assert "".join(output) == ""


def test_every_public_name_is_examined():
    names = {"marginguard", *marginguard.__all__} - {"__version__"}
    assert set(EXAMPLES) == names - set(SHOWN_IN)
    for name, function in SHOWN_IN.items():
        assert any(f"mg.{name}" in example.source for example in EXAMPLES[function].examples)
