"""Checks of the C++ rule of a controller, against Python and an oracle."""

import subprocess
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh

from app.fixture import FixtureRule, LimiterParameters, RulePermission, RuleReason
from app.geometry import FloatArray
from tests.examples.rule_cases import (
    LONG,
    Allow,
    Event,
    Rearm,
    Receive,
    Stand,
    Start,
    as_line,
    edges,
    events,
    jumps,
)
from tests.fixture.control.closed_loops import TOOLS
from tests.fixture.control.guarded_loop import Scene, simulate, tool, tumor
from tests.oracles.twist_oracle import nearest_point

PARAMETERS = LimiterParameters()
LEVER = np.array([1.0] * 3 + [1.0 / PARAMETERS.lever_mm] * 3)
UNITS = np.array([1000.0] * 3 + [1.0] * 3)
"""From the twist of the driver, in m/s, to mm/s."""

LAG_NS = 25_000_000
"""Half of the time constant."""

KEPT = 128
"""Intervals that a rule remembers."""

WARNINGS = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow", "-Wconversion"]


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
    lines = [as_line(event) for life in lives for event in life]
    done = subprocess.run(
        [str(driver)], input="\n".join(lines) + "\n", capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    return done.stdout.splitlines()


class Expected:
    """Decision of the Python rule for one control step, with the message that it used.

    ``received_ns``: times of the messages since the step before.
    """

    def __init__(
        self, rule: FixtureRule, step: Allow, received_ns: list[int], *, is_first: bool
    ) -> None:
        decision = rule.allow(step.desired, step.tip_mm, step.now_ns)
        self.latched = rule.latched is not None
        self.words = [decision.permission, decision.reason, str(int(self.latched))]
        self.moves = decision.permission is not RulePermission.NO_MOTION
        self.twist = decision.twist
        self.message = rule.message
        self.step = step
        self.received_ns = received_ns
        self.is_first = is_first


def python_decisions(life: list[Event]) -> list[Expected]:
    """Decisions of the Python rule for the control steps of a life."""
    rule, decisions = FixtureRule(), []
    received_ns: list[int] = []
    for event in life:
        if isinstance(event, Start):
            rule = FixtureRule(follows_setup=event.follows_setup)
        elif isinstance(event, Rearm):
            rule.rearm()
        elif isinstance(event, Stand):
            rule.stand(event.now_ns)
        elif isinstance(event, Receive):
            rule.receive(event.message, event.now_ns)
            received_ns.append(event.now_ns)
        else:
            decisions.append(Expected(rule, event, received_ns, is_first=not decisions))
            received_ns = []
    return decisions


@dataclass
class Interval:
    """Commands within 4 ms: durations in s with twists (6,)."""

    begin_ns: int
    end_ns: int = 0
    commands: list[tuple[float, FloatArray]] = field(default_factory=list)

    def path(self, part: slice) -> float:
        return sum(seconds * float(np.linalg.norm(twist[part])) for seconds, twist in self.commands)

    def moved(self) -> FloatArray:
        return sum((seconds * twist for seconds, twist in self.commands), np.zeros(6))


class History:
    """All that a controller has commanded since the clock jumped, independent of `OwnMotion`."""

    def __init__(self) -> None:
        self.intervals: list[Interval] = []
        self.twist = np.zeros(6)
        self.now_ns: int | None = None

    def until(self, now_ns: int) -> None:
        last_ns, self.now_ns = self.now_ns, now_ns
        if last_ns is None:
            return
        if now_ns < last_ns:
            self.intervals.clear()
        elif now_ns > last_ns:
            if not self.intervals or now_ns - self.intervals[-1].begin_ns > 4_000_000:
                self.intervals.append(Interval(last_ns))
            last = self.intervals[-1]
            last.end_ns = now_ns
            last.commands.append(((now_ns - last_ns) / 1e9, self.twist))

    def since(self, begin_ns: int) -> list[Interval]:
        return [each for each in self.intervals if each.end_ns > begin_ns]


@dataclass(frozen=True)
class Limits:
    """Limits of a twist: rows (k, 6), bounds of the approach, the tumour's term, speeds."""

    rows: FloatArray
    approach: FloatArray
    tumor: FloatArray
    shares: FloatArray
    max_turn_rad_s: float

    def slowed(self, twist: FloatArray) -> FloatArray:
        speed, turn = np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])
        return twist / max(speed / PARAMETERS.max_speed_mm_s, turn / self.max_turn_rad_s, 1.0)

    def share(self, twist: FloatArray) -> float:
        return float(self.shares @ [np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])])


