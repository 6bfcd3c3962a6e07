"""Plan an operation before it begins: needle corridors on a case, an approach of a robot, which
can then be executed.

Exit status: 0; 2 on bad input, and where there is no plan: one line says why.
"""

import argparse

from app.cli.parsing import CommandParser, add_debug
from app.cli.planning import approach, execute, needle_corridors, serve

SUMMARY = "plan needle corridors on a case, or an approach of a robot, and execute it"
PLANS = (needle_corridors, approach, execute, serve)


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
