"""Check this installation: what is installed, what is missing, and the remedy.

Exit status: 0 when nothing is missing, 1 when something is.
"""

import argparse
import json

from app.cli.options import add_json

SUMMARY = "check the installation: what is missing, and the remedy"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard doctor``."""
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Run the checks and print their results."""
    from app.cli.doctor import check_environment

    checks = check_environment()
    if options.json:
        print(json.dumps([check._asdict() for check in checks], indent=2))
    else:
        for check in checks:
            print(f"{'ok' if check.ok else 'MISSING':<8} {check.name:<22} {check.found}")
            if check.remedy:
                print(f"{'':<8} {'':<22} {check.remedy}")
    return 0 if all(check.ok for check in checks) else 1