def rows_at(n: FloatArray, p: FloatArray, tip_mm: FloatArray) -> FloatArray:
    """The rows (k, 6) whose products with a twist of the tip are the speeds of p along n."""
    return np.hstack([n, np.cross(p - tip_mm, n)])


def limits_of(message, step: Allow, history: History, *, latched: bool) -> Limits:
    """The limits of a twist now by the planes of a message, and by the motion since its stamp."""
    n, p = message.normals, message.points_on_tool_mm
    tumor = (n * message.tumor_velocities_mm_s).sum(axis=1) * (not latched)
    recent = history.since(message.stamp_ns - LAG_NS)
    shift_mm = sum((e.moved()[:3] for e in recent if e.end_ns > message.stamp_ns), np.zeros(3))
    rows = rows_at(n, p, step.tip_mm - shift_mm)
    reach = np.linalg.norm(p - (step.tip_mm - shift_mm), axis=1)
    approached = np.maximum(tumor, 0.0) * max(step.now_ns - message.stamp_ns, 0) / 1e9
    for each in recent:
        approached += np.maximum(-(rows @ each.moved()), 0.0)
    way_mm = sum(each.path(slice(3)) for each in recent)
    turn_rad = sum(each.path(slice(3, 6)) for each in recent)
    clearances = (n * p).sum(axis=1) - message.offsets_mm
    clearances -= approached + turn_rad**2 / 2.0 * reach + 2.0 * turn_rad
    validity_s = (message.valid_until_ns - message.stamp_ns) / 1e9
    fastest = np.maximum(message.max_tool_speed_mm_s, clearances / validity_s)
    approach = np.minimum(-clearances / PARAMETERS.tau_s, PARAMETERS.retreat_mm_s)
    approach = np.maximum(approach, -fastest)
    if message.hold or message.state == 3 or latched:
        approach = np.zeros(len(n))
    free = np.array([message.free_distance_mm, min(message.free_turn_rad, 0.1)])
    free = np.maximum(free, [0.1, 0.001])
    left = max(1.0 - float(([way_mm, turn_rad] / free).sum()), 1e-9)
    shares = PARAMETERS.tau_s / (left * free)
    max_turn_rad_s = min(PARAMETERS.max_turn_rad_s, message.max_tool_turn_rad_s)
    return Limits(rows, approach, tumor, shares, max_turn_rad_s)


def oracle_twist(desired: FloatArray, limits: Limits) -> tuple[FloatArray, FloatArray]:
    """Twist that is allowed, by non-negative least squares, and the bounds that it keeps.

    Raises `ArithmeticError` where that finds no solution although there is one.
    """
    rows, desired = limits.rows, limits.slowed(desired)
    if np.isfinite(limits.approach).all():
        attempts = [
            (a, d) for a in (limits.approach, np.minimum(limits.approach, 0.0)) for d in (1, 0)
        ]
        for approach, wanted in attempts:
            lower = approach + limits.tumor
            nearest = nearest_point(wanted * desired / LEVER, rows * LEVER, lower)
            if nearest is None and (lower <= 0.0).all():
                raise ArithmeticError("no motion keeps these bounds")
            if nearest is not None:
                allowed = limits.slowed(nearest * LEVER)
                allowed = allowed / max(limits.share(allowed), 1.0)
                if (rows @ allowed >= lower - 1e-6).all():
                    return allowed, lower
    return np.zeros(6), np.zeros(len(rows))


