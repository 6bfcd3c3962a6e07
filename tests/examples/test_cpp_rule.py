"""The C++ rule of a controller: compiled without warnings, compared with Python and an oracle."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from app.fixture import FixtureRule, LimiterParameters, RulePermission, RuleReason
from app.geometry import FloatArray
from tests.examples.rule_cases import Allow, Event, Rearm, Receive, as_line, events
from tests.oracles.twist_oracle import nearest_point

pytestmark = pytest.mark.slow

PARAMETERS = LimiterParameters()
LEVER = np.array([1.0] * 3 + [1.0 / PARAMETERS.lever_mm] * 3)
UNITS = np.array([1000.0] * 3 + [1.0] * 3)
"""From the twist of the driver, in m/s, to mm/s."""

CONTROLLERS = 500
"""With 24 control steps each."""

WARNINGS = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow", "-Wconversion"]
SANITIZED = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


@pytest.fixture(scope="module")
def sources(project_root: Path) -> Path:
    if shutil.which("g++") is None:
        pytest.skip("g++ is not installed")
    return project_root / "examples" / "cpp_controller"


def compiled(sources: Path, output: Path, *options: str) -> Path:
    subprocess.run(
        [
            "g++",
            *WARNINGS,
            *options,
            f"-I{sources / 'include'}",
            str(sources / "test" / "rule_driver.cpp"),
            "-o",
            str(output),
        ],
        check=True,
    )
    return output


def answers(driver: Path, lives: list[list[Event]]) -> list[str]:
    """Lines that the driver prints for the control steps of all ``lives``."""
    lines = [line for life in lives for line in ["new tumor", *map(as_line, life)]]
    done = subprocess.run(
        [str(driver)], input="\n".join(lines) + "\n", capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    return done.stdout.splitlines()


class Expected:
    """Decision of the Python rule for one control step, with the message that it used."""

    def __init__(self, rule: FixtureRule, step: Allow) -> None:
        decision = rule.allow(step.desired, step.tip_mm, step.now_ns)
        self.latched = rule.latched is not None
        self.words = [decision.permission, decision.reason, str(int(self.latched))]
        self.moves = decision.permission is not RulePermission.NO_MOTION
        self.twist = decision.twist
        self.message = rule.message
        self.step = step


def python_decisions(life: list[Event]) -> list[Expected]:
    """Decisions of the Python rule for the control steps of a life."""
    rule, decisions = FixtureRule(), []
    for event in life:
        if isinstance(event, Rearm):
            rule.rearm()
        elif isinstance(event, Receive):
            rule.receive(event.message, event.now_ns)
        else:
            decisions.append(Expected(rule, event))
    return decisions


def rows_of(message, origin_mm: FloatArray, *, latched: bool) -> tuple[FloatArray, ...]:
    """Rows (k, 6) of a message, the bounds of the approach and the term of the tumour's motion."""
    n, p = message.normals, message.points_on_tool_mm
    rows = np.array([[*ni, *np.cross(pi - origin_mm, ni)] for ni, pi in zip(n, p, strict=True)])
    clearances = (n * p).sum(axis=1) - message.offsets_mm
    tau_s = max(PARAMETERS.tau_s, (message.valid_until_ns - message.stamp_ns) / 1e9)
    approach = np.minimum(-clearances / tau_s, PARAMETERS.retreat_mm_s)
    if message.hold or message.state == 3 or latched:
        approach[:] = 0.0
    tumor = (n * message.tumor_velocities_mm_s).sum(axis=1) * (not latched)
    return rows, approach, tumor


def slowed(twist: FloatArray) -> FloatArray:
    speeds = np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])
    excess = max(speeds[0] / PARAMETERS.most_mm_s, speeds[1] / PARAMETERS.most_rad_s, 1.0)
    return twist / excess


def oracle_twist(
    step: Allow, rows: FloatArray, approach: FloatArray, tumor: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Twist that is allowed, by non-negative least squares, and the bounds that it keeps."""
    desired = slowed(step.desired)
    for lower in (approach + tumor, np.minimum(approach, 0.0) + tumor):
        nearest = nearest_point(desired / LEVER, rows * LEVER, lower)
        if nearest is not None:
            allowed = slowed(nearest * LEVER)
            if (rows @ allowed >= lower - 1e-6).all():
                return allowed, lower
    return np.zeros(6), np.zeros(len(rows))


def test_cpp_rule_decides_as_the_python_rule_and_keeps_every_plane(
    sources: Path, tmp_path: Path
) -> None:
    driver = compiled(sources, tmp_path / "driver", "-O2")
    lives = [list(events(np.random.default_rng(seed))) for seed in range(CONTROLLERS)]
    expected = [decision for life in lives for decision in python_decisions(life)]
    found = answers(driver, lives)
    reasons: set[str] = set()
    from_python, from_oracle, violation, moves = 0.0, 0.0, 0.0, 0
    for python, line in zip(expected, found, strict=True):
        words = line.split()
        assert words[:3] == python.words
        reasons.add(words[1])
        twist = np.array(words[3:], dtype=np.float64) * UNITS
        if not python.moves:
            assert not twist.any()
            continue
        moves += 1
        rows, approach, tumor = rows_of(python.message, python.step.tip_mm, latched=python.latched)
        oracle, lower = oracle_twist(python.step, rows, approach, tumor)
        from_python = max(from_python, float(np.abs(twist - python.twist).max()))
        from_oracle = max(from_oracle, float(np.abs(twist - oracle).max()))
        speed = np.linalg.norm(twist) + np.linalg.norm(python.step.desired)
        size = np.abs(lower) + np.linalg.norm(rows, axis=1) * speed
        violation = max(violation, float(((lower - rows @ twist) / (size + 1e-300)).max()))
    print(f"{len(found)} decisions, {moves} with motion; deviation from Python {from_python:.2g}")
    print(f"from the oracle {from_oracle:.2g} mm/s or rad/s; relative violation {violation:.2g}")
    assert reasons == {*RuleReason} - {"no_message"}
    assert moves > 0.4 * len(found)
    assert from_python < 1e-6
    assert from_oracle < 1e-6
    assert violation < 1e-9


def test_cpp_rule_has_no_undefined_behaviour(sources: Path, tmp_path: Path) -> None:
    (tmp_path / "empty.cpp").write_text("int main() {}\n")
    empty = ["g++", *SANITIZED, str(tmp_path / "empty.cpp"), "-o", str(tmp_path / "empty")]
    if subprocess.run(empty, check=False).returncode != 0:
        pytest.skip("g++ has no sanitizers")
    driver = compiled(sources, tmp_path / "driver", *SANITIZED)
    lives = [list(events(np.random.default_rng(seed))) for seed in range(1000, 1060)]
    lives.append([Allow(np.zeros(6), np.zeros(3), 0)])
    found = answers(driver, lives)
    assert len(found) == 60 * 24 + 1
    assert found[-1] == "no_motion no_message 0 0 0 0 0 0 0"
