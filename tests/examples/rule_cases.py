"""Random messages and control steps for the rule of a controller, in Python and in C++."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from app.fixture import MarginState, PlainConstraint
from app.geometry import NS_PER_MS, FloatArray

MM_PER_M = 1000.0
START_NS = 1_700_000_000_000_000_000


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
class Rearm:
    """The operator of the controller re-arms it."""


Event = Receive | Allow | Rearm


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


def events(rng: np.random.Generator) -> Iterator[Event]:
    """One controller's life: messages and control steps, most of them valid."""
    now_ns, seq, instance = START_NS, int(rng.integers(1000)), "first"
    for _ in range(12):
        now_ns += int(rng.integers(NS_PER_MS, 20 * NS_PER_MS))
        seq += 1
        fault = rng.choice(
            ["none"] * 12
            + ["seq", "instance", "no id", "nan", "inf", "huge", "normal", "count", "frame"]
            + ["state", "unknown", "hold", "expired", "future", "long", "back", "silent", "rearm"]
            + ["desired", "fast", "simulated", "other pose", "no planes"]
        )
        yield from _step(rng, str(fault), now_ns, seq, instance)
        if fault == "instance" and rng.random() < 0.5:
            instance = "second"


def _step(
    rng: np.random.Generator, fault: str, now_ns: int, seq: int, instance: str
) -> Iterator[Event]:
    count = int(rng.integers(1, 9))
    message = PlainConstraint(
        instance_id=instance,
        seq=seq,
        frame="tumor",
        stamp_ns=now_ns - 30 * NS_PER_MS,
        valid_until_ns=now_ns + 120 * NS_PER_MS,
        state=int(rng.integers(3)),
        hold=bool(rng.random() < 0.1),
        simulated=False,
        planes_current=True,
        **random_planes(rng, count),
    )
    if fault == "rearm":
        yield Rearm()
    yield Receive(_broken(rng, fault, message), now_ns)
    for step in range(2):
        desired = rng.normal(size=6) * ([300.0 if fault == "fast" else 60.0] * 3 + [0.6] * 3)
        tip_mm = rng.uniform(-60.0, 60.0, 3)
        if fault == "desired":
            desired[rng.integers(6)] = rng.choice([np.nan, np.inf, -np.inf])
        later = {"silent": 101 * NS_PER_MS, "back": -1}.get(fault, step * NS_PER_MS // 2)
        yield Allow(desired, tip_mm, now_ns + later)


def _broken(rng: np.random.Generator, fault: str, message: PlainConstraint) -> PlainConstraint:
    """``message`` with the fault."""
    if fault in ("nan", "inf", "huge", "normal"):
        value = {"nan": np.nan, "inf": -np.inf, "huge": 1e300, "normal": 1.001}[fault]
        name = str(rng.choice(["normals", "offsets_mm", "points_on_tool_mm"]))
        array = getattr(message, "normals" if fault == "normal" else name).copy()
        array.flat[rng.integers(array.size)] = value
        return replace(message, **{"normals" if fault == "normal" else name: array})
    changes = {
        "seq": {"seq": message.seq - 1 - int(rng.integers(2))},
        "instance": {"instance_id": "second"},
        "no id": {"instance_id": str(rng.choice(["", "x" * 129]))},
        "frame": {"frame": "needle"},
        "state": {"state": int(rng.choice([-1, 4]))},
        "unknown": {"state": int(MarginState.UNKNOWN), "hold": bool(rng.integers(2))},
        "hold": {"hold": True},
        "simulated": {"simulated": True},
        "other pose": {"planes_current": False},
        "expired": {"valid_until_ns": message.stamp_ns + 30 * NS_PER_MS},
        "future": {"stamp_ns": message.stamp_ns + 40 * NS_PER_MS},
        "long": {"valid_until_ns": message.stamp_ns + 10_001 * NS_PER_MS},
    }
    if fault == "count":
        return replace(message, **random_planes(rng, int(rng.choice([9, 12]))))
    if fault == "no planes":
        state = int(rng.choice([message.state, MarginState.UNKNOWN]))
        empty = {name: getattr(message, name)[:0] for name in random_planes(rng, 1)}
        return replace(message, state=state, **empty)
    return replace(message, **changes.get(fault, {}))


def as_line(event: Event) -> str:
    """``event`` as a line for ``rule_driver.cpp``: lengths in m."""
    if isinstance(event, Rearm):
        return "rearm"
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
    return (
        f"receive {event.now_ns} {message.instance_id or '-'} {message.seq} {message.frame} "
        f"{message.stamp_ns} {message.valid_until_ns} {message.state} {int(message.hold)} "
        f"{int(message.simulated)} {int(message.planes_current)} {len(planes)} {_text(planes)}"
    )


def _text(values: FloatArray) -> str:
    return " ".join(f"{value:.17g}" for value in np.ravel(values))
