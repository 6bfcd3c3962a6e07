"""Definitions of ``marginguard_msgs``: installed, expected by this program, and on the graph.

ROS identifies a definition by its type hash (RIHS01). Fast DDS connects endpoints whose hashes
differ and then decodes the bytes by the wrong definition, so that hashes have to be compared here.
"""

import json
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from functools import cache, wraps
from pathlib import Path
from types import MappingProxyType
from typing import Any

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from app.bridge.ros_errors import BridgeError

PACKAGE = "marginguard_msgs"

EXPECTED: Mapping[str, str] = MappingProxyType(
    {
        "action/Calibrate": "d06993f7706cb31cd40afb9aa427e451bd9e78b51bf79dae4766292ca70b8404",
        "action/Execute": "4110caad893909bd3596b1fa85fb0332ef7e253bfc148f0cdf8ab7ec414fd983",
        "action/Plan": "8de95f029a9500d54a12f094afd680e2d175aae6f28ab1c5ac5c759ab7534c7c",
        "action/Replay": "067bca1b542924cc25ac8461f06a0c824c9dba52fd7d02a60e9f8f5cc657a626",
        "msg/FixtureConstraint": "6f404ca91383c1ef261c47ff8225fad2598422265c3fb61d50a039d6bdd5c0dd",
        "msg/HalfSpace": "02bce709059039dd01c9b15c4c43179381416f98d7c21f161a35cc07d894ee99",
        "msg/SessionContent": "e61049ee262cf4846c429f26a97605c3590d66a92b2876715f4be854d8ed49ac",
        "msg/SessionStep": "aca6c05b6c816df5bbd5ea326192cb3bb3ac6a252226b1b7470d73443d35cbbf",
        "msg/StepPoint": "0c8f1963bdafa44a03c3cd6312b63e79475433e9d587d23f16c4eca6da2afa30",
        "msg/StepProximity": "de0067fcd6b6f1f5239865ee568f623515915c4fc949eb495cc2a6faea80dadf",
        "msg/StructureOff": "d7ab105919f837c80444c7a13e61a63c52b558721d567a78a0ef5b325dd7723c",
        "msg/StructureState": "ad2c8d13ab06ae21da04d9bc1c6fc418ae3f81779401bf317c30fe6480c869b5",
        "msg/StructureStep": "d68d1473b17ca642df9980358a619f6adf91b8dd926b8350b5a485c7113b4a38",
        "msg/TrackedTransform": "0066dc1ca1ca07df51e52382b52d9e6501d4a48e505d3ea5b1cee01413ffbb8e",
        "srv/Command": "61d2d00f66e80b5e18208fedacb11bfa9535b3b93aba2b00f7ac430053f0b56c",
        "srv/GetMesh": "cf7d0c48cb17962293417e23ec20eafc560a79203da5fb3e58b7ed3b3d42b6a1",
        "srv/LoadCase": "bac3f9dfc27130b32a998903683f7680cd36ede487bca86b29e1d85ad7df9f6a",
        "srv/NeedleCorridors": "6d766a470456d596cdf20e821e19ac059dae58de31873338fc08f9bf268bb0b5",
        "srv/Rearm": "488c036359792744c7cf52fe92610c338ab51c65a403523efbe281dd5b86af44",
        "srv/Register": "b3b391e223c8a9e71ddf41bc9fff3446daacecdb6b0b4bbb22cb9bac12e38a42",
        "srv/Seek": "5e115e07694acd7f652948175e4be6038a53fa4d9bcd6c35ef99cdf981a18ee8",
        "srv/SetRate": "f7b213eb3f75c29c1869f5e495e7ebab1ea9d45fca16622e2d95e258cd514e44",
        "srv/SetStructure": "8feec60be8e111aab9a9999d9bd8cae4cf51052f8b02ba4324356a00e1c64ec3",
        "srv/SetTumor": "2aba11f42bfe5266376d0aa76af517a9280210493a8e9dabbe685bb4ccec5985",
        "srv/SwitchStructure": "cd469eb94ca9e3a37a0987b105a0b5f2693121759ba3c853fc72906ecd10e219",
    }
)
"""SHA-256 of each definition in ``interfaces/marginguard_msgs``; a test compares both."""

_REMEDY = "install the same marginguard_msgs on both sides ('pip install ./interfaces')"
_INSTALL = "run 'pip install ./interfaces', or build and source the ROS package again"
_SHOWN_DIGITS = 12
_RECHECK_S = 0.1
"""Least time between two checks while there is a problem and the same number of endpoints."""

UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"
"""Name that rmw gives to the node of an endpoint until the node has announced itself."""


@cache
def check_installed() -> None:
    """Raise `BridgeError` if the installed ``marginguard_msgs`` is not the expected one."""
    import marginguard_msgs

    module = Path(str(marginguard_msgs.__file__))
    shares = [folder / "share" / PACKAGE for folder in module.parents]
    share = next((folder for folder in shares if (folder / "msg").is_dir()), None)
    if share is None:
        raise BridgeError(f"{PACKAGE}: {module} has no folder share/{PACKAGE}; {_INSTALL}")
    for name, expected in EXPECTED.items():
        found = _installed_digest(share, name)
        if found != expected:
            raise BridgeError(
                f"{PACKAGE}/{name}: the installed definition ({share}) is "
                f"{_short(found) if found else 'missing'}; expected {_short(expected)}: {_INSTALL}"
            )


