"""The margins as parameters of the node: set live, refused whole when they contradict themselves.

Milliseconds where the margins have nanoseconds, because that is what `case.yaml` has.
"""

from collections.abc import Callable, Mapping

from rclpy.parameter import Parameter

from app.bridge.calls.parameter_server import ParameterDeclaration, ParameterServer
from app.bridge.calls.parameter_values import Plain
from app.bridge.node import RosNode
from app.fixture import MarginParameterError, MarginParameters
from app.geometry import NS_PER_MS

_TEXTS = {
    "stop_mm": "approach ends here; must be less than warn_mm",
    "warn_mm": "amber from here on; must be more than stop_mm",
    "k_tre": "how many sigmas of the registration's error are added to both",
    "v_max_mm_s": "how fast tool and tumour may approach; times the data's age, added to both",
    "stale_after_ns": "older data are not used",
    "release_samples": "so many better samples in a row end a worse state",
    "release_band_mm": "by how much the distance must be better for that",
    "frozen_after_ns": "a pose that repeats itself for longer is a stuck source",
}


class MarginParameterServer:
    """Declares each margin on ``ros`` with unit and range, and hands on every set that is valid.

    ``use(margins)`` is called in the node's thread with each set that differs from the last, the
    first of them at once where ``--ros-args -p`` asks for other values than ``margins``; what it
    raises as a `MarginGuardError` refuses the set as well. Raises `CallError` at the start for
    values that are refused.
    """

    def __init__(
        self, ros: RosNode, margins: MarginParameters, use: Callable[[MarginParameters], None]
    ) -> None:
        self.margins = margins
        self._ros = ros
        self._use = use
        self._server = ParameterServer(ros, _declarations(margins), self._accept)

    @property
    def refused(self) -> int:
        """How many requests were refused."""
        return self._server.refused

    def close(self) -> None:
        """Serve them no more."""
        self._server.close()

    def set(self, **changes: float) -> None:
        """Set some of them from this process, as a request over ROS does: whole or not at all.

        Raises `MarginParameterError` with the reason of a refusal.
        """
        wanted = [Parameter(name, value=value) for name, value in changes.items()]
        result = self._ros.node.set_parameters_atomically(wanted)
        if not result.successful:
            raise MarginParameterError(result.reason)

    def _accept(self, values: Mapping[str, Plain]) -> None:
        margins = margins_of(values)
        if margins != self.margins:
            self._use(margins)
            self.margins = margins


def margins_of(values: Mapping[str, Plain]) -> MarginParameters:
    """The margins from the parameters' values; `MarginParameterError` when they are not valid."""
    found = {}
    for name in MarginParameters.ranges():
        shown = _shown(name)
        value = values.get(shown)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise MarginParameterError(f"{shown} {value!r} is not a number")
        found[name] = round(value * NS_PER_MS) if shown != name else value
    return MarginParameters(**found)  # type: ignore[arg-type]


def _declarations(margins: MarginParameters) -> list[ParameterDeclaration]:
    found = []
    for name, (lowest, highest, unit) in MarginParameters.ranges().items():
        value = getattr(margins, name)
        whole = unit == "samples"
        if unit == "ns":
            value, unit = value / NS_PER_MS, "ms"
            lowest, highest = lowest / NS_PER_MS, highest / NS_PER_MS
        found.append(
            ParameterDeclaration(
                name=_shown(name),
                value=int(value) if whole else float(value),
                text=_TEXTS[name],
                unit=unit,
                lowest=lowest,
                highest=highest,
            )
        )
    return found


def _shown(name: str) -> str:
    return name.removesuffix("_ns") + "_ms" if name.endswith("_ns") else name
