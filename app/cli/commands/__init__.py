"""One module a subcommand: ``SUMMARY``, ``add_arguments`` and ``run``.

They import the rooms inside ``run``, so that ``marginguard --help`` loads none of them.
"""
