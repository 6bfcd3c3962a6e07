"""The command ``marginguard``: the only place that wires the rooms together."""
