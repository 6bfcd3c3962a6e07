"""``margin.csv``: one row per frame; its bytes do not depend on the machine or the replay rate."""

from collections.abc import Sequence

from app.report.rows import ReportRow, seconds_since

COLUMNS = (
    "t_s",
    "stamp_ns",
    "state",
    "signed_distance_mm",
    "lower_bound_mm",
    "reasons",
    "tip_x_mm",
    "tip_y_mm",
    "tip_z_mm",
)
CAUTERY = "cautery"
"""Last column, of a case with a source of the cautery's state."""


def margin_csv(rows: Sequence[ReportRow]) -> str:
    """Return the text of ``margin.csv``: a header and one line per row, each ended by a line feed.

    Times and lengths have 6 decimals, an unknown value is an empty cell, reasons are joined by
    ``;``. No cell needs quotes: the names of states and reasons have no commas.
    """
    if all(row.cautery is None for row in rows):
        lines = [",".join(COLUMNS)]
        lines.extend(",".join(_cells(row, rows[0].stamp_ns)) for row in rows)
    else:
        lines = [",".join((*COLUMNS, CAUTERY))]
        lines.extend(
            ",".join((*_cells(row, rows[0].stamp_ns), str(row.cautery or ""))) for row in rows
        )
    return "\n".join(lines) + "\n"


def _cells(row: ReportRow, first_ns: int) -> tuple[str, ...]:
    x, y, z = row.tip_mm or (None, None, None)
    return (
        _number(seconds_since(first_ns, row.stamp_ns)),
        str(row.stamp_ns),
        row.state.name,
        _number(row.signed_distance_mm),
        _number(row.lower_bound_mm),
        ";".join(row.reasons),
        _number(x),
        _number(y),
        _number(z),
    )


def _number(value: float | None) -> str:
    if value is None:
        return ""
    text = f"{value:.6f}"
    # The sign of a rounded zero depends on the last bit, which differs between machines.
    return text[1:] if text == "-0.000000" else text
