"""Types that the script of a user sees, checked by mypy against the package as installed."""

import sysconfig
import venv
from pathlib import Path

import pytest

from tests.python_process import run_python

pytestmark = pytest.mark.long

SCRIPT = """\
import marginguard as mg

case: mg.PreparedCase = mg.open_case(mg.example_case())
steps: list[mg.StepResult] = list(mg.replay(case, start_s=95.0))
worst: mg.MarginState = max(step.decision.state for step in steps)
reasons: tuple[mg.Reason, ...] = steps[0].decision.reasons
pose = mg.Transform.identity("tumor", "tool")
tool = mg.load_mesh("tool.stl", units="mm", frame="tool")
depth_mm: float = mg.signed_distance(tool, tool, pose).signed_distance_mm
points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
result = mg.register_points(points, points, fixed_frame="a", moving_frame="b")
accepted: bool = result.accepted
with mg.constraint_stream() as constraints:
    for received in constraints:
        if received.constraint is not None and not received.hold:
            planes: mg.Constraint = received.constraint
try:
    mg.save_scene(case, steps[0], "scene.mrb", recording=steps)
except mg.MarginGuardError as error:
    print(error)
print(f"{mg.__version__} {mg.margin_table(steps)} {mg.plot_margin(case, steps)}")
"""

WRONG = {
    "mg.replay('my_case')": 'Argument 1 to "replay" has incompatible type "str"',
    "mg.signed_distance(tool, pose, tool)": "incompatible type",
    "mg.load_mesh('tool.stl')": 'Missing named argument "units"',
    "steps[0].decison": '"StepResult" has no attribute "decison"',
    "mg.no_such_name": 'has no attribute "no_such_name"',
    "received.signed_distance_mm + 1.0": "Unsupported operand types",
}


@pytest.fixture(scope="module")
def messages(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Lines that ``mypy --strict`` prints for `SCRIPT` with the lines of `WRONG` at its end."""
    folder = tmp_path_factory.mktemp("user")
    (folder / "script.py").write_text(SCRIPT + "\n".join(WRONG) + "\n")
    # mypy reads packages of a path file only if they have a py.typed, as it does when installed.
    environment = folder / "environment"
    venv.create(environment, symlinks=True)
    (packages,) = environment.glob("lib/python*/site-packages")
    root = Path(__file__).resolve().parents[2]
    (packages / "paths.pth").write_text(f"{root}\n{sysconfig.get_path('purelib')}\n")
    options = ["--strict", "--cache-dir", "cache"]
    python = str(environment / "bin" / "python")
    done = run_python(
        "-m", "mypy", *options, "--python-executable", python, "script.py", status=1, cwd=folder
    )
    return done.stdout.splitlines()


def test_correct_calls_have_no_errors(messages):
    first_wrong = SCRIPT.count("\n") + 1
    assert all(int(line.split(":")[1]) >= first_wrong for line in messages[:-1]), messages


@pytest.mark.parametrize("call", WRONG)
def test_wrong_call_is_an_error(messages, call):
    line = SCRIPT.count("\n") + 1 + list(WRONG).index(call)
    found = [text for text in messages if text.startswith(f"script.py:{line}:")]
    assert any(WRONG[call] in text for text in found), messages
