"""The one strict YAML loader: bounded, without duplicate keys and ambiguous numbers.

Duplicate keys, merge keys, deep nesting and tags are refused. Aliases are allowed, because dumpers
write them for repeated values, but the document must stay small with its aliases written out: a
reader visits a shared value as often as it is named. A date is a text, as in YAML 1.2.
"""

import re
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import Composer
from yaml.constructor import SafeConstructor
from yaml.cyaml import CParser  # type: ignore[attr-defined]
from yaml.resolver import Resolver

from app.files.bounded_io import read_text
from app.geometry import InputError, MarginGuardError

MAX_BYTES = 1_000_000
MAX_DEPTH = 16
MAX_NODES = 50_000
"""Limit for the scalars, lists and mappings of a document with its aliases written out."""

_NUMBER_TAGS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_DATE_TAG = "tag:yaml.org,2002:timestamp"
_MERGE_TAG = "tag:yaml.org,2002:merge"
_AMBIGUOUS_NUMBER = re.compile(r"[_:]|^[-+]?0[0-9xb]")
"""YAML 1.1 reads 1_0 as 10, 1:30 as 90 and 010 as 8; YAML 1.2 does not."""


def load_yaml(path: Path) -> Any:
    """Load the YAML document, UTF-8, at ``path``; None for an empty one.

    Raises `InputError`, in one line with the place, for a file that cannot be read, that is larger
    than `MAX_BYTES` or deeper nested than `MAX_DEPTH`, for more than `MAX_NODES` values, and for
    anything but plain YAML.
    """
    return parse_yaml(read_text(path, MAX_BYTES), path)


def parse_yaml(
    content: str | bytes,
    place: Path | str,
    *,
    max_depth: int = MAX_DEPTH,
    error: type[MarginGuardError] = InputError,
) -> Any:
    """Parse YAML text, or bytes of UTF-8 or UTF-16; ``place`` is for messages. See `load_yaml`."""
    try:
        loader = _StrictLoader(content, max_depth)
        try:
            return loader.get_single_data()
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as problem:
        mark = problem.problem_mark
        line = f" line {mark.line + 1}" if mark else ""
        raise error(f"{place}{line}: {problem.problem}") from problem
    # ValueError: an integer of more digits than Python converts.
    except (yaml.YAMLError, ValueError) as problem:
        reason = (str(problem).splitlines() or [type(problem).__name__])[0]
        raise error(f"{place} is not YAML: {reason}") from problem


class _StrictLoader(Composer, CParser, SafeConstructor, Resolver):
    """Safe loader that refuses what the module describes, and ambiguous numbers.

    The events come from libyaml, which reads 1 MB in a fraction of a second; the Python scanner
    takes several.
    """

    def __init__(self, content: str | bytes, max_depth: int) -> None:
        CParser.__init__(self, content)
        Composer.__init__(self)
        SafeConstructor.__init__(self)
        Resolver.__init__(self)
        self._max_depth = max_depth
        self._depth = 0
        self._nodes = 0
        self._nodes_in: dict[yaml.Node, int] = {}

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event: Any = self.peek_event()
        is_alias = isinstance(event, yaml.AliasEvent)
        if not is_alias and event.tag is not None:
            raise _refused(event.start_mark, f"the tag {event.tag[:60]!r} is not allowed")
        if self._depth >= self._max_depth:
            raise _refused(event.start_mark, f"nested deeper than {self._max_depth} levels")
        before = self._nodes
        self._depth += 1
        try:
            node: yaml.Node | None = super().compose_node(parent, index)
        finally:
            self._depth -= 1
        if node is None:
            return None
        if is_alias:
            if node not in self._nodes_in:  # composed before all its items
                raise _refused(event.start_mark, f"the alias {event.anchor!r} contains itself")
            self._nodes += self._nodes_in[node]
        else:
            self._nodes += 1
            self._nodes_in[node] = self._nodes - before
        if self._nodes > MAX_NODES:
            raise _refused(event.start_mark, f"more than {MAX_NODES} values")
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise _refused(key.start_mark, "a key is a list or a mapping; expected a scalar")
            if key.tag == _MERGE_TAG:
                raise _refused(key.start_mark, "a merge key (<<) is not allowed")
            if key.value in lines:
                raise _refused(
                    key.start_mark,
                    f"duplicate key {key.value!r}, first in line {lines[key.value]}",
                )
            lines[key.value] = key.start_mark.line + 1
        return super().construct_mapping(node, deep)

    def construct_scalar(self, node: Any) -> Any:
        if node.tag in _NUMBER_TAGS and _AMBIGUOUS_NUMBER.search(node.value):
            raise _refused(
                node.start_mark,
                f"{node.value[:60]!r} is an ambiguous number; use plain decimal digits",
            )
        return super().construct_scalar(node)


_StrictLoader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag != _DATE_TAG]
    for first, resolvers in Resolver.yaml_implicit_resolvers.items()
}


def _refused(mark: yaml.Mark, problem: str) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=mark)
