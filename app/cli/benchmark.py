"""Runs a benchmark as its own program: ``python -m app.cli.benchmark MODULE OPTION...``.

One that lacks its peers, which come with what tests need, says so in a line.
"""

import runpy
import sys

BAD_INPUT = 2


def main() -> None:
    """Run the module that the first argument names, with the rest as its own."""
    module = sys.argv.pop(1)
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except ModuleNotFoundError as error:
        print(
            f"marginguard: error: this benchmark needs {error.name}, which is not installed: "
            "'make test' installs what tests and benchmarks need",
            file=sys.stderr,
        )
        sys.exit(BAD_INPUT)


if __name__ == "__main__":
    main()
