"""The guard of the page as a table of requests, over HTTP and websockets: one wrong part, and nothing is shown."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import Any

import pytest

from gcs.page.page_guard import PageGuard

PORT, TOKEN = 8123, "the-token"
HOST, OTHER = f"127.0.0.1:{PORT}", "127.0.0.1:9999"
SHOWN, ENTRY, REFUSED = "shown", "entry", "refused"
HERE = {"client": ("127.0.0.1", 50000)}
FAR_HOST = f"192.168.1.5:{PORT}"
Headers = list[tuple[bytes, bytes]]


async def _page(scope: Any, receive: Any, send: Any) -> None:
    """The page behind the guard."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
        return
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-type", b"text/plain")]})
    await send({"type": "http.response.body", "body": b"a flight"})


def asked(guard: PageGuard, scope: dict[str, Any]) -> list[dict[str, Any]]:
    """What the guard answers to one request."""
    sent: list[dict[str, Any]] = []

    async def send(message: Any) -> None:
        sent.append(dict(message))

    async def receive() -> Any:
        return {"type": "http.request"}

    asyncio.run(guard(scope, receive, send))
    return sent


def http(headers: Iterable[tuple[str, str]], query: str = "", path: str = "/", method: str = "GET") -> dict[str, Any]:
    raw = [(name.encode(), value.encode()) for name, value in headers]
    return {"type": "http", "method": method, "path": path, "query_string": query.encode(), "headers": raw} | HERE


def socket(headers: Iterable[tuple[str, str]], query: str = "") -> dict[str, Any]:
    return {**http(headers, query, "/_nicegui_ws/socket.io/"), "type": "websocket"}


def verdict(sent: list[dict[str, Any]]) -> str:
    """What came of a request."""
    if sent[0]["type"] == "websocket.accept":
        return SHOWN
    if sent[0]["type"] == "websocket.close":
        return REFUSED
    body = b"".join(one.get("body", b"") for one in sent)
    if b"a flight" in body:
        return SHOWN
    return ENTRY if sent[0]["status"] == 200 else REFUSED


@pytest.fixture
def guard() -> PageGuard:
    return PageGuard(_page, TOKEN, PORT)


@pytest.fixture
def cookie(guard: PageGuard) -> str:
    """The cookie that the token is exchanged for."""
    sent = asked(guard, http([("host", HOST)], f"token={TOKEN}"))
    return dict(sent[0]["headers"])[b"set-cookie"].decode().split(";")[0]


ORIGIN = f"http://{HOST}"
# headers ("COOKIE" is the right one), and what comes of them over HTTP and as a websocket
TABLE = [
    ([("host", HOST), ("cookie", "COOKIE")], SHOWN, REFUSED),  # a websocket names its origin
    ([("host", HOST), ("cookie", "COOKIE"), ("origin", ORIGIN)], SHOWN, SHOWN),
    ([("host", f"localhost:{PORT}"), ("cookie", "COOKIE"), ("origin", f"http://localhost:{PORT}")], SHOWN, SHOWN),
    ([("host", HOST), ("cookie", "a=b; COOKIE; c=d"), ("origin", ORIGIN)], SHOWN, SHOWN),
    ([("host", HOST), ("origin", ORIGIN)], REFUSED, REFUSED),
    ([("host", HOST), ("cookie", "COOKIEx"), ("origin", ORIGIN)], REFUSED, REFUSED),
    ([("host", HOST), ("cookie", f"skein-{PORT}={TOKEN}"), ("origin", ORIGIN)], REFUSED, REFUSED),
    ([("host", HOST), ("cookie", f"skein-{PORT}="), ("origin", ORIGIN)], REFUSED, REFUSED),
    ([("host", HOST), ("cookie", "\x7f=;;=,"), ("origin", ORIGIN)], REFUSED, REFUSED),
    ([("host", HOST), ("cookie", "COOKIE"), ("origin", "http://evil.example")], REFUSED, REFUSED),
    ([("host", HOST), ("cookie", "COOKIE"), ("origin", f"http://{OTHER}")], REFUSED, REFUSED),
    ([("host", HOST), ("cookie", "COOKIE"), ("origin", f"https://{HOST}")], REFUSED, REFUSED),
    ([("host", HOST), ("cookie", "COOKIE"), ("origin", f"http://localhost:{PORT}")], REFUSED, REFUSED),
    ([("host", HOST), ("cookie", "COOKIE"), ("origin", "null")], REFUSED, REFUSED),
    ([("host", HOST), ("cookie", "COOKIE"), ("origin", "")], REFUSED, REFUSED),
    ([("host", HOST), ("cookie", "COOKIE"), ("origin", ORIGIN), ("origin", "http://evil.example")], REFUSED, REFUSED),
    ([("host", OTHER), ("cookie", "COOKIE"), ("origin", f"http://{OTHER}")], REFUSED, REFUSED),
    ([("host", "evil.example"), ("cookie", "COOKIE"), ("origin", "http://evil.example")], REFUSED, REFUSED),
    ([("host", f"evil.example:{PORT}"), ("cookie", "COOKIE")], REFUSED, REFUSED),  # a name that points to this machine
    ([("host", "127.0.0.1"), ("cookie", "COOKIE")], REFUSED, REFUSED),
    ([("host", HOST), ("host", "evil.example"), ("cookie", "COOKIE")], REFUSED, REFUSED),
    ([("cookie", "COOKIE"), ("origin", ORIGIN)], REFUSED, REFUSED),
]


