"""Seeds of the parsers of recordings and messages are valid; mutated ones raise our errors."""

from pathlib import Path

import pytest

from app.geometry import MarginGuardError
from benchmarks.fuzz.parser import FuzzedParser, make_input
from benchmarks.fuzz.parsers import messages, recordings

PARSERS = [*recordings.PARSERS, *messages.PARSERS]
INPUTS = 25


@pytest.fixture(params=PARSERS, ids=[parser.name for parser in PARSERS])
def parser(request: pytest.FixtureRequest) -> FuzzedParser:
    found: FuzzedParser = request.param
    return found


def written(parser: FuzzedParser, folder: Path, data: bytes) -> Path:
    folder.mkdir()
    for name, content in parser.companions.items():
        (folder / name).write_bytes(content)
    (folder / parser.file_name).write_bytes(data)
    return folder / parser.file_name


def test_seeds_are_read(parser: FuzzedParser, tmp_path: Path) -> None:
    for number, data in enumerate(parser.seeds()):
        parser.parse(written(parser, tmp_path / str(number), data))


def test_malformed_inputs_raise_errors_of_one_line(parser: FuzzedParser, tmp_path: Path) -> None:
    seeds = parser.seeds()
    for number in range(len(seeds), len(seeds) + INPUTS):
        path = written(parser, tmp_path / str(number), make_input(parser, seeds, 7, number))
        try:
            parser.parse(path)
        except MarginGuardError as error:
            assert str(error).isprintable()
