"""The command ``marginguard``, also as ``python -m marginguard``."""

import sys
from typing import NoReturn

from marginguard.app_package import check_app

BAD_INPUT = 2


def main() -> NoReturn:
    """Run one command and end with its exit status; 2 with one line if ``app`` is other code."""
    try:
        check_app()
    except ImportError as error:
        print(f"marginguard: error: {error}", file=sys.stderr)
        sys.exit(BAD_INPUT)
    from app.cli.main import main as run_command
    from app.cli.process import leave

    leave(run_command())


if __name__ == "__main__":
    main()