@pytest.mark.parametrize("row", range(len(TABLE)))
@pytest.mark.parametrize("query", ["", f"token={TOKEN}x", "token="])
def test_a_request_is_answered_if_every_part_of_it_is_right(
    guard: PageGuard, cookie: str, row: int, query: str
) -> None:
    headers, over_http, as_socket = TABLE[row]
    filled = [(name, value.replace("COOKIE", cookie)) for name, value in headers]
    assert verdict(asked(guard, http(filled, query))) == over_http
    assert verdict(asked(guard, socket(filled, query))) == as_socket


@pytest.mark.parametrize(
    ("headers", "query", "path", "method", "expected"),
    [
        ([("host", HOST)], f"token={TOKEN}", "/", "GET", ENTRY),
        ([("host", HOST), ("cookie", "skein-8123=old")], f"token={TOKEN}", "/", "GET", ENTRY),
        ([("host", HOST)], f"token={TOKEN}", "/scene", "GET", REFUSED),
        ([("host", HOST)], f"token={TOKEN}", "/", "POST", REFUSED),
        ([("host", HOST), ("origin", ORIGIN)], f"token={TOKEN}", "/", "POST", REFUSED),
        ([("host", HOST)], f"token={TOKEN}&token={TOKEN}", "/", "GET", REFUSED),
        ([("host", HOST)], f"token={TOKEN.upper()}", "/", "GET", REFUSED),
        ([("host", HOST)], f"Token={TOKEN}", "/", "GET", REFUSED),
        ([("host", HOST)], "token=%ff", "/", "GET", REFUSED),
        ([("host", OTHER)], f"token={TOKEN}", "/", "GET", REFUSED),
        ([("host", HOST), ("origin", "http://evil.example")], f"token={TOKEN}", "/", "GET", REFUSED),
    ],
)
def test_the_token_opens_the_page_at_its_own_address_only(
    guard: PageGuard, headers: list[tuple[str, str]], query: str, path: str, method: str, expected: str
) -> None:
    sent = asked(guard, http(headers, query, path, method))
    assert verdict(sent) == expected
    assert (b"set-cookie" in dict(sent[0]["headers"])) == (expected == ENTRY)
    assert verdict(asked(guard, socket(headers, query))) == REFUSED, "a websocket has the cookie, never the token"


def test_the_cookie_is_for_the_page_alone_and_not_the_token(guard: PageGuard) -> None:
    sent = asked(guard, http([("host", HOST)], f"token={TOKEN}"))
    given = dict(sent[0]["headers"])[b"set-cookie"].decode()
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= set(given.split("; ")) and TOKEN not in given
    assert dict(sent[0]["headers"])[b"cache-control"] == b"no-store"


