"""Discovery of calibration methods: one module per method."""

import sys
from pathlib import Path

import pytest

from app.cli.calibration import methods
from app.cli.calibration.registry import load_methods
from app.cli.main import main

MODULE = """
from app.cli.calibration.calibration_method import CalibrationMethod


def calibrate(inputs):
    from app.cli.calibration.calibration_result import CalibrationResult

    count = inputs.options.count
    return CalibrationResult("{name}", None, count > 1, "counted", {{"count": count}})


def add_arguments(parser):
    parser.add_argument("--count", type=int, default=0)


METHOD = CalibrationMethod(
    name="{name}",
    summary="the number that was given",
    inputs=frozenset(),
    run=calibrate,
    add_arguments=add_arguments,
)
"""


@pytest.fixture
def add_method(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Function that adds a module with a method to the package of methods."""
    monkeypatch.setattr(methods, "__path__", [*methods.__path__, str(tmp_path)])

    added: list[str] = []

    def add(module: str, name: str) -> None:
        (tmp_path / f"{module}.py").write_text(MODULE.format(name=name))
        added.append(f"{methods.__name__}.{module}")

    yield add
    for path in added:
        sys.modules.pop(path, None)


def test_every_module_of_the_package_is_a_method() -> None:
    assert list(load_methods()) == ["hand-eye", "lag", "landmarks", "pivot", "spin", "time"]


def test_a_new_module_becomes_a_method_of_the_command(add_method, capsys) -> None:
    add_method("counting", "count")
    with pytest.raises(SystemExit) as stop:
        main(["calibrate", "--help"])
    assert stop.value.code == 0
    assert "the number that was given" in capsys.readouterr().out
    assert main(["calibrate", "count", "any.mcap", "--count", "2"]) == 0
    assert capsys.readouterr().out.startswith("count  accepted")
    assert main(["calibrate", "count", "any.mcap"]) == 1
    with pytest.raises(SystemExit):  # options of inputs that the method does not declare
        main(["calibrate", "count", "any.mcap", "--tip-from", "tip.txt"])


def test_two_modules_with_one_name_are_an_error(add_method) -> None:
    add_method("another_pivot", "pivot")
    with pytest.raises(ValueError, match="calibration method 'pivot' is defined twice"):
        load_methods()
