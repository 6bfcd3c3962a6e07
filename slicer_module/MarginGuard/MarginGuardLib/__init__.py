"""Logic and widgets of the MarginGuard module."""
