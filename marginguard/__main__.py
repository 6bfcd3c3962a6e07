"""The command ``marginguard``, also as ``python -m marginguard``."""

import sys

from marginguard.app_package import check_app

BAD_INPUT = 2


def main() -> int:
    """Run one command and return its exit status; 2 with one line if ``app`` is other code."""
    try:
        check_app()
    except ImportError as error:
        print(f"marginguard: error: {error}", file=sys.stderr)
        return BAD_INPUT
    from app.cli.main import main as run_command

    return run_command()


if __name__ == "__main__":
    sys.exit(main())
