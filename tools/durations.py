"""List the most expensive tests of recorded runs: their share, their trend, and their tier.

    python -m tools.durations out/tests/suite.xml [out/tests/long.xml ...] [--most 15] [--record]

``make test`` and the other tiers write these files (JUnit XML). The trend compares each test file
with `RECORDED`, which ``--record`` replaces for the files that ran; the order of the tests follows
it, so that the workers end together. Times include set-up and tear-down.
"""

import argparse
import csv
import sys
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

from lxml import etree

from tests.tiers import DURATIONS as RECORDED
from tests.tiers import PROJECT_ROOT as ROOT
from tests.tiers import seconds_by_file, tier_of

FAST_S = 3.0
"""A file of the fast tier that takes longer belongs to the slow tests of the suite."""
SUITE_S = 25.0
"""A file of the suite that takes longer is one that two workers can no longer balance."""


def read_run(path: Path) -> Counter[tuple[str, str]]:
    """Seconds by file and test of a run; raises `ValueError` if ``path`` is no JUnit XML file."""
    try:
        cases = list(etree.parse(path).iter("testcase"))
    except (OSError, etree.XMLSyntaxError) as error:
        raise ValueError(f"{path}: not readable ({error}); expected JUnit XML of pytest") from None
    seconds: Counter[tuple[str, str]] = Counter()
    for case in cases:
        seconds[test_file(case.get("classname", "")), case.get("name", "")] += float(
            case.get("time")
        )
    return seconds


def test_file(classname: str) -> str:
    """Path of the test file from the dotted name of its module, which may end with a class."""
    path = Path(*classname.split("."))
    for candidate in (path, *path.parents):
        if (ROOT / candidate.with_suffix(".py")).is_file():
            return candidate.with_suffix(".py").as_posix()
    return f"{path.as_posix()}.py"


def write_record(seconds: Mapping[str, float]) -> None:
    """Replace the recorded times of the files in ``seconds``; forget files that are gone."""
    merged = {
        name: time for name, time in seconds_by_file(RECORDED).items() if (ROOT / name).is_file()
    }
    merged |= {name: round(time, 1) for name, time in seconds.items()}
    with RECORDED.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(("file", "seconds"))
        rows.writerows(row for row in sorted(merged.items()) if (ROOT / row[0]).is_file())


def misplaced(seconds: Mapping[str, float]) -> list[str]:
    """Files whose measured time does not fit their tier, each with what to do."""
    rules = (("fast", FAST_S, "mark it slow"), ("slow", SUITE_S, "shorten it, or mark it long"))
    return [
        f"{name}: {seconds[name]:.1f} s in the tier {tier!r}; expected at most {limit:g} s: {todo}"
        for name in sorted(seconds)
        for tier, limit, todo in rules
        if (ROOT / name).is_file() and tier_of(ROOT / name) == tier and seconds[name] > limit
    ]


def by_file(tests: Mapping[tuple[str, str], float]) -> Counter[str]:
    """Seconds by file."""
    files: Counter[str] = Counter()
    for (name, _), time in tests.items():
        files[name] += time
    return files


def report(tests: Counter[tuple[str, str]], before: Mapping[str, float], most: int) -> str:
    """Text: the sum, the most expensive files with share and trend, the most expensive tests."""
    files = by_file(tests)
    total = files.total()
    lines = [f"{len(tests)} tests in {len(files)} files: {total:.0f} s in all workers", ""]
    lines += [f"{'seconds':>8} {'share':>6} {'recorded':>9}  file"]
    for name, time in files.most_common(most):
        past = f"{before[name]:9.1f}" if name in before else "      new"
        lines.append(f"{time:8.1f} {time / total:6.1%} {past}  {name}")
    lines += ["", f"{'seconds':>8}  test"]
    lines += [f"{time:8.1f}  {name}::{test}" for (name, test), time in tests.most_common(most)]
    return "\n".join([*lines, "", *misplaced(files)]).rstrip()


def main(arguments: Iterable[str] | None = None) -> int:
    """Print the report; exit status 2 if a file is not readable."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("runs", nargs="+", type=Path, help="JUnit XML files of test runs")
    parser.add_argument("--most", type=int, default=15, help="rows of each table (15)")
    parser.add_argument("--record", action="store_true", help=f"write {RECORDED.name}")
    options = parser.parse_args(None if arguments is None else list(arguments))
    tests: Counter[tuple[str, str]] = Counter()
    try:
        for path in options.runs:
            tests.update(read_run(path))
    except ValueError as error:
        print(f"tools.durations: {error}", file=sys.stderr)
        return 2
    print(report(tests, seconds_by_file(RECORDED), options.most))
    if options.record:
        write_record(by_file(tests))
    return 0


if __name__ == "__main__":
    sys.exit(main())
