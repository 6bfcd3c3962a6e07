"""A page that is closed while it is being answered is no error, though three libraries log it."""

import logging
import sys

_LOGGERS = ("wslink.protocol", "aiohttp.server", "asyncio")


def expect_pages_to_go() -> None:
    """Keep what is said of lost connections out of the log; everything else stays in it."""
    for name in _LOGGERS:
        logging.getLogger(name).addFilter(_is_news)


def _is_news(record: logging.LogRecord) -> bool:
    error = record.exc_info[1] if record.exc_info else sys.exc_info()[1]
    return not isinstance(error, ConnectionResetError)
