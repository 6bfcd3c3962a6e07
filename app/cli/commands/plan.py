"""Plan an operation on a case before it begins: straight needle corridors.

Exit status: 0; 2 on bad input, and where nothing is allowed: one line says what blocks most.
"""

import argparse

from app.cli.parsing import CommandParser, add_debug
from app.cli.planning import needle_corridors

SUMMARY = "plan straight needle corridors on a case"
PLANS = (needle_corridors,)


def add_arguments(parser: CommandParser) -> None:
    """Declare the plans of ``marginguard plan`` and their options."""
    subparsers = parser.add_subparsers(dest="plan", metavar="PLAN", required=True)
    for module in PLANS:
        subparser = subparsers.add_parser(
            module.NAME, help=module.SUMMARY, description=module.__doc__
        )
        add_debug(subparser)
        module.add_arguments(subparser)
        subparser.set_defaults(run_plan=module.run)


def run(options: argparse.Namespace) -> int:
    """Make the chosen plan."""
    status: int = options.run_plan(options)
    return status
