"""The address of a page."""

from urllib.parse import parse_qs, urlsplit

import pytest

from app.viewer import Address


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost"])
@pytest.mark.parametrize("token", ["plain", "a&b=c#d e+\N{SNOWMAN}"])
def test_the_address_can_be_read_back(host, token):
    url = urlsplit(Address(host, 0, token).url(8080))
    assert (url.hostname, url.port) == (host, 8080)
    assert parse_qs(url.query) == {"token": [token]}
