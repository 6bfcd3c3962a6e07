"""One module a subcommand: ``SUMMARY``, ``add_arguments`` and ``run``.

They import other packages inside ``run``, so that ``marginguard --help`` loads none of them.
"""
