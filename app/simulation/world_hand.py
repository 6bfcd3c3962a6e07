"""``hand`` of ``world.yaml``: who or what pushes a robot's tool. Its keys, values and reader."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from app.files.declared import By, block_of
from app.files.document import Section
from app.files.keys import Block, Boolean, ListOf, Number, Numbers, Text
from app.fixture import PassivityError
from app.geometry import FloatArray, InputError, Transform
from app.simulation.errors import WorldError
from app.simulation.hand import HapticParameters

MAX_AXIS = 63
ORDERED_TIMES = "end_s is after start_s"
ENDS_IN_PERIOD = "period_s is not before the end of the last push"
AXIS_NUMBERS = "axes are integers from 0 to 63 that differ, signs 1 or -1"
PASSIVE = "stiffness_n_m is below damping_n_s_m / (scale^2 (period / 2 + delay))"


def check_interval(block: Section, start_s: float, end_s: float) -> None:
    """Raise `WorldError` unless the times are in this order."""
    if end_s <= start_s:
        raise WorldError(
            f"{block.place('end_s')} is {end_s:g}; expected a time after start_s ({start_s:g})"
        )


@dataclass(frozen=True, slots=True)
class Push:
    """The hand pushes towards the origin of a named body, or away from it."""

    start_s: Annotated[float, Number("start", minimum=0.0)]
    end_s: Annotated[float, Number("end, after the start")]
    towards: Annotated[str, Text("the tool, body or tissue whose origin is pushed at")]
    retreat: Annotated[bool, Boolean("away from it instead", default=False)] = False

    def check(self, block: Section) -> None:
        """Raise `WorldError` for a push without duration."""
        check_interval(block, self.start_s, self.end_s)


def _axes(block: Section) -> tuple[int, ...]:
    axes = block.numbers("axes")
    is_valid = all(each == int(each) and 0 <= each <= MAX_AXIS for each in axes)
    if not is_valid or len(set(axes)) < len(axes):
        raise WorldError(
            f"{block.place('axes')} is {list(axes)}; "
            f"expected three different integers from 0 to {MAX_AXIS}"
        )
    return tuple(map(int, axes))


def _signs(block: Section) -> tuple[float, ...]:
    signs: tuple[float, ...] = block.value("signs") or (1.0, 1.0, 1.0)
    if any(abs(each) != 1.0 for each in signs):
        raise WorldError(f"{block.place('signs')} is {list(signs)}; expected 1 or -1 for each")
    return signs


def _topic(block: Section, key: str, default: str) -> str:
    name: str = block.value(key) or default
    if not name.startswith("/") or name.endswith("/"):
        raise WorldError(f"{block.place(key)} is {name!r}; expected a name such as /joy")
    return name


@dataclass(frozen=True, slots=True)
class JoyEntry:
    """A joystick or 3D mouse: which axes of ``topic`` push along x, y and z, and with which signs.

    Axes whose length is below ``dead`` count as 0.
    """

    topic: Annotated[
        str,
        Text("its topic; default: /joy", optional=True),
        By(lambda joy: _topic(joy, "topic", "/joy")),
    ]
    axes: Annotated[
        tuple[int, int, int],
        Numbers("which of its axes, from 0, push along x, y and z of the world", 3),
        By(_axes),
    ]
    signs: Annotated[
        tuple[float, float, float],
        Numbers("1 or -1 for each; default: 1", 3, optional=True),
        By(_signs),
    ]
    dead: Annotated[
        float, Number("axes shorter than this count as 0", default=0.05, minimum=0.0, maximum=0.9)
    ]


@dataclass(frozen=True, slots=True, eq=False)
class DeviceEntry:
    """A haptic device with the topics of CRTK in ``namespace``.

    ``world_from_device`` (3, 3) turns its axes into those of the world.
    """

    namespace: str
    haptic: HapticParameters
    world_from_device: FloatArray


_DEVICE = Block(
    "haptic device with the topics of CRTK, for simulate --hand device: a spring to the tool",
    {
        "namespace": Text("namespace of its measured_cp and servo_cf, such as /touch"),
        "stiffness_n_m": Number("stiffness of the spring at the tool", above=0.0),
        "scale": Number("way of the tool per way of the handle", above=0.0, maximum=100.0),
        "period_ms": Number("period of its forces", minimum=0.5, maximum=20.0),
        "delay_ms": Number("delay from its pose to its force, besides half a period", minimum=0.0),
        "damping_n_s_m": Number("physical damping of its handle", above=0.0),
        "rotation_deg": Numbers(
            "axis times angle from its axes to those of the world; default: none", 3, optional=True
        ),
    },
    rules=(PASSIVE,),
    optional=True,
)


def _device(hand: Section) -> DeviceEntry | None:
    """Read the device, whose largest force is that of the ``hand``."""
    block: Section | None = hand.value("device")
    if block is None:
        return None
    try:
        haptic = HapticParameters(
            block.number("stiffness_n_m"),
            hand.number("force_n"),
            block.number("scale"),
            block.number("period_ms") / 1000.0,
            block.number("delay_ms") / 1000.0,
            block.number("damping_n_s_m"),
        )
    except (InputError, PassivityError) as error:
        raise WorldError(f"{block.place('stiffness_n_m')}: {error}") from error
    rotation = Transform.from_rotation_vector(
        np.radians(block.value("rotation_deg") or (0.0, 0.0, 0.0)),
        np.zeros(3),
        target="world",
        source="device",
    ).rotation
    return DeviceEntry(_topic(block, "namespace", ""), haptic, rotation)


@dataclass(frozen=True, slots=True)
class HandEntry:
    """A hand on the tool of ``robot``; ``free_speed_mm_s`` is for its controller.

    Script: the pushes repeat every ``period_s``, None for pushes that are done once. ``joy`` and
    ``device`` are what a person can move it by, None without.
    """

    robot: Annotated[str, Text("name of the robot")]
    force_n: Annotated[float, Number("force of a push", default=10.0, above=0.0, maximum=200.0)]
    free_speed_mm_s: Annotated[
        float,
        Number(
            "speed of the tool under this force where nothing is near", default=100.0, above=0.0
        ),
    ]
    period_s: Annotated[
        float | None,
        Number(
            "the pushes repeat after this time; default: they are done once",
            optional=True,
            above=0.0,
        ),
    ] = None
    pushes: Annotated[
        tuple[Push, ...],
        ListOf(
            "pushes, in order of time",
            block_of(Push, "a push", rules=(ORDERED_TIMES,)),
            optional=True,
            if_empty="leave it out for none",
        ),
    ] = ()
    joy: Annotated[
        JoyEntry | None,
        block_of(
            JoyEntry,
            "joystick or 3D mouse (sensor_msgs/Joy), for simulate --hand joy",
            rules=(AXIS_NUMBERS,),
            optional=True,
        ),
    ] = None
    device: Annotated[DeviceEntry | None, _DEVICE, By(_device)] = None

    def check(self, block: Section) -> None:
        """Raise `WorldError` for pushes that are repeated before the last one has ended."""
        last_s = max((push.end_s for push in self.pushes), default=0.0)
        if self.period_s is not None and self.period_s < last_s:
            raise WorldError(
                f"{block.place('period_s')} is {self.period_s:g}; "
                f"expected at least the end of the last push ({last_s:g})"
            )


HAND = block_of(
    HandEntry,
    "hand that pushes a robot's tool; default: none",
    rules=(ENDS_IN_PERIOD,),
    optional=True,
)
