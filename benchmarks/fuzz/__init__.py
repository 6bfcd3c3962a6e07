"""Structure-aware fuzzing of every parser: ``marginguard bench fuzz --minutes N``.

An input is a seed document with a few mutations of its structure: a number, an attribute, a field
of a binary header, a subtree. It must give a value or a `MarginGuardError` of one line, within 2 s
and 1 GB, and nothing on the standard streams. Inputs run in a worker process that is restarted.

Input ``n`` of a parser depends on the seed, the parser's name and ``n`` only, so it can be made
again. There is no coverage feedback. This is why the mutators are written here: ``atheris`` gives
feedback, but ends its process at the first slow or large input, has no wheels for all platforms
of this project, and its mutators know bytes only; ``hypothesis`` does not watch time and memory
from outside either, and its strategies generate documents from nothing, where most of these
formats need a valid document to start from.

To add a parser: a `FuzzedParser` in the ``PARSERS`` of a module that `registry.MODULES` lists.
"""
