"""Who may see the page: requests to this machine by name, from the page itself, with the token or its cookie.

From other machines it is read-only, unless orders from there were allowed.

NiceGUI accepts a websocket from any origin. Without this guard every web site that is open in the same browser could
read a flight, and any user of the machine.
"""

import secrets
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from ipaddress import ip_address
from typing import Any
from urllib.parse import parse_qs

Message = MutableMapping[str, Any]
Scope = Message  # of ASGI too
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]
Headers = list[tuple[bytes, bytes]]

_REFUSED = "Open the whole address that gcs printed, with its token.\n"
_READ_ONLY = "from another machine the page is read-only; gcs fly --page-control lets it order\n"
# SameSite=strict keeps the cookie from a redirect that another site began: the page is entered by one of its own.
_ENTRY = '<!doctype html><meta http-equiv="refresh" content="0; url=/"><a href="/">Open the page</a>\n'


class PageGuard:
    """Stands before an ASGI application, and passes what it allows."""

    def __init__(
        self,
        inner: Application,
        token: str,
        port: int,
        address: str = "",
        *,
        orders_from_afar: bool = False,
        tiles: str = "",
    ) -> None:
        """`address`: where other machines reach the page, if they do. `tiles`: scheme and host of a map, if any."""
        self._inner = inner
        self._token = token
        self._hosts = tuple(f"{name}:{port}" for name in ("127.0.0.1", "localhost", address) if name)
        self._orders_from_afar = orders_from_afar
        self._tiles = tiles
        self._cookie = f"skein-{port}"  # browsers share cookies between ports
        self._session = secrets.token_urlsafe(32)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request, one websocket, or the life of the application."""
        if scope["type"] == "lifespan":
            await self._inner(scope, receive, send)
            return
        host = self._host(scope)
        if host is not None and self._has_cookie(scope["headers"]):
            if self._may_change(scope):
                await self._inner(scope, receive, _restricting(send, host, self._tiles))
            else:
                await _answer(_restricting(send, host), 403, _READ_ONLY, [])
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        elif host is not None and self._has_token(scope):
            cookie = f"{self._cookie}={self._session}; Path=/; HttpOnly; SameSite=Strict"
            await _answer(_restricting(send, host), 200, _ENTRY, [(b"set-cookie", cookie.encode())])
        else:
            await _answer(send, 403, _REFUSED, [])

    def _host(self, scope: Scope) -> str | None:
        """The host that is asked for, if it is this one and the request comes from the page or from no page at all."""
        hosts, origins = (_all(scope["headers"], name) for name in (b"host", b"origin"))
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return None
        from_the_page = origins == [f"http://{hosts[0]}"]
        needs_none = scope["type"] == "http" and scope["method"] in ("GET", "HEAD") and not origins
        return hosts[0] if from_the_page or needs_none else None

    def _may_change(self, scope: Scope) -> bool:
        """Whether a request reads only, or comes from this machine, or from where orders are allowed."""
        reads = scope["type"] == "websocket" or scope["method"] in ("GET", "HEAD")
        return reads or self._orders_from_afar or _is_here(scope.get("client"))

    def _has_cookie(self, headers: Headers) -> bool:
        try:
            given = [SimpleCookie(text).get(self._cookie) for text in _all(headers, b"cookie")]
        except CookieError:
            return False
        return any(one is not None and _is_same(one.value, self._session) for one in given)

    def _has_token(self, scope: Scope) -> bool:
        if scope["method"] != "GET" or scope["path"] != "/":
            return False
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [])
        return len(given) == 1 and _is_same(given[0], self._token)


def _is_here(client: tuple[str, int] | None) -> bool:
    """Whether a request comes from this machine; not, if it does not say from where."""
    if client is None:
        return False
    try:
        return ip_address(client[0]).is_loopback
    except ValueError:
        return False


def _all(headers: Iterable[tuple[bytes, bytes]], wanted: bytes) -> list[str]:
    return [value.decode("latin-1") for name, value in headers if name.lower() == wanted]


def _is_same(given: str, secret: str) -> bool:
    return secrets.compare_digest(given.encode(), secret.encode())


def _restricting(send: Send, host: str, tiles: str = "") -> Send:
    """Have the browser ask nobody but this host, and the one of a map for pictures; show the page in no other."""
    pictures = " ".join(["'self' data: blob:", *([tiles] if tiles else [])])
    policy = (
        "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
        f"img-src {pictures}; font-src 'self' data:; connect-src 'self' ws://{host}; "
        "frame-ancestors 'none'; form-action 'none'; base-uri 'self'"
    )
    extra = [(b"content-security-policy", policy.encode()), (b"referrer-policy", b"no-referrer")]

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ()), *extra]}
        await send(message)

    return sending


async def _answer(send: Send, status: int, text: str, headers: Headers) -> None:
    kind = b"text/html; charset=utf-8" if text.startswith("<") else b"text/plain; charset=utf-8"
    all_headers = [(b"content-type", kind), (b"cache-control", b"no-store"), *headers]
    await send({"type": "http.response.start", "status": status, "headers": all_headers})
    await send({"type": "http.response.body", "body": text.encode()})
