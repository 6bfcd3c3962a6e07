"""Log filter for closed connections: three libraries log them as errors."""

import logging
import sys

_LOGGERS = ("wslink.protocol", "aiohttp.server", "asyncio")


def ignore_closed_connections() -> None:
    """Drop log records of connections that a browser closed; keep all others."""
    for name in _LOGGERS:
        logging.getLogger(name).addFilter(_is_other_record)


def _is_other_record(record: logging.LogRecord) -> bool:
    error = record.exc_info[1] if record.exc_info else sys.exc_info()[1]
    return not isinstance(error, ConnectionResetError)
