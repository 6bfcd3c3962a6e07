"""What the fuzzer needs to know of a parser."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

Mutator = Callable[[bytes, Random], bytes]
"""Returns a changed copy of a document, or the document where it finds nothing to change. What it
raises has no effect but that."""

MAX_INPUT_BYTES = 1_000_000
"""Inputs are cut to this size."""


@dataclass(frozen=True, slots=True)
class FuzzedParser:
    """A function that reads one file, with documents to start from and mutations of them.

    ``parse``
        Gets the path of the file and returns anything. It reads a result that is lazy to its end.
        An error must be a `MarginGuardError` of one line.
    ``file_name``
        Name of the file. It is alone in a folder with ``companions``.
    ``seeds``
        Returns documents, most of them valid. Called once in each worker.
    ``companions``
        Files beside it, by name, which stay the same.
    ``names_file``
        Whether an error must contain the name of the file or of its folder; not for messages from
        a network.
    """

    name: str
    file_name: str
    parse: Callable[[Path], object]
    seeds: Callable[[], Sequence[bytes]]
    mutators: Sequence[Mutator]
    companions: Mapping[str, bytes] = field(default_factory=dict)
    names_file: bool = True


def make_input(parser: FuzzedParser, seeds: Sequence[bytes], seed: int, number: int) -> bytes:
    """Return input ``number``; the first inputs are the seed documents as they are."""
    if number < len(seeds):
        return seeds[number]
    random = Random(f"{seed}:{parser.name}:{number}")
    data = random.choice(seeds)
    for _ in range(random.choice((1, 1, 1, 2, 2, 3, 5))):
        mutate = random.choice(parser.mutators)
        # A mutator that cannot read what an earlier one has left changes nothing.
        with suppress(Exception):
            data = mutate(data, random)[:MAX_INPUT_BYTES]
    return data
