"""``cohort.yaml``: the cases of a cohort. Its keys, values, reader and writer."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import yaml

from app.cohort.cases import CohortCase
from app.cohort.design import FIXTURES, OPTION_RANGES, Design, Fixture
from app.files.atomic_io import new_folder
from app.files.document import Section
from app.files.keys import Block, Choice, Integer, ListOf, Numbers, Text, Variant
from app.geometry import InputError
from app.synthetic.tracker_model import PRESETS, tracker_preset

MANIFEST_FILE = "cohort.yaml"


MAX_COUNT = 10_000_000
ORDERED = "low is not above high, and both are within the limits of the option"
UNIQUE_NAMES = "names of cases differ from each other"
KNOWN_TRACKERS = f"trackers are of {', '.join(PRESETS)}"

_SIMULATED = Block(
    "cases that workers make from a seed and ranges of options",
    {
        "count": Integer("number of cases", 1, MAX_COUNT),
        "seed": Integer("of all random values", 0, 2**63 - 1),
        "trackers": ListOf(
            "presets of trackers, of which each case has one",
            Text("preset"),
            if_empty="expected presets",
        ),
        "surgeons": Integer("number of surgeons", 1, 100_000),
        "fixture": Choice(
            "virtual fixture: off, on, paired (two cases of every draw, without and with it) or "
            "alternate (every second case)",
            FIXTURES,
        ),
        **{
            key: Numbers(
                f"{option.description}: low and high, {option.low:g} to {option.high:g}",
                2,
                optional=True,
            )
            for key, option in OPTION_RANGES.items()
        },
    },
    optional=True,
    rules=(ORDERED, KNOWN_TRACKERS),
)

_CASE = Block(
    "a recorded case",
    {
        "name": Text("name, unique in the cohort"),
        "source": Text("case folder: a path, relative to this file, or a URL"),
        "group": Text("group in a comparison; default: none", optional=True),
        "surgeon": Text("who operated; default: unknown", optional=True),
        "pair": Text("name that joins a case of each group; default: none", optional=True),
    },
)

COHORT = Block(
    "a cohort",
    {
        "schema": Integer("version of the format", 1, 1),
        "name": Text("name of the cohort, shown in the report"),
        "simulated": _SIMULATED,
        "cases": ListOf("recorded cases", _CASE, optional=True, if_empty="expected cases"),
    },
    variants=(Variant("simulated", ("simulated",)), Variant("recorded", ("cases",))),
    rules=(UNIQUE_NAMES,),
)


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
    return read_manifest(Section.load(file, COHORT))


def read_manifest(document: Section) -> Cohort:
    """Read a document with the keys of `COHORT`."""
    document.integer("schema")
    name = document.text("name")
    if ("simulated" in document) == ("cases" in document):
        raise InputError(f"{document.where} has both or none of simulated, cases; expected one")
    if "simulated" in document:
        return Cohort(name, _design(document.section("simulated")))
    recorded = tuple(_recorded(each) for each in document.sections("cases"))
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


def _recorded(block: Section) -> CohortCase:
    source = block.text("source")
    if "://" not in source:
        source = str(block.folder.absolute() / source)
    group, surgeon, pair = (block.value(key) or "" for key in ("group", "surgeon", "pair"))
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
