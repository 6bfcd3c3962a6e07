"""The options of a benchmark that runs on a case for so many seconds."""

import argparse
from pathlib import Path

_CHECKOUT = Path(__file__).resolve().parents[1]


def case_options(name: str, description: str | None) -> argparse.Namespace:
    """``seconds``, ``case`` and ``json`` from the command line of ``marginguard bench NAME``."""
    parser = argparse.ArgumentParser(
        prog=f"marginguard bench {name}",
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--case", type=Path, default=_CHECKOUT / "data/recorded_case")
    parser.add_argument("--json", type=Path)
    return parser.parse_args()
