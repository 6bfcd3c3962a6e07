"""Random messages and control steps for the rule of a controller, in Python and in C++."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from app.fixture import MarginState, PlainConstraint
from app.geometry import NS_PER_MS, NS_PER_S, FloatArray

MM_PER_M = 1000.0
START_NS = 1_700_000_000_000_000_000


@dataclass(frozen=True)
class Start:
    """A new rule."""

    follows_setup: bool = False


@dataclass(frozen=True)
class Receive:
    """A message that arrives at ``now_ns``."""

    message: PlainConstraint
    now_ns: int


@dataclass(frozen=True)
class Allow:
    """A control step at ``now_ns`` with a desired twist (6,) of the tip at ``tip_mm`` (3,)."""

    desired: FloatArray
    tip_mm: FloatArray
    now_ns: int


@dataclass(frozen=True)
class Stand:
    """A step without a command at ``now_ns``."""

    now_ns: int


@dataclass(frozen=True)
class Rearm:
    """The operator of the controller re-arms it."""


Event = Start | Receive | Allow | Stand | Rearm

STEPS = 4
"""Control steps after each message."""

LONG = 60
"""Messages of a long life, whose control steps are more intervals than a rule remembers."""

_FAULTS = [
    *("seq", "instance", "setup", "no id", "no setup", "nan", "inf", "huge", "normal", "count"),
    *("frame", "state", "unknown", "hold", "expired", "future", "long", "back", "silent", "rearm"),
    *("desired", "fast", "tip", "far tip", "simulated", "other pose", "no planes", "number", "old"),
]
_NUMBERS = ("free_distance_mm", "free_turn_rad", "max_tool_speed_mm_s", "max_tool_turn_rad_s")


def random_planes(rng: np.random.Generator, count: int) -> dict[str, FloatArray]:
    """Planes of all kinds: independent, parallel, duplicate, opposite, through one point."""
    kind = rng.choice(["free", "parallel", "near", "duplicate", "opposite", "corner", "axis"])
    normals = rng.normal(size=(count, 3))
    if kind in ("parallel", "duplicate"):
        normals[:] = normals[0]
    elif kind == "near":
        normals[:] = normals[0] + rng.normal(scale=1e-6, size=(count, 3))
    elif kind == "opposite":
        normals[:] = normals[0] * rng.choice([-1.0, 1.0], (count, 1))
    elif kind == "axis":
        normals = np.eye(3)[rng.integers(3, size=count)] * rng.choice([-1.0, 1.0], (count, 1))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = rng.uniform(-60.0, 60.0, (count, 3))
    clearances = rng.uniform(-3.0, 12.0, count)
    if kind == "corner":
        points[:] = points[0]
    if kind == "duplicate":
        points[:], clearances[:] = points[0], clearances[0]
    if rng.random() < 0.1:
        clearances[:] = 0.0
    moving = rng.random() < 0.5
    return {
        "normals": normals,
        "offsets_mm": np.einsum("ij,ij->i", normals, points) - clearances,
        "points_on_tool_mm": points,
        "tumor_velocities_mm_s": rng.uniform(-8.0, 8.0, (count, 3)) * moving,
    }


def events(rng: np.random.Generator, messages: int = 12) -> Iterator[Event]:
    """One controller's life: messages and control steps, most of them valid.

    The control steps of a long life are further apart and have fewer faults.
    """
    is_long = messages >= LONG
    gaps_ms = (20, 60) if is_long else (1, 20)
    kinds = ["none"] * (80 if is_long else 12) + _FAULTS + ["old", "rearm"] * 4 * is_long
    now_ns, seq = START_NS, int(rng.integers(1000))
    ids = {"instance": "first", "setup": "setup"}
    yield Start(follows_setup=bool(rng.random() < 0.2))
    for _ in range(messages):
        seq += 1
        fault, second = str(rng.choice(kinds)), str(rng.choice(_FAULTS))
        gap_ns = int(rng.integers(gaps_ms[0] * NS_PER_MS, gaps_ms[1] * NS_PER_MS))
        message = _message(rng, now_ns, seq, ids)
        if fault == "rearm":
            yield Rearm()
        message = _broken(rng, fault, message, now_ns)
        if fault != "none" and rng.random() < 0.2:
            message = _broken(rng, second, message, now_ns)
        yield Receive(message, now_ns)
        yield from _steps(rng, fault, now_ns, gap_ns)
        if fault in ids and rng.random() < 0.5:
            ids[fault] = "second"
        now_ns += gap_ns


def edges(rng: np.random.Generator, period_ms: int) -> Iterator[Event]:
    """A life whose stamps are at the edges of intervals: of recent ones, and of the oldest one."""
    oldest = (128 * max(period_ms, 4) - 25) // period_ms
    period_ns = period_ms * NS_PER_MS
    ids = {"instance": "first", "setup": "setup"}
    yield Start()
    for seq in range(700):
        now_ns = START_NS + seq * period_ns
        age = rng.integers(oldest - 4, oldest + 3) if seq % 4 == 0 else rng.integers(8)
        stamp_ns = now_ns - int(age) * period_ns + int(rng.integers(-1, 2))
        message = _message(rng, now_ns, seq, ids)
        until_ns = now_ns + 50 * NS_PER_MS
        yield Receive(replace(message, stamp_ns=stamp_ns, valid_until_ns=until_ns), now_ns)
        yield Allow(rng.normal(size=6) * ([60.0] * 3 + [0.6] * 3), np.zeros(3), now_ns)


def jumps(rng: np.random.Generator, back_s: int) -> Iterator[Event]:
    """A life whose clock jumps back once, until planes are used again, and somewhat longer."""
    ids = {"instance": "first", "setup": "setup"}
    yield Start()
    for seq in range(600):
        now_ns = START_NS + seq * 20 * NS_PER_MS - back_s * NS_PER_S * (seq >= 20)
        yield Receive(_message(rng, now_ns, seq, ids), now_ns)
        yield Allow(rng.normal(size=6) * ([60.0] * 3 + [0.6] * 3), np.zeros(3), now_ns)


def _message(
    rng: np.random.Generator, now_ns: int, seq: int, ids: dict[str, str]
) -> PlainConstraint:
    stamp_ns = now_ns - int(rng.integers(2 * NS_PER_MS, 50 * NS_PER_MS))
    return PlainConstraint(
        instance_id=ids["instance"],
        seq=seq,
        frame="tumor",
        stamp_ns=stamp_ns,
        valid_until_ns=stamp_ns + int(rng.integers(120 * NS_PER_MS, 400 * NS_PER_MS)),
        state=int(rng.integers(3)),
        hold=bool(rng.random() < 0.1),
        simulated=False,
        planes_current=True,
        **random_planes(rng, int(rng.integers(1, 9))),
        free_distance_mm=float(rng.uniform(0.0, 20.0) * (rng.random() > 0.15)),
        free_turn_rad=float(rng.uniform(0.0, 0.2) * (rng.random() > 0.1)),
        max_tool_speed_mm_s=float(rng.uniform(0.0, 250.0)),
        max_tool_turn_rad_s=float(rng.uniform(0.1, 2.0)),
        setup_id=ids["setup"],
    )


def _steps(rng: np.random.Generator, fault: str, now_ns: int, gap_ns: int) -> Iterator[Allow]:
    """The control steps from a message at ``now_ns`` until the next one."""
    towards = rng.normal(size=6) * ([300.0 if fault == "fast" else 60.0] * 3 + [0.6] * 3)
    place_mm = rng.uniform(-60.0, 60.0, 3)
    back_ns = int(rng.choice([1, 30 * NS_PER_MS])) if fault == "back" else 0
    late_ns = 101 * NS_PER_MS if fault == "silent" else 0
    for step in range(STEPS):
        desired = towards + rng.normal(size=6) * ([20.0] * 3 + [0.2] * 3)
        tip_mm = place_mm + rng.normal(size=3)
        if fault == "desired":
            desired[rng.integers(6)] = rng.choice([np.nan, np.inf, -np.inf])
        if fault in ("tip", "far tip") and step == 1:
            values = [np.nan, np.inf, -np.inf] if fault == "tip" else [1.1e6, -1e9]
            tip_mm[rng.integers(3)] = rng.choice(values)
        yield Allow(desired, tip_mm, now_ns - back_ns + late_ns + gap_ns * step // STEPS)


def _broken(
    rng: np.random.Generator, fault: str, message: PlainConstraint, now_ns: int
) -> PlainConstraint:
    """``message``, received at ``now_ns``, with the fault."""
    if fault in ("nan", "inf", "huge", "normal") and len(message.normals):
        value = {"nan": np.nan, "inf": -np.inf, "huge": 1e300, "normal": 1.001}[fault]
        name = str(rng.choice(["normals", "offsets_mm", "points_on_tool_mm"]))
        array = getattr(message, "normals" if fault == "normal" else name).copy()
        array.flat[rng.integers(array.size)] = value
        return replace(message, **{"normals" if fault == "normal" else name: array})
    changes = {
        "seq": {"seq": message.seq - 1 - int(rng.integers(2))},
        "instance": {"instance_id": "second"},
        "setup": {"setup_id": "second"},
        "no id": {"instance_id": str(rng.choice(["", "x" * 129]))},
        "no setup": {"setup_id": str(rng.choice(["", "x" * 129]))},
        "frame": {"frame": "needle"},
        "state": {"state": int(rng.choice([-1, 4]))},
        "unknown": {"state": int(MarginState.UNKNOWN), "hold": bool(rng.integers(2))},
        "hold": {"hold": True},
        "simulated": {"simulated": True},
        "other pose": {"planes_current": False},
        "expired": {"valid_until_ns": now_ns},
        "future": {"stamp_ns": now_ns + 10 * NS_PER_MS},
        "old": {"stamp_ns": now_ns - int(rng.integers(300 * NS_PER_MS, 2500 * NS_PER_MS))},
        "long": {"valid_until_ns": message.stamp_ns + 10_001 * NS_PER_MS},
    }
    if fault == "count":
        return replace(message, **random_planes(rng, int(rng.choice([9, 12]))))
    if fault == "number":
        name = str(rng.choice(_NUMBERS))
        values = [-1.0, -1e-300, -0.0, np.nan, np.inf, -np.inf]
        return replace(message, **{name: float(rng.choice(values))})
    if fault == "no planes":
        state = int(rng.choice([message.state, MarginState.UNKNOWN]))
        empty = {name: getattr(message, name)[:0] for name in random_planes(rng, 1)}
        return replace(message, state=state, **empty)
    return replace(message, **changes.get(fault, {}))


def as_line(event: Event) -> str:
    """``event`` as a line for ``rule_driver.cpp``: lengths in m."""
    if isinstance(event, Start):
        return f"new tumor {int(event.follows_setup)}"
    if isinstance(event, Rearm):
        return "rearm"
    if isinstance(event, Stand):
        return f"stand {event.now_ns}"
    if isinstance(event, Allow):
        scale = [MM_PER_M] * 3 + [1.0] * 3
        return " ".join(
            ["allow", str(event.now_ns), _text(event.desired / scale), _text(event.tip_mm / 1e3)]
        )
    message = event.message
    planes = np.column_stack(
        [
            message.normals,
            message.offsets_mm / MM_PER_M,
            message.points_on_tool_mm / MM_PER_M,
            message.tumor_velocities_mm_s / MM_PER_M,
        ]
    )
    numbers = np.array([getattr(message, name) for name in _NUMBERS]) / [1e3, 1.0, 1e3, 1.0]
    return (
        f"receive {event.now_ns} {message.instance_id or '-'} {message.setup_id or '-'} "
        f"{message.seq} {message.frame} "
        f"{message.stamp_ns} {message.valid_until_ns} {message.state} {int(message.hold)} "
        f"{int(message.simulated)} {int(message.planes_current)} "
        f"{_text(numbers)} {len(planes)} {_text(planes)}"
    )


def _text(values: FloatArray) -> str:
    return " ".join(f"{value:.17g}" for value in np.ravel(values))
