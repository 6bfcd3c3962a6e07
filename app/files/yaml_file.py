"""The one strict YAML loader: bounded, without duplicate keys and ambiguous numbers.

Duplicate keys, merge keys, deep nesting and tags of Python objects are refused. Aliases are
allowed, because dumpers write them for repeated values: they share a value and cannot expand. A
merge key copies, and copies of copies grow without bound.
"""

import re
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml

from app.files.bounded_io import read_bounded
from app.geometry import InputError, MarginGuardError

MAX_BYTES = 1_000_000
MAX_DEPTH = 16

_NUMBER_TAGS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_MERGE_TAG = "tag:yaml.org,2002:merge"
_AMBIGUOUS_NUMBER = re.compile(r"[_:]|^[-+]?0[0-9xb]")
"""YAML 1.1 reads 1_0 as 10, 1:30 as 90 and 010 as 8; YAML 1.2 does not."""


def load_yaml(
    path: Path,
    *,
    max_bytes: int = MAX_BYTES,
    max_depth: int = MAX_DEPTH,
    error: type[MarginGuardError] = InputError,
) -> Any:
    """Load the YAML document, UTF-8, at ``path``; None for an empty one.

    Raises ``error``, in one line with the place, for a file that cannot be read, that is larger or
    deeper nested than allowed, and for anything but plain YAML.
    """
    try:
        text = read_bounded(path, max_bytes, error).decode("utf-8")
    except UnicodeDecodeError as problem:
        raise error(f"{path} is not UTF-8 text: byte {problem.start}") from problem
    return parse_yaml(text, path, max_depth=max_depth, error=error)


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
    except (yaml.YAMLError, ValueError, RecursionError) as problem:
        reason = (str(problem).splitlines() or [type(problem).__name__])[0]
        raise error(f"{place} is not YAML: {reason}") from problem


class _StrictLoader(yaml.SafeLoader):
    """Safe loader that refuses duplicate keys, merge keys, deep nesting and ambiguous numbers."""

    def __init__(self, content: str | bytes, max_depth: int) -> None:
        super().__init__(content)
        self._max_depth = max_depth
        self._depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self._depth >= self._max_depth:
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise _refused(mark, f"nested deeper than {self._max_depth} levels")
        self._depth += 1
        try:
            node: yaml.Node | None = super().compose_node(parent, index)
        finally:
            self._depth -= 1
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


def _refused(mark: yaml.Mark, problem: str) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=mark)
