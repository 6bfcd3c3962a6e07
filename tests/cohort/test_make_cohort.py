"""`marginguard make-case cohort`, and `make-case --cohort`."""

import pytest

from app.cli.main import main
from app.cohort import open_manifest


def run(capsys, *words):
    try:
        status = main(list(words))
    except SystemExit as stop:
        status = stop.code
    return status, capsys.readouterr()


def test_same_seed_writes_the_same_manifest(tmp_path, capsys):
    for name in ("one", "two"):
        status, _ = run(
            capsys,
            *("make-case", "cohort", "-n", "6", "--seed", "3", "--out", str(tmp_path / name)),
            *("--tracker", "aurora", "--tracker", "white", "--surgeons", "3", "--duration", "60"),
        )
        assert status == 0
    one, two = ((tmp_path / name / "cohort.yaml").read_bytes() for name in ("one", "two"))
    assert one == two
    cohort = open_manifest(tmp_path / "one")
    assert len(cohort) == 6 and cohort.design.trackers == ("aurora", "white")
    assert dict(cohort.case("case_0005").synthetic.values)["duration_s"] == 60.0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-n", "0"], "'0'; expected 1 to 10000000"),
        (["-n", "x"], "'x'; expected 1 to 10000000"),
        (["-n", "2", "--duration", "9"], "duration_s is [9, 9]; expected"),
        (["-n", "2", "--tracker", "magic"], "invalid choice: 'magic'"),
    ],
)
def test_bad_option_is_one_line_and_writes_nothing(tmp_path, capsys, words, message):
    status, captured = run(capsys, "make-case", "cohort", "--out", str(tmp_path / "new"), *words)
    assert status == 2 and message in captured.err and captured.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--case", "case_0000"], "one of --cohort and --case is missing"),
        (["--cohort", "COHORT"], "one of --cohort and --case is missing"),
        (["--cohort", "COHORT", "--case", "case_9"], "has no case 'case_9'"),
        (["--cohort", "COHORT", "--case", "case_0000", "--skill", "1"], "with other options"),
    ],
)
def test_case_of_a_cohort_needs_manifest_and_name_alone(tmp_path, capsys, words, message):
    assert run(capsys, "make-case", "cohort", "-n", "2", "--out", str(tmp_path / "cohort"))[0] == 0
    words = [word.replace("COHORT", str(tmp_path / "cohort")) for word in words]
    status, captured = run(capsys, "make-case", str(tmp_path / "case"), *words)
    assert status == 2 and message in captured.err
    assert not (tmp_path / "case").exists()