def check_closed_loops(driver: Path, tumor_kind: str, project_root: Path, steps: int) -> None:
    """C++ decides as Python in loops of ``steps`` with each tool.

    At each twentieth step the tool stands instead.
    """
    cautery = trimesh.load(project_root / "data" / "recorded_case" / "cautery.stl")
    lives: list[list[Event]] = []
    shape = tumor(tumor_kind, np.random.default_rng(0))
    for seed, tool_kind in enumerate(TOOLS):
        scene = Scene(shape, tool(tool_kind, cautery))
        for v_max_mm_s in (0.0, 50.0):
            rule = FixtureRule()
            loop = simulate(scene, rule, seed, steps=steps, stop_mm=1.0, v_max_mm_s=v_max_mm_s)
            lives.append([Start()])
            for number, event in enumerate(loop.events):
                if len(event) == 2:
                    lives[-1].append(Receive(*event))
                else:
                    step = Allow(*event[:3])
                    lives[-1].append(Stand(step.now_ns) if number % 20 == 0 else step)
    expected = [decision for life in lives for decision in python_decisions(life)]
    moves, furthest = 0, 0.0
    for python, line in zip(expected, answers(driver, lives), strict=True):
        words = line.split()
        assert words[:3] == python.words
        moves += python.moves
        twist = np.array(words[3:], dtype=np.float64) * UNITS
        furthest = max(furthest, float(np.abs(twist - python.twist).max()))
    print(f"{len(expected)} decisions, {moves} with motion, at most {furthest:.2g} mm/s apart")
    assert moves > 0.5 * len(expected)
    assert furthest < 1e-6


def check_random_lives(driver: Path, controllers: int) -> None:
    """C++ decides as Python and as the oracle, and keeps every plane.

    Controllers get 12 messages each; every tenth one gets `LONG`.
    """
    lives = [
        list(events(np.random.default_rng(seed), 12 if seed % 10 else LONG))
        for seed in range(controllers)
    ]
    lives += [list(edges(np.random.default_rng(ms), period_ms=ms)) for ms in (1, 5)]
    lives += [list(jumps(np.random.default_rng(back_s), back_s)) for back_s in (5, 3600)]
    expected = [decision for life in lives for decision in python_decisions(life)]
    found = answers(driver, lives)
    reasons: set[str] = set()
    from_python, from_oracle, violation, share = 0.0, 0.0, 0.0, 0.0
    moves, unsolved = 0, 0
    history = History()
    for python, line in zip(expected, found, strict=True):
        words = line.split()
        assert words[:3] == python.words
        reasons.add(words[1])
        twist = np.array(words[3:], dtype=np.float64) * UNITS
        step = python.step
        history = History() if python.is_first else history
        for now_ns in (*python.received_ns, step.now_ns):
            history.until(now_ns)
        history.twist = twist
        if not python.moves:
            assert not twist.any()
            continue
        moves += 1
        from_python = max(from_python, float(np.abs(twist - python.twist).max()))
        assert len(history.since(python.message.stamp_ns - LAG_NS)) <= KEPT
        limits = limits_of(python.message, step, history, latched=python.latched)
        try:
            oracle, lower = oracle_twist(step.desired, limits)
        except ArithmeticError:
            unsolved += 1
            continue
        from_oracle = max(from_oracle, float(np.abs(twist - oracle).max()))
        speed = np.linalg.norm(twist) + np.linalg.norm(step.desired)
        size = np.abs(lower) + np.linalg.norm(limits.rows, axis=1) * speed
        violation = max(violation, float(((lower - limits.rows @ twist) / (size + 1e-300)).max()))
        share = max(share, limits.share(twist))
        assert np.linalg.norm(twist[3:]) <= limits.max_turn_rad_s * (1.0 + 1e-12)
    print(f"{len(found)} decisions, {moves} with motion; deviation from Python {from_python:.2g}")
    print(f"from the oracle {from_oracle:.2g} mm/s or rad/s")
    print(f"not compared with it: {unsolved} unsolved")
    print(f"relative violation {violation:.2g}")
    assert reasons == {*RuleReason} - {"no_message"}
    assert share <= 1.0 + 1e-9
    assert moves > 0.4 * len(found)
    assert unsolved < 5
    assert from_python < 1e-6
    assert from_oracle < 1e-6
    assert violation < 1e-9
