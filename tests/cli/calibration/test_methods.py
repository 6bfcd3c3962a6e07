"""Methods of ``marginguard calibrate``: a method is declared once."""

from app.cli.calibration import CalibrationMethod
from app.cli.commands import calibrate
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


def test_names_of_methods_differ():
    names = [method.name for method in calibrate.METHODS]
    assert sorted(names) == ["hand-eye", "lag", "landmarks", "pivot", "spin", "time"]


def test_declared_method_is_one_of_the_command(monkeypatch):
    monkeypatch.setattr(calibrate, "METHODS", (*calibrate.METHODS, COUNT))
    assert "the number that was given" in run("calibrate", "--help").out
    words = ("calibrate", "count", "any.mcap")
    assert run(*words, "--count", "2").out.startswith("count  accepted")
    run(*words, status=1)
    # Options of inputs that the method does not declare.
    run(*words, "--tip-from", "tip.txt", status=2)
