"""Reads the hand of a world: its script, joystick and haptic device."""

import numpy as np

from app.files.document import Section
from app.fixture import PassivityError
from app.geometry import InputError, Transform
from app.simulation.errors import WorldError
from app.simulation.haptic_coupling import HapticParameters
from app.simulation.world_entries import DeviceEntry, HandEntry, JoyEntry, Push

MAX_AXIS = 63


def read_hand(block: Section) -> HandEntry:
    """Read ``hand``. Raises `WorldError`."""
    pushes = tuple(
        Push(*read_interval(each), each.text("towards"), each.boolean("retreat"))
        for each in (block.sections("pushes") if "pushes" in block else ())
    )
    period_s = block.number("period_s") if "period_s" in block else None
    last_s = max((push.end_s for push in pushes), default=0.0)
    if period_s is not None and period_s < last_s:
        raise WorldError(
            f"{block.place('period_s')} is {period_s:g}; "
            f"expected at least the end of the last push ({last_s:g})"
        )
    force_n = block.number("force_n")
    return HandEntry(
        block.text("robot"),
        force_n,
        block.number("free_speed_mm_s"),
        pushes,
        period_s,
        _joy(block.section("joy")) if "joy" in block else None,
        _device(block.section("device"), force_n) if "device" in block else None,
    )


def read_interval(block: Section) -> tuple[float, float]:
    """``start_s`` and ``end_s``. Raises `WorldError` unless they are in this order."""
    start_s, end_s = block.number("start_s"), block.number("end_s")
    if end_s <= start_s:
        raise WorldError(
            f"{block.place('end_s')} is {end_s:g}; expected a time after start_s ({start_s:g})"
        )
    return start_s, end_s


def _joy(block: Section) -> JoyEntry:
    axes = block.numbers("axes")
    is_valid = all(each == int(each) and 0 <= each <= MAX_AXIS for each in axes)
    if not is_valid or len(set(axes)) < len(axes):
        raise WorldError(
            f"{block.place('axes')} is {list(axes)}; "
            f"expected three different integers from 0 to {MAX_AXIS}"
        )
    signs = block.numbers("signs") if "signs" in block else (1.0, 1.0, 1.0)
    if any(abs(each) != 1.0 for each in signs):
        raise WorldError(f"{block.place('signs')} is {list(signs)}; expected 1 or -1 for each")
    x, y, z = (int(each) for each in axes)
    sign_x, sign_y, sign_z = signs
    return JoyEntry(
        _topic(block, "topic", "/joy"), (x, y, z), (sign_x, sign_y, sign_z), block.number("dead")
    )


def _device(block: Section, force_n: float) -> DeviceEntry:
    turn = block.numbers("rotation_deg") if "rotation_deg" in block else (0.0, 0.0, 0.0)
    try:
        haptic = HapticParameters(
            block.number("stiffness_n_m"),
            force_n,
            block.number("scale"),
            block.number("period_ms") / 1000.0,
            block.number("delay_ms") / 1000.0,
            block.number("damping_n_s_m"),
        )
    except (InputError, PassivityError) as error:
        raise WorldError(f"{block.place('stiffness_n_m')}: {error}") from error
    rotation = Transform.from_rotation_vector(
        np.radians(turn), np.zeros(3), target="world", source="device"
    ).rotation
    return DeviceEntry(_topic(block, "namespace", ""), haptic, rotation)


def _topic(block: Section, key: str, default: str) -> str:
    name = block.text(key) if key in block else default
    if not name.startswith("/") or name.endswith("/"):
        raise WorldError(f"{block.place(key)} is {name!r}; expected a name such as /joy")
    return name
