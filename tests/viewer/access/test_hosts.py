"""Host and Origin headers."""

import pytest

from app.viewer.access.hosts import AllowedHosts, is_same_origin


@pytest.mark.parametrize(
    "host",
    [
        *("127.0.0.1", "127.0.0.1:8080", "10.1.2.3:1", "[::1]:8080", "[2001:db8::1]"),
        *("localhost", "LocalHost:80", "or-3.example", "OR-3.example.:443"),
    ],
)
def test_addresses_localhost_and_given_names_are_allowed(host):
    assert AllowedHosts(["or-3.Example"]).allows(host)


@pytest.mark.parametrize(
    "host",
    [
        *(None, "", ":80", "evil.example", "localhost.evil.example", "or-3.example.evil.example"),
        *("127.0.0.1.evil.example", "a@127.0.0.1", "127.0.0.1:80:80", "127.0.0.1:x", "127.0.0.1/"),
        *("127.0.0.1?a", "127.0.0.1#a", "[::1", "::1]", "2130706433", "0x7f.0.0.1", " 127.0.0.1"),
    ],
)
def test_other_names_are_refused(host):
    assert not AllowedHosts(["or-3.example"]).allows(host)


@pytest.mark.parametrize(
    ("origin", "host", "same"),
    [
        ("http://127.0.0.1:80", "127.0.0.1:80", True),
        ("https://or-3.example", "or-3.example", True),
        ("http://127.0.0.1:81", "127.0.0.1:80", False),
        ("http://evil.example", "127.0.0.1:80", False),
        ("http://127.0.0.1:80.evil.example", "127.0.0.1:80", False),
        ("http://evil.example/127.0.0.1:80", "127.0.0.1:80", False),
        ("file://127.0.0.1:80", "127.0.0.1:80", False),
        ("null", "null", False),
        ("", "", False),
        (None, "127.0.0.1:80", False),
    ],
)
def test_origin_is_compared_with_host_and_port(origin, host, same):
    assert is_same_origin(origin, host) is same
