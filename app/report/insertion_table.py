"""The metrics of an insertion as rows of a table, for HTML and PDF."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from app.analysis import Insertion


def insertion_rows(found: "Insertion") -> list[tuple[str, str]]:
    """Name and value with its unit of each metric."""
    rows = [
        ("from the first to the last known tip", f"{found.elapsed_s:.3f} s"),
        ("path of the tip", f"{found.path_mm:.1f} mm"),
        ("time with the tip in the tumour", f"{found.tissue_s:.3f} s"),
        ("path of the tip in the tumour", f"{found.tissue_path_mm:.1f} mm"),
    ]
    if found.tissue_damage_mm2 is not None:
        rows.append(
            ("tissue damage (swept by the tool's axis)", f"{found.tissue_damage_mm2:.1f} mm²")
        )
    return rows
