"""Limit on wrong tokens from one network address. The clock is passed in."""

from collections import OrderedDict
from ipaddress import IPv6Address, ip_address

from app.runtime.rate_limit import RateLimit

GUESSES = 10
"""Wrong tokens that an address may send at once."""
_PER_S = GUESSES / 60.0
_MAX_ADDRESSES = 1024
_NETWORK_BITS = 64
"""Bits of an IPv6 address that are not the choice of one machine."""


class GuessLimit:
    """Counts wrong tokens: `GUESSES` at once and as many a minute, for each address."""

    def __init__(self) -> None:
        self._limits: OrderedDict[str, RateLimit] = OrderedDict()

    def wrong(self, address: str | None, now_ns: int) -> bool:
        """Record a wrong token; return False if the address has sent too many."""
        key = _key(address)
        limit = self._limits.pop(key, None) or RateLimit(_PER_S, GUESSES)
        self._limits[key] = limit  # the newest one is last
        while len(self._limits) > _MAX_ADDRESSES:
            self._limits.popitem(last=False)
        return limit.take(now_ns)

    def is_blocked(self, address: str | None, now_ns: int) -> bool:
        """True while the address may not send another token."""
        limit = self._limits.get(_key(address))
        return limit is not None and not limit.has(now_ns)


def _key(address: str | None) -> str:
    """The address, or the network of an IPv6 address."""
    try:
        parsed = ip_address((address or "").partition("%")[0])
    except ValueError:
        return address or ""
    if isinstance(parsed, IPv6Address):
        return str(int(parsed) >> (128 - _NETWORK_BITS))
    return str(parsed)
