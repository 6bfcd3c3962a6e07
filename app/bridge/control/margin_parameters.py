"""Margins as parameters of the node, validated as a set.

Times are in milliseconds, as in `case.yaml`; the core uses nanoseconds.
"""

import threading
from collections.abc import Callable, Mapping

from rclpy.parameter import Parameter

from app.bridge.calls.parameter_server import ParameterDeclaration, ParameterServer
from app.bridge.calls.parameter_values import Plain
from app.bridge.node import RosNode
from app.fixture import MarginParameterError, MarginParameters
from app.geometry import NS_PER_MS

OVER_ROS = "ROS"
"""Origin of a request of another process."""

_TEXTS = {
    "stop_mm": "distance at which the approach stops; must be less than warn_mm",
    "warn_mm": "distance below which the state is WARNING; must be more than stop_mm",
    "k_tre": "multiple of the registration's sigma that is added to both distances",
    "v_max_mm_s": "maximum speed of approach; times the age of the data, added to both distances",
    "stale_after_ns": "age above which data are stale",
    "release_samples": "number of consecutive better samples that end a worse state",
    "release_band_mm": "by how much the distance must exceed the threshold to count as better",
    "frozen_after_ns": "time after which a pose that does not change counts as frozen",
}


class MarginParameterServer:
    """Declares each margin on ``ros`` with unit and range, and applies every valid set.

    ``use(margins, origin)`` is called with each set that differs from the previous one: in the
    node's thread for a request over ROS, in the caller's for `set`; on construction if
    ``--ros-args -p`` overrides ``margins``. A `MarginGuardError` raised by
    it refuses the set. The constructor raises `CallError` if the initial values are refused.

    `margins` are the requested ones: looser values apply from the next re-arm on.
    ``on_refusal(reason, origin)`` is called for each set that is refused before ``use``.
    """

    def __init__(
        self,
        ros: RosNode,
        margins: MarginParameters,
        use: Callable[[MarginParameters, str], None],
        on_refusal: Callable[[str, str], None] = lambda reason, origin: None,
    ) -> None:
        self.margins = margins
        self._ros = ros
        self._use = use
        self._on_refusal = on_refusal
        self._used = False
        self._setting = threading.Lock()
        self._setter: int | None = None
        self._set_by = OVER_ROS
        self._server = ParameterServer(
            ros, _declarations(margins), self._accept, on_refusal=self._refused
        )

    @property
    def refused(self) -> int:
        """Number of refused requests."""
        return self._server.refused

    def close(self) -> None:
        """Undeclare the parameters."""
        self._server.close()

    def set(self, *, origin: str, **changes: float) -> None:
        """Set margins from this process, atomically, as a ROS request does, listed as ``origin``.

        Raises `MarginParameterError` with the reason if the set is refused.
        """
        parameters = [Parameter(name, value=value) for name, value in changes.items()]
        with self._setting:
            self._setter, self._set_by = threading.get_ident(), origin
            try:
                result = self._ros.node.set_parameters_atomically(parameters)
            finally:
                self._setter = None
        if not result.successful:
            raise MarginParameterError(result.reason)

    def _accept(self, values: Mapping[str, Plain]) -> None:
        self._used = False
        margins = margins_of(values)
        if margins != self.margins:
            self._used = True
            self._use(margins, self._origin())
            self.margins = margins

    def _refused(self, reason: str) -> None:
        used, self._used = self._used, False
        if not used:  # `use` reports its own refusals
            self._on_refusal(reason, self._origin())

    def _origin(self) -> str:
        """Who sets in this thread."""
        return self._set_by if self._setter == threading.get_ident() else OVER_ROS


def margins_of(values: Mapping[str, Plain]) -> MarginParameters:
    """Convert parameter values to margins; raises `MarginParameterError`."""
    found = {}
    for name in MarginParameters.ranges():
        ros_name = _ros_name(name)
        value = values.get(ros_name)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise MarginParameterError(f"{ros_name} is {value!r}; expected a number")
        found[name] = round(value * NS_PER_MS) if ros_name != name else value
    return MarginParameters(**found)  # type: ignore[arg-type]


def _declarations(margins: MarginParameters) -> list[ParameterDeclaration]:
    found = []
    for name, (lowest, highest, unit) in MarginParameters.ranges().items():
        value = getattr(margins, name)
        is_integer = unit == "samples"
        if unit == "ns":
            value, unit = value / NS_PER_MS, "ms"
            lowest, highest = lowest / NS_PER_MS, highest / NS_PER_MS
        found.append(
            ParameterDeclaration(
                name=_ros_name(name),
                value=int(value) if is_integer else float(value),
                text=_TEXTS[name],
                unit=unit,
                lowest=lowest,
                highest=highest,
            )
        )
    return found


def _ros_name(name: str) -> str:
    """Name of the parameter, with ``_ms`` instead of ``_ns``."""
    return name.removesuffix("_ns") + "_ms" if name.endswith("_ns") else name
