"""Hosts and ports as text and as the operating system has them."""

from __future__ import annotations

import socket

import pytest

from gcs.errors import LinkError
from gcs.link.endpoints.addresses import (
    caller_host,
    host_port,
    lacks_brackets,
    plain_address,
    resolve_udp,
    socket_address,
    split_host_port,
)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("127.0.0.1:14550", ("127.0.0.1", "14550")),
        ("[::1]:14550", ("::1", "14550")),
        ("[fe80::1%eth0]:9", ("fe80::1%eth0", "9")),
        ("::1:14550", None),
        ("[127.0.0.1]:9", None),
        ("[::1]", None),
        ("host", None),
        ("tcp:h:1", None),
    ],
)
def test_a_host_and_a_port_in_one_text(text: str, found: tuple[str, str] | None) -> None:
    assert split_host_port(text) == found
    if found is not None:
        assert host_port(*found) == text


def test_an_address_without_brackets_is_seen() -> None:
    assert [lacks_brackets(t) for t in ("::1:14550", "fe80::1:2", "[::1]:14550", "h:1", "/dev/a:b:c")] == [
        *(True, True, False, False, False)
    ]


def test_addresses_of_the_operating_system() -> None:
    assert plain_address(("10.0.0.1", 5)) == ("10.0.0.1", 5)
    assert plain_address(("::1", 5, 0, 0)) == ("::1", 5)
    assert plain_address(("fe80::1", 5, 0, 3)) == ("fe80::1%3", 5)
    assert socket_address("::1", 5) == ("::1", 5)
    assert socket_address("fe80::1%3", 5) == ("fe80::1", 5, 0, 3)
    with pytest.raises(OSError, match="no interface"):
        socket_address("fe80::1%nothing", 5)


def test_a_literal_decides_the_family_and_loopback_stays_here() -> None:
    assert resolve_udp("127.0.0.1", 9) == (socket.AF_INET, ("127.0.0.1", 9))
    assert resolve_udp("::1", 9) == (socket.AF_INET6, ("::1", 9))
    assert resolve_udp("localhost", 9)[0] == socket.AF_INET
    assert caller_host(socket.AF_INET6, "::1") == "::1"
    assert caller_host(socket.AF_INET6, "2001:db8::1") == "::"
    assert caller_host(socket.AF_INET, "127.0.0.9") == "127.0.0.1"
    assert caller_host(socket.AF_INET, "10.0.0.9") == "0.0.0.0"


def test_a_name_too_long_for_any_host_is_no_host() -> None:
    with pytest.raises(LinkError, match="no host is named"):
        resolve_udp("a" * 64, 14550)
