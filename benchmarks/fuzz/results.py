"""Counts of a run by parser, kept in a file between runs, and their table."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from benchmarks.fuzz.supervisor import WorkerRun


@dataclass(slots=True)
class ParserResult:
    """Counts of one parser over all runs; ``findings`` counts them by signature."""

    next: int = 0
    values: int = 0
    errors: int = 0
    slowest_s: float = 0.0
    peak_bytes: int = 0
    seconds: float = 0.0
    findings: dict[str, int] = field(default_factory=dict)

    @property
    def inputs(self) -> int:
        """Number of inputs that were run."""
        return self.values + self.errors + sum(self.findings.values())

    def add(self, run: WorkerRun, seconds: float) -> None:
        """Add what a worker did in ``seconds``."""
        self.next = run.progress.next
        self.values += run.progress.values
        self.errors += run.progress.errors
        self.slowest_s = max(self.slowest_s, run.progress.slowest_s)
        self.peak_bytes = max(self.peak_bytes, run.progress.peak_bytes)
        self.seconds += seconds
        for finding in run.findings:
            key = f"{finding.outcome.kind} {finding.outcome.signature}"
            self.findings[key] = self.findings.get(key, 0) + 1


def load_results(path: Path | None) -> dict[str, ParserResult]:
    """Results of earlier runs; none where the file does not exist yet."""
    if path is None or not path.exists():
        return {}
    values = json.loads(path.read_text())
    return {name: ParserResult(**each) for name, each in values.items()}


def save_results(path: Path, results: Mapping[str, ParserResult]) -> None:
    """Replace the file at ``path``."""
    partial = path.with_name(f"{path.name}.partial")
    partial.write_text(json.dumps({name: asdict(each) for name, each in results.items()}, indent=1))
    partial.replace(path)


def table(results: Mapping[str, ParserResult]) -> str:
    """Return a Markdown table, one row a parser and one of all."""
    head = "| parser | inputs | values | typed errors | findings | slowest | peak resident |"
    lines = [head, "| --- | ---: | ---: | ---: | ---: | ---: | ---: |"]
    total = ParserResult()
    for name, each in sorted(results.items()):
        lines.append(_row(name, each))
        total.values += each.values
        total.errors += each.errors
        total.slowest_s = max(total.slowest_s, each.slowest_s)
        total.peak_bytes = max(total.peak_bytes, each.peak_bytes)
        for key, count in each.findings.items():
            total.findings[f"{name} {key}"] = count
    return "\n".join([*lines, _row("all", total)])


def _row(name: str, result: ParserResult) -> str:
    return (
        f"| {name} | {result.inputs} | {result.values} | {result.errors} "
        f"| {sum(result.findings.values())} | {result.slowest_s:.2f} s "
        f"| {result.peak_bytes / 2**20:.0f} MiB |"
    )
