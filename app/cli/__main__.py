"""``python -m app.cli``: the command ``marginguard`` without its script."""

from app.cli.main import main
from app.cli.process import leave

leave(main())
