"""Keeps libraries from printing about a file: the error, in one line, is what is printed.

A library that logs a warning prints it when no program has configured logging. A handler that does
nothing prevents this, and a program that configures logging still gets the records.
"""

import logging


def silence(*libraries: str) -> None:
    """Print nothing that ``libraries`` log, unless the program has configured logging."""
    for name in libraries:
        logger = logging.getLogger(name)
        if not logger.handlers:
            logger.addHandler(logging.NullHandler())
