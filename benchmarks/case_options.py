"""Options of benchmarks that run on a case."""

import argparse
import math
from pathlib import Path

from app.cli.options import input_argument

RECORDED_CASE = Path(__file__).resolve().parents[1] / "data/recorded_case"


def case_options(name: str, description: str | None) -> argparse.Namespace:
    """``seconds`` (at least 1), ``case`` and ``json`` from ``marginguard bench NAME``."""
    parser = argparse.ArgumentParser(
        prog=f"marginguard bench {name}",
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="how long (default: 60)")
    parser.add_argument(
        "--case", type=case_folder, default=RECORDED_CASE, help="default: data/recorded_case"
    )
    parser.add_argument("--json", type=Path, help="write the figures there too")
    options = parser.parse_args()
    if not 1.0 <= options.seconds < math.inf:
        parser.error(f"--seconds is {options.seconds:g}; expected 1 or more")
    return options


def case_folder(text: str) -> Path:
    """Case folder of an option; raises `argparse.ArgumentTypeError` without a case.yaml."""
    folder = input_argument(text)
    if not (folder / "case.yaml").is_file():
        raise argparse.ArgumentTypeError(f"{text!r} is no case; expected a folder with a case.yaml")
    return folder
