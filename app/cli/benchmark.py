"""Run a benchmark as its own program: ``python -m app.cli.benchmark MODULE OPTION...``.

Prints one line when the peer of a benchmark is not installed; peers come with the extra ``test``.
"""

import runpy
import sys

from app.cli.errors import BAD_INPUT
from app.files.extras import extra_with, install_command, install_hint


def main() -> None:
    """Run the module that the first argument names, with the remaining arguments."""
    module = sys.argv.pop(1)
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except ModuleNotFoundError as error:
        missing = f"this benchmark needs {error.name}, which is not installed"
        if extra_with(error.name or ""):
            remedy = install_hint(error)
        else:
            remedy = f"run `{install_command('test')}`, which installs what benchmarks need"
        print(f"marginguard: error: {missing}: {remedy}", file=sys.stderr)
        sys.exit(BAD_INPUT)


if __name__ == "__main__":
    main()