def test_a_request_with_the_cookie_that_changes_something_comes_from_the_page(guard: PageGuard, cookie: str) -> None:
    alone = [("host", HOST), ("cookie", cookie)]
    assert verdict(asked(guard, http(alone, path="/orders", method="POST"))) == REFUSED
    assert verdict(asked(guard, http([*alone, ("origin", ORIGIN)], path="/orders", method="POST"))) == SHOWN


def test_the_browser_is_told_to_ask_nobody_else(guard: PageGuard, cookie: str) -> None:
    sent = asked(guard, http([("host", HOST), ("cookie", cookie)]))
    policy = dict(sent[0]["headers"])[b"content-security-policy"].decode()
    assert "default-src 'self'" in policy and f"connect-src 'self' ws://{HOST};" in policy
    assert "frame-ancestors 'none'" in policy and "http:" not in policy


def test_the_life_of_the_application_passes() -> None:
    seen = []

    async def inner(scope: Any, receive: Any, send: Any) -> None:
        seen.append(scope["type"])

    asked(PageGuard(inner, TOKEN, PORT), {"type": "lifespan"})
    assert seen == ["lifespan"]


@pytest.mark.parametrize(
    ("client", "is_here"),
    [
        (("127.0.0.1", 5), True),
        (("127.8.9.1", 5), True),
        (("::1", 5), True),
        (("192.168.1.7", 5), False),
        (("192.168.1.5", 5), False),
        (("8.8.8.8", 5), False),
        (("testclient", 5), False),
        (None, False),
    ],
)
@pytest.mark.parametrize("control", [False, True])
@pytest.mark.parametrize("host", [HOST, FAR_HOST])
def test_from_another_machine_the_page_is_read_only_unless_orders_are_allowed(
    client: tuple[str, int] | None, is_here: bool, control: bool, host: str
) -> None:
    guard = PageGuard(_page, TOKEN, PORT, "192.168.1.5", orders_from_afar=control)
    entry = asked(guard, http([("host", host)], f"token={TOKEN}") | {"client": client})
    own = dict(entry[0]["headers"])[b"set-cookie"].decode().split(";")[0]
    headers = [("host", host), ("cookie", own), ("origin", f"http://{host}")]
    at = {"client": client}
    assert verdict(asked(guard, http(headers) | at)) == verdict(asked(guard, socket(headers) | at)) == SHOWN
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        sent = asked(guard, http(headers, path="/orders", method=method) | at)
        assert verdict(sent) == (SHOWN if is_here or control else REFUSED)
        forged = [*headers, ("x-forwarded-for", "127.0.0.1"), ("forwarded", "for=127.0.0.1")]
        assert verdict(asked(guard, http(forged, path="/orders", method=method) | at)) == verdict(sent)


def test_without_an_address_for_other_machines_none_is_served(guard: PageGuard, cookie: str) -> None:
    headers = [("host", FAR_HOST), ("cookie", cookie), ("origin", f"http://{FAR_HOST}")]
    assert verdict(asked(guard, http(headers))) == verdict(asked(guard, socket(headers))) == REFUSED


def test_the_browser_may_fetch_pictures_from_the_server_of_a_map_alone_and_only_where_there_is_one(
    guard: PageGuard, cookie: str
) -> None:
    def allowed(which: PageGuard) -> dict[str, list[str]]:
        entry = asked(which, http([("host", HOST)], f"token={TOKEN}"))
        own = dict(entry[0]["headers"])[b"set-cookie"].decode().split(";")[0]
        sent = asked(which, http([("host", HOST), ("cookie", own)]))
        policy = dict(sent[0]["headers"])[b"content-security-policy"].decode()
        return {rule.split()[0]: rule.split()[1:] for rule in policy.split(";")}

    without, beside = allowed(guard), allowed(PageGuard(_page, TOKEN, PORT, tiles="https://tile.example.org"))
    assert without["img-src"] == ["'self'", "data:", "blob:"]
    assert beside == {**without, "img-src": [*without["img-src"], "https://tile.example.org"]}
