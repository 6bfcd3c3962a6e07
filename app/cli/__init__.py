"""The command ``marginguard``: parses arguments and connects the packages."""
