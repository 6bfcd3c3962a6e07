"""The calibration methods: each module in this package defines one as ``METHOD``.

A new module is found by `app.cli.calibration.registry` without further changes. Keep heavy
imports inside functions: every ``marginguard --help`` loads these modules.
"""
