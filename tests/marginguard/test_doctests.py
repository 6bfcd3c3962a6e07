"""Every public name has a docstring with an example, and the examples hold."""

import doctest

import pytest

import marginguard

EXAMPLES = {
    test.name: test
    for name in ("marginguard", *marginguard.__all__)
    if name != "__version__"
    for test in doctest.DocTestFinder(recurse=False).find(
        marginguard if name == "marginguard" else getattr(marginguard, name), name, module=False
    )
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_of_docstrings_hold(name: str) -> None:
    assert EXAMPLES[name].examples, "no example"
    output: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    runner.run(EXAMPLES[name], out=output.append)
    assert "".join(output) == ""


def test_every_public_name_is_examined() -> None:
    assert set(EXAMPLES) == {"marginguard", *marginguard.__all__} - {"__version__"}
