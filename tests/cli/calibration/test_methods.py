"""Methods of ``marginguard calibrate``: a method is declared once."""

import pytest

from app.cli.calibration import CalibrationMethod
from app.cli.commands import calibrate
from app.cli.main import main
from tests.cli.command import run


def count(inputs):
    from app.cli.calibration.calibration_result import CalibrationResult

    given = inputs.options.count
    return CalibrationResult("count", None, given > 1, "counted", {"count": given})


COUNT = CalibrationMethod(
    name="count",
    summary="the number that was given",
    inputs=frozenset(),
    run=count,
    add_arguments=lambda parser: parser.add_argument("--count", type=int, default=0),
)


def test_names_of_methods_differ() -> None:
    names = [method.name for method in calibrate.METHODS]
    assert sorted(names) == ["hand-eye", "lag", "landmarks", "pivot", "spin", "time"]


def test_declared_method_is_one_of_the_command(monkeypatch, capsys) -> None:
    monkeypatch.setattr(calibrate, "METHODS", (*calibrate.METHODS, COUNT))
    assert "the number that was given" in run("calibrate", "--help").out
    assert main(["calibrate", "count", "any.mcap", "--count", "2"]) == 0
    assert capsys.readouterr().out.startswith("count  accepted")
    assert main(["calibrate", "count", "any.mcap"]) == 1
    with pytest.raises(SystemExit):  # options of inputs that the method does not declare
        main(["calibrate", "count", "any.mcap", "--tip-from", "tip.txt"])