def _installed_digest(share: Path, name: str) -> str:
    """Hexadecimal hash of the definition ``name``; empty if it is missing or unreadable."""
    try:
        hashes = json.loads((share / f"{name}.json").read_text("utf-8"))["type_hashes"]
        known = {each["type_name"]: str(each["hash_string"]) for each in hashes}
        return known[f"{PACKAGE}/{name}"].removeprefix("RIHS01_")
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def expected_digest(message_type: type) -> str | None:
    """Hash of one of our message types; None for the types of other packages."""
    package, _, kind = message_type.__module__.partition(".")
    name = f"{kind.partition('.')[0]}/{message_type.__name__}"
    return EXPECTED.get(name) if package == PACKAGE else None


def foreign_endpoints(endpoints: Iterable[TopicEndpointInfo], message_type: type) -> dict[str, str]:
    """Endpoints that announce another definition of ``message_type``: hash by the node's name.

    One that announces no hash, as a program without ROS, is not listed. Empty for the types of
    other packages.
    """
    expected = expected_digest(message_type)
    return {} if expected is None else _announcing_others(endpoints, expected)


def foreign_clients(node: Node, service: str, service_type: type) -> dict[str, str]:
    """Clients of our ``service`` (full name) that announce another definition of ``service_type``.

    Hash of the request by the node's name. ROS lists no endpoints of services, but their topics in
    DDS: the hash to compare with is that of the service's own reader of requests. Empty for the
    types of other packages.
    """
    if service_type.__module__.partition(".")[0] != PACKAGE:
        return {}
    topic = f"rq{service}Request"
    ours = (node.get_name(), node.get_namespace())
    own = [
        each
        for each in node.get_subscriptions_info_by_topic(topic, no_mangle=True)
        if (each.node_name, each.node_namespace) == ours and each.topic_type_hash.version == 1
    ]
    if not own:
        return {}
    clients = node.get_publishers_info_by_topic(topic, no_mangle=True)
    connected = [each for each in clients if each.topic_type == own[0].topic_type]
    return _announcing_others(connected, bytes(own[0].topic_type_hash.value).hex())


def _announcing_others(endpoints: Iterable[TopicEndpointInfo], expected: str) -> dict[str, str]:
    """Other hashes than ``expected`` by the names of the nodes."""
    found = {}
    for info in endpoints:
        announced = info.topic_type_hash
        if announced.version == 1 and bytes(announced.value).hex() != expected:
            namespace = info.node_namespace.rstrip("/")
            found[f"{namespace}/{info.node_name}"] = bytes(announced.value).hex()
    return found


def _shown(node: str) -> str:
    return "a node without a known name" if node.endswith(UNKNOWN_NODE) else node


def are_named(nodes: Iterable[str]) -> bool:
    """True if the names of all ``nodes`` of `foreign_endpoints` are known."""
    return not any(node.endswith(UNKNOWN_NODE) for node in nodes)


class DefinitionWatch:
    """The endpoints at the other side of one of our topics, and whether their definitions differ.

    ``endpoints()`` lists them, ``count()`` is the number of those that are connected. `problem` is
    a text while an endpoint has another definition, otherwise empty; ``changed(text)`` is called
    with each new one, as soon as the names of the nodes are known. ``clock_s`` is monotonic.
    Thread-safe.
    """

    def __init__(
        self,
        topic: str,
        message_type: type,
        consequence: str,
        endpoints: Callable[[], Iterable[TopicEndpointInfo]],
        count: Callable[[], int],
        changed: Callable[[str], None],
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._topic = topic
        self._type = message_type
        self._consequence = consequence
        self._endpoints = endpoints
        self._count = count
        self._changed = changed
        self._clock_s = clock_s
        self._lock = threading.Lock()
        self._checked: int | None = None
        self._checked_s = 0.0
        self._logged = ""
        self.problem = ""

    def is_clean(self) -> bool:
        """True if no connected endpoint has another definition.

        Checks anew if the number of endpoints has changed, and at 10 Hz at most while there is a
        problem: an endpoint that never connected can leave without a change of that number. False
        as well while the graph does not know all connected endpoints yet.
        """
        if self._checked != self._count() or (
            self.problem and self._clock_s() - self._checked_s >= _RECHECK_S
        ):
            self.check()
        return self._checked is not None and not self.problem

    def check(self) -> None:
        """Compare the definitions of all endpoints now."""
        with self._lock:
            count = self._count()
            endpoints = list(self._endpoints())
            foreign = foreign_endpoints(endpoints, self._type)
            is_complete = len(endpoints) >= count and are_named(foreign)
            self._checked = count if is_complete else None
            self._checked_s = self._clock_s()
            self.problem = self._text(foreign) if foreign else ""
            is_new = is_complete and self.problem not in ("", self._logged)
            if is_complete:
                self._logged = self.problem
        if is_new:
            self._changed(self.problem)

    def _text(self, foreign: Mapping[str, str]) -> str:
        expected = expected_digest(self._type) or ""
        nodes = ", ".join(
            f"{_shown(node)} ({_short(digest)})" for node, digest in sorted(foreign.items())
        )
        return (
            f"{self._topic}: {nodes} has another definition of {PACKAGE}/msg/"
            f"{self._type.__name__} than this node ({_short(expected)}), {self._consequence}; "
            f"{_REMEDY}"
        )


def _short(digest: str) -> str:
    return f"RIHS01_{digest[:_SHOWN_DIGITS]}"


def checked_callback(callback: Callable[..., Any], watch: DefinitionWatch) -> Callable[..., Any]:
    """``callback``, called only while ``watch`` is clean; rclpy sees the same signature."""

    @wraps(callback)
    def checked(*arguments: Any) -> None:
        if watch.is_clean():
            callback(*arguments)

    return checked
