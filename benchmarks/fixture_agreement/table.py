"""Tables of the agreement for a terminal."""

from collections.abc import Mapping

from rich.table import Table

from benchmarks.fixture_agreement.distances import Distances
from benchmarks.fixture_agreement.signs import Signs
from benchmarks.fixture_oracle import Relation


def signs_table(by_pair: Mapping[str, Signs]) -> Table:
    """One row per pair: counts of the oracle's relations, of evaluated and of wrong signs."""
    table = _table(
        "signs: tumours of 1280 triangles and more, beyond 0.05 mm of the surface",
        "poses", *(relation.value for relation in Relation), "within 0.5 mm", "evaluated", "wrong",
    )  # fmt: skip
    for name, row in by_pair.items():
        relations = [row.relations[relation] for relation in Relation]
        cells = (row.poses, *relations, row.grazing, row.judged, len(row.wrong))
        table.add_row(name, *map(str, cells))
    return table


def distances_table(by_pair: Mapping[str, Distances]) -> Table:
    """One row per pair: the errors against the oracle, and the number of invalid bounds."""
    table = _table(
        "distances: tumours of 20480 triangles and more, in mm against a densely sampled tool",
        "poses", "RMS", "max", "bound above",
    )  # fmt: skip
    for name, row in by_pair.items():
        errors = f"{row.rms_mm:.4f}", f"{row.max_mm:.4f}"
        table.add_row(name, str(row.poses), *errors, str(row.above_bound))
    return table


def _table(title: str, *headings: str) -> Table:
    table = Table("tumour / tool", title=title, title_justify="left")
    for heading in headings:
        table.add_column(heading, justify="right")
    return table
