"""Logic of the MarginGuard module, without Qt: one concept in each file."""
