"""Fuzz the parsers of files and messages; print a table, and store each new finding as a file.

Exit status: 1 if there is a finding.
"""

import argparse
import os
import sys
import time
from pathlib import Path

from benchmarks.fuzz.parser import FuzzedParser, make_input
from benchmarks.fuzz.registry import all_parsers, parser_at
from benchmarks.fuzz.results import ParserResult, load_results, save_results, table
from benchmarks.fuzz.supervisor import Finding, run_inputs

_SLICE_S = 60.0
"""Time of one worker; the parsers take turns."""


def main() -> None:
    """Run parsers in turns until the time is over or each has its inputs."""
    parsers = all_parsers()
    options = _parse(sorted(parsers))
    results = load_results(options.state)
    names = options.parsers or sorted(parsers)
    os.nice(options.nice)
    end_s = time.monotonic() + 60.0 * options.minutes
    while time.monotonic() < end_s:
        # The parser that has had the least time is next: some take 50 times longer than others.
        open_names = [n for n in names if _result(results, n).inputs < options.inputs]
        if not open_names:
            break
        name = min(open_names, key=lambda each: _result(results, each).seconds)
        _run_slice(parsers[name], _result(results, name), options, end_s)
        if options.state:
            save_results(options.state, results)
    print(table(results))
    if options.table:
        options.table.write_text(table(results) + "\n")
    sys.exit(any(result.findings for result in results.values()))


def _run_slice(
    address: str, result: ParserResult, options: argparse.Namespace, end_s: float
) -> None:
    parser, start_s = parser_at(address), time.monotonic()
    run = run_inputs(
        address,
        seed=options.seed,
        first=result.next,
        last=result.next + options.inputs - result.inputs,
        seconds=min(_SLICE_S, end_s - start_s),
    )
    known = set(result.findings)
    result.add(run, time.monotonic() - start_s)
    for finding in run.findings:
        key = f"{finding.outcome.kind} {finding.outcome.signature}"
        if key not in known:
            known.add(key)
            path = _store(parser, finding, options)
            first = finding.outcome.detail.strip().splitlines() or [""]
            print(f"{parser.name}: {finding.outcome.kind}: {first[-1][:200]} ({path})", flush=True)
    rate = result.inputs / result.seconds
    print(f"{parser.name}: {result.inputs} inputs, {rate:.0f}/s", file=sys.stderr, flush=True)


def _store(parser: FuzzedParser, finding: Finding, options: argparse.Namespace) -> Path:
    """Write the input and the detail of a finding."""
    folder: Path = options.findings / parser.name
    folder.mkdir(parents=True, exist_ok=True)
    ending = parser.file_name.partition(".")[2]
    path = folder / f"{finding.outcome.kind}-{finding.outcome.signature}.{ending}"
    path.write_bytes(make_input(parser, parser.seeds(), options.seed, finding.number))
    text = f"seed {options.seed} number {finding.number}\n{finding.outcome.detail}\n"
    path.with_name(path.name + ".detail").write_text(text)
    return path


def _result(results: dict[str, ParserResult], name: str) -> ParserResult:
    return results.setdefault(name, ParserResult())


def _parse(names: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="marginguard bench fuzz", description=__doc__, allow_abbrev=False
    )
    parser.add_argument("--minutes", type=float, default=1.0, help="time of the run (default 1)")
    parser.add_argument(
        "--inputs", type=int, default=1_000_000, metavar="N", help="inputs of each parser at most"
    )
    parser.add_argument(
        "--parsers", nargs="+", choices=names, metavar="NAME",
        help=f"parsers to run (default all): {', '.join(names)}",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, default=1, help="seed of the mutations (default 1)")
    parser.add_argument(
        "--state", type=Path, metavar="FILE", help="counts of earlier runs: continued, then saved"
    )
    parser.add_argument("--table", type=Path, metavar="FILE", help="write the table to FILE")
    parser.add_argument(
        "--findings", type=Path, default=Path("fuzz-findings"), metavar="DIR",
        help="folder of the findings (default fuzz-findings)",
    )  # fmt: skip
    parser.add_argument("--nice", type=int, default=0, help="lower the priority by as much")
    return parser.parse_args()


if __name__ == "__main__":
    main()
