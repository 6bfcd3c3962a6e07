"""The pieces of the MarginGuard module: one concept a file, none of them knows Qt."""
