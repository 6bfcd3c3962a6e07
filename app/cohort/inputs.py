"""Where the cases of a cohort come from: ``cohort.yaml``, a folder, a list or a URL; their hashes.

URLs are read with fsspec, which has file systems for S3, HTTP and others behind one interface.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any, cast
from urllib.parse import unquote

import yaml

from app.cohort.design import FIXTURES, OPTION_RANGES, CohortCase, Design, Fixture
from app.files.atomic_io import new_folder
from app.files.bounded_io import read_bounded
from app.files.document import Section
from app.files.keys import Block, Choice, Integer, ListOf, Numbers, Text, Variant
from app.files.paths import sha256_of
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


CASE_FILE = "case.yaml"
MAX_LIST_BYTES = 200_000_000


def open_cohort(source: str) -> Cohort:
    """The cohort at ``source``.

    A folder with ``cohort.yaml`` or such a file: its manifest. Another folder or a URL: every
    folder below with a ``case.yaml``; where they are two levels deep, the first level is the group.
    Another file: a list of paths and URLs, one a line, empty lines and ``#`` comments left out.
    Raises `InputError`, also for no case and for two cases with one name.
    """
    if is_url(source):
        cohort = Cohort(source, recorded=tuple(_below_url(source)))
    else:
        path = Path(source)
        if path.suffix in (".yaml", ".yml") or (path / MANIFEST_FILE).is_file():
            return open_manifest(path)
        if path.is_dir():
            cohort = Cohort(path.absolute().name, recorded=tuple(_below(path.absolute())))
        else:
            cohort = Cohort(path.name, recorded=tuple(_listed(path)))
    if not len(cohort):
        raise InputError(f"{source} has no case; expected folders with a {CASE_FILE}")
    return cohort


def is_url(source: str) -> bool:
    """True for a URL."""
    return "://" in source


def input_hash(case: CohortCase) -> str:
    """SHA-256 of what determines the results of ``case``, in hexadecimal.

    A local folder: names and contents of its files. A URL: names and what its file system states of
    each file (size, ETag or time of modification). A simulated case: its seed and options. With
    ``tip_only`` it is another one. Raises `InputError` where there is no such folder.
    """
    digest = hashlib.sha256(b"tip_only\0" if case.tip_only else b"")
    if case.synthetic is not None:
        digest.update(json.dumps(asdict(case.synthetic)).encode())
    elif is_url(case.source):
        system, root = filesystem(case.source)
        for path in url_files(case.source):
            digest.update(f"{PurePosixPath(path).relative_to(root)}\0".encode())
            digest.update(f"{system.ukey(path)}\n".encode())
    else:
        for file in _files(Path(case.source)):
            digest.update(f"{file.relative_to(case.source)}\0{sha256_of(file)}\n".encode())
    return digest.hexdigest()


def filesystem(url: str) -> "tuple[Any, str]":
    """The file system of ``url`` and the path in it; raises `InputError` where it has none."""
    import fsspec

    try:
        system, root = fsspec.core.url_to_fs(url)
    except (ValueError, ImportError, OSError) as error:
        raise InputError(f"{url} cannot be opened: {error}") from error
    return system, root.rstrip("/")


def url_files(url: str) -> list[str]:
    """Paths of all files below ``url`` in its file system, sorted."""
    system, root = filesystem(url)
    try:
        found = sorted(system.find(root))
        if not found:
            system.ls(root)  # raises the error that `find` hides: a server that does not answer
    except Exception as error:  # every file system has errors of its own
        raise InputError(f"{url} cannot be listed: {error}") from error
    outside = [path for path in found if not _is_below(path, root)]
    if outside or not found:
        raise InputError(f"{url} has {outside[:1] or 'no files'}; expected files below it")
    return found


def _is_below(path: str, root: str) -> bool:
    if not path.startswith(f"{root}/"):
        return False
    relative = PurePosixPath(_relative(path, root))
    return not relative.is_absolute() and ".." not in relative.parts and "\0" not in str(relative)


def _relative(path: str, root: str) -> str:
    """``path`` below ``root``; the parts of an address of HTTP are percent-encoded."""
    relative = PurePosixPath(path).relative_to(root).as_posix()
    return unquote(relative) if root.startswith(("http://", "https://")) else relative


def fetch(url: str, folder: Path) -> None:
    """Copy all files below ``url`` to ``folder``; raises `InputError` or `OSError`."""
    system, root = filesystem(url)
    for path in url_files(url):
        target = folder / _relative(path, root)
        target.parent.mkdir(parents=True, exist_ok=True)
        system.get_file(path, str(target))


def _files(folder: Path) -> list[Path]:
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected a case folder")
    found = [Path(parent) / name for parent, _, names in os.walk(folder) for name in names]
    return sorted(path for path in found if path.is_file())


def _below(folder: Path) -> Iterator[CohortCase]:
    found = []
    for parent, folders, names in os.walk(folder):
        folders.sort()
        if CASE_FILE in names:
            folders.clear()
            found.append(Path(parent))
    for path in sorted(found):
        yield _named(path.relative_to(folder).as_posix(), str(path), folder.name)


def _below_url(url: str) -> Iterator[CohortCase]:
    _, root = filesystem(url)
    for path in url_files(url):
        place = PurePosixPath(path)
        if place.name == CASE_FILE:
            relative = place.parent.relative_to(root).as_posix()
            source = f"{url.rstrip('/')}/{relative}"
            yield _named(_relative(str(place.parent), root), source, PurePosixPath(root).name)


def _named(relative: str, source: str, folder: str) -> CohortCase:
    group, inner, _ = relative.partition("/")
    name = folder if relative == "." else relative
    return CohortCase(name, source, group=group if inner else "")


def _listed(path: Path) -> Iterator[CohortCase]:
    try:
        text = read_bounded(path, MAX_LIST_BYTES, InputError).decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text; expected one case a line") from error
    for line in text.splitlines():
        source = line.strip()
        if source and not source.startswith("#"):
            place = source if is_url(source) else str(path.absolute().parent / source)
            yield CohortCase(PurePosixPath(source).name, place)
