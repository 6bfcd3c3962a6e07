"""The page's log, and limits on what others log of connections."""

import logging
import sys

from aiohttp.http_exceptions import HttpProcessingError

from app.geometry import NS_PER_S
from app.runtime.requests import RateLimit

log = logging.getLogger("app.viewer")
"""Log of the page: what was refused, and errors of the server and of browsers."""

_LIBRARIES = ("wslink.protocol", "aiohttp.server", "aiohttp.websocket", "asyncio")
_RECORDS_PER_S, _RECORD_BURST = 5.0, 1000.0


class _Limited(logging.Filter):
    """Drops records beyond a rate: a client could fill the disk with them."""

    def __init__(self) -> None:
        super().__init__()
        self._limit = RateLimit(_RECORDS_PER_S, _RECORD_BURST)

    def filter(self, record: logging.LogRecord) -> bool:
        return self._limit.take(round(record.created * NS_PER_S))


def limit_logs() -> None:
    """Limit the records of connections; drop those of closed ones and of malformed requests."""
    for name in (log.name, *_LIBRARIES):
        logger = logging.getLogger(name)
        if not any(isinstance(each, _Limited) for each in logger.filters):
            logger.addFilter(_is_other_record)
            logger.addFilter(_Limited())


def _is_other_record(record: logging.LogRecord) -> bool:
    error = record.exc_info[1] if record.exc_info else sys.exc_info()[1]
    return not isinstance(error, (ConnectionResetError, HttpProcessingError))
