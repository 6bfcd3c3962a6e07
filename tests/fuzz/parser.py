"""Description of a parser for the fuzzer, and the inputs that it makes for the parser."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from random import Random

from tests.fuzz.mutators.raw import Mutator

MAX_INPUT_BYTES = 1_000_000
"""Inputs are cut to this size."""


@dataclass(frozen=True, eq=False)
class FuzzedParser:
    """A function that reads one file, with documents to start from and mutations of them.

    ``file_name``
        Name of the file. It is alone in a folder with ``companions``.
    ``parse``
        Gets the path of the file and returns anything. It reads a result that is lazy to its end.
        An error must be a `MarginGuardError` of one line.
    ``seeds``
        Returns valid documents.
    ``companions``
        Files beside it, by name, which stay the same.
    ``names_file``
        Whether an error must contain the name of the file or of its folder; not for messages from
        a network.
    """

    file_name: str
    parse: Callable[[Path], object]
    seeds: Callable[[], Sequence[bytes]]
    mutators: Sequence[Mutator]
    companions: Mapping[str, bytes] = field(default_factory=dict)
    names_file: bool = True

    @cached_property
    def documents(self) -> Sequence[bytes]:
        """The seeds, made once."""
        return self.seeds()

    def write(self, folder: Path, data: bytes) -> Path:
        """Write the file and those beside it to ``folder``; return its path."""
        folder.mkdir(exist_ok=True)
        for name, content in {**self.companions, self.file_name: data}.items():
            (folder / name).write_bytes(content)
        return folder / self.file_name

    def input(self, seed: int, number: int) -> bytes:
        """A seed document with mutations, the same for the same numbers.

        The first inputs are the seeds as they are.
        """
        if number < len(self.documents):
            return self.documents[number]
        random = Random(f"{seed}:{self.file_name}:{number}")
        data = random.choice(self.documents)
        for _ in range(random.choice((1, 1, 1, 2, 2, 3, 5))):
            # A mutator that cannot read what an earlier one has left changes nothing.
            with suppress(Exception):
                data = random.choice(self.mutators)(data, random)[:MAX_INPUT_BYTES]
        return data
