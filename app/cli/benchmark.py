"""Run a benchmark as its own program: ``python -m app.cli.benchmark MODULE OPTION...``.

Prints one line when the peer of a benchmark is not installed; peers come with the extra ``test``.
"""

import runpy
import sys

BAD_INPUT = 2


def main() -> None:
    """Run the module that the first argument names, with the remaining arguments."""
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
