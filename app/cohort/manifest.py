"""Reads and writes ``cohort.yaml``."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import yaml

from app.cohort.cases import CohortCase
from app.cohort.design import OPTION_RANGES, Design, Fixture
from app.cohort.manifest_keys import COHORT
from app.files.atomic_io import new_folder
from app.files.document import Section
from app.geometry import InputError
from app.synthetic.presets import tracker_preset

MANIFEST_FILE = "cohort.yaml"


@dataclass(frozen=True, slots=True)
class Cohort:
    """A name and its cases: those of ``design``, or ``recorded`` ones.

    ``tip_only``: the tool of every case is measured by its tip alone.
    """

    name: str
    design: Design | None = None
    recorded: tuple[CohortCase, ...] = ()
    tip_only: bool = False

    def __post_init__(self) -> None:
        check_names(self.recorded)

    def __len__(self) -> int:
        return len(self.recorded) if self.design is None else self.design.count

    def __iter__(self) -> Iterator[CohortCase]:
        """Yield the cases in their fixed order, drawn one by one."""
        cases: Iterable[CohortCase] = self.recorded
        if self.design is not None:
            cases = map(self.design.case, range(self.design.count))
        for case in cases:
            yield replace(case, tip_only=True) if self.tip_only else case

    def case(self, name: str) -> CohortCase:
        """The case ``name``; raises `InputError` for an unknown one."""
        for case in self:
            if case.name == name:
                return case
        raise InputError(f"cohort {self.name!r} has no case {name!r}; expected one of its names")


def check_names(cases: Iterable[CohortCase]) -> None:
    """Raise `InputError` if two cases have one name."""
    seen: dict[str, str] = {}
    for case in cases:
        if case.name in seen:
            raise InputError(
                f"two cases have the name {case.name!r}: {seen[case.name]} and {case.source}; "
                "expected different names"
            )
        seen[case.name] = case.source


def open_manifest(path: Path) -> Cohort:
    """Read the manifest at ``path``, or ``cohort.yaml`` in that folder."""
    file = path / MANIFEST_FILE if path.is_dir() else path
    return read_manifest(Section.load(file, COHORT), file.parent)


def read_manifest(document: Section, folder: Path) -> Cohort:
    """Read a document with the keys of `COHORT`; relative paths of cases are in ``folder``."""
    document.integer("schema")
    name = document.text("name")
    if ("simulated" in document) == ("cases" in document):
        raise InputError(f"{document.where} has both or none of simulated, cases; expected one")
    if "simulated" in document:
        return Cohort(name, _design(document.section("simulated")))
    recorded = tuple(_recorded(each, folder) for each in document.sections("cases"))
    try:
        return Cohort(name, recorded=recorded)
    except InputError as error:
        raise InputError(f"{document.where} {error}") from error


def _design(block: Section) -> Design:
    trackers = block.texts("trackers")
    for tracker in trackers:
        tracker_preset(tracker)
    ranges = {}
    for key in OPTION_RANGES:
        if key in block:
            low, high = block.numbers(key)
            ranges[key] = (low, high)
    try:
        return Design(
            block.integer("count"),
            block.integer("seed"),
            trackers,
            block.integer("surgeons"),
            cast(Fixture, block.choice("fixture")),
            ranges,
        )
    except InputError as error:
        raise InputError(f"{block.where}: {error}") from error


def _recorded(block: Section, folder: Path) -> CohortCase:
    source = block.text("source")
    if "://" not in source:
        source = str(folder.absolute() / source)
    group, surgeon, pair = (
        block.text(key) if key in block else "" for key in ("group", "surgeon", "pair")
    )
    return CohortCase(block.text("name"), source, group=group, surgeon=surgeon, pair=pair)


def write_manifest(folder: Path, name: str, design: Design) -> None:
    """Write the manifest of simulated cases into ``folder``, which must be new or empty."""
    with new_folder(folder, may_be_empty=True) as partial:
        text = yaml.safe_dump(_document(name, design), sort_keys=False, default_flow_style=None)
        (partial / MANIFEST_FILE).write_text(text, encoding="utf-8")


def _document(name: str, design: Design) -> dict[str, Any]:
    values: Sequence[tuple[str, Any]] = [
        ("count", design.count),
        ("seed", design.seed),
        ("trackers", list(design.trackers)),
        ("surgeons", design.surgeons),
        ("fixture", design.fixture),
        *((key, list(bounds)) for key, bounds in design.ranges.items()),
    ]
    return {"schema": 1, "name": name, "simulated": dict(values)}
