"""``python -m app.cli``: the command ``marginguard`` without its script."""

import sys

from app.cli.main import main

sys.exit(main())
