"""This is where it is decided whose requests reach the dashboard: hosts, origins, the token and its sessions.

Browsers send cookies to every port of a host, and any page may send them requests. So three things are asked. The Host
header must be a name that we serve: a name that was rebound to our address is none. The Origin of whatever may change
something must be our own page. And who steers shows a cookie that only the token can have made, or the token itself.
The page server and the steering port know the same token, so a session of one is a session of the other.
"""

import asyncio
import hashlib
import hmac
import ipaddress
import secrets
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import urlsplit

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import HTMLResponse, JSONResponse, Response

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["COOKIE", "Access", "Gate", "new_token"]

COOKIE = "sinew_session"
"""Name of the cookie that holds a session."""

_BODY_S = 10.0
_GUARDS = {"X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "X-Frame-Options": "DENY"}
_LOCAL_NAMES = frozenset({"127.0.0.1", "localhost", "[::1]"})


@dataclass(frozen=True)
class Access:
    """Who may come in.

    token: the secret that a viewer types or follows a link with.
    host, port: the address of the page, as it is bound; an IPv6 address without brackets.
    hosts: further names under which browsers reach it, without a port.
    is_proxied: whether a proxy is to be expected before it, so that an address says nothing of who asks.
    """

    token: str = field(repr=False)
    host: str
    port: int
    hosts: tuple[str, ...] = ()
    is_proxied: bool = False

    @property
    def is_loopback(self) -> bool:
        """Whether only this computer reaches the page."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host.lower() == "localhost"

    @property
    def must_sign_in(self) -> bool:
        """Whether even looking takes a session or the token: others than this computer's users may reach the page.

        Further names are those of a proxy, which brings strangers to an address that only this computer has.
        """
        return not self.is_loopback or bool(self.hosts)

    @property
    def near(self) -> str:
        """The address under which this computer reaches us; one of IPv6 without brackets."""
        return {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(self.host, self.host)

    def names(self) -> frozenset[str]:
        """Return the host names that we serve, in lower case, IPv6 addresses in brackets."""
        own = {_bracketed(name.lower()) for name in (self.host, *self.hosts)}
        return frozenset(own | _LOCAL_NAMES)

    def origins(self) -> list[str]:
        """Return the origins of our own page; https is that of a proxy, on the same port or, under its name, on 443.

        Browsers leave a port out that is the usual one of the scheme.
        """
        names = self.names()
        found = {f"{scheme}://{name}:{self.port}" for name in names for scheme in ("http", "https")}
        if self.port == 80:
            found |= {f"http://{name}" for name in names}
        if self.port == 443:
            found |= {f"https://{name}" for name in names}
        return sorted(found | {f"https://{_bracketed(name.lower())}" for name in self.hosts})

    def host_is_ours(self, host: str | None) -> bool:
        """Return whether a Host header names us, whatever the port: two of them are served, and tunnels have more."""
        if not host or any(character in host for character in "/@?#\\ "):
            return False
        try:
            parts = urlsplit(f"//{host}")
            _ = parts.port
        except ValueError:
            return False
        return _bracketed(parts.hostname or "") in self.names()

    def origin_is_ours(self, origin: str | None) -> bool:
        """Return whether an Origin header is that of our own page; `null` and none at all are not."""
        return origin is not None and origin.lower() in self.origins()

    def token_is_right(self, given: str) -> bool:
        """Return whether this is the token; takes as long for a wrong one."""
        return _same(self.token, given)

    def session_cookie(self) -> str:
        """Return the value of a new session's cookie, `<nonce>.<hex HMAC-SHA256 of the nonce under the token>`."""
        nonce = secrets.token_urlsafe(12)
        return f"{nonce}.{self._mark(nonce)}"

    def is_session(self, cookie: str) -> bool:
        """Return whether a cookie's value was made with our token."""
        nonce, dot, mark = cookie.partition(".")
        return bool(nonce and dot) and _same(self._mark(nonce), mark)

    def bearer_is_right(self, connection: HTTPConnection) -> bool:
        """Return whether a request carries the token itself in its Authorization header; no browser does so unasked."""
        scheme, _, given = connection.headers.get("authorization", "").partition(" ")
        return scheme.lower() == "bearer" and self.token_is_right(given.strip())

    def is_signed_in(self, connection: HTTPConnection) -> bool:
        """Return whether a request shows a session or the token."""
        cookie = connection.cookies.get(COOKIE)
        return (cookie is not None and self.is_session(cookie)) or self.bearer_is_right(connection)

    def _mark(self, nonce: str) -> str:
        return hmac.new(_octets(self.token), _octets(nonce), hashlib.sha256).hexdigest()


class Gate:
    """An ASGI application before another one, which only requests get to that may.

    must_sign_in: whether even looking takes a session or the token. free: paths that never do; one that ends in a slash
    stands for all below it. sign_in_page: HTML for a browser that has to sign in; programs get JSON.
    most_body: of a request [bytes]. most_sockets: open web sockets. most_connections: requests under way of those who
    are not signed in, so that no crowd keeps an operator out.

    Refused are, before the application hears of it: 421 another Host; 403 a foreign Origin, or none without the token,
    where something may change (a web socket is closed with 1008 before it is accepted); 401 nobody signed in; 413 a
    body that is too large, however it is sent; 408 one that does not come; 503 too many at once.
    """

    def __init__(
        self,
        app: "ASGIApp",
        access: Access,
        *,
        must_sign_in: bool,
        free: Collection[str] = ("/login",),
        sign_in_page: str = "",
        most_body: int = 256 * 1024,
        most_sockets: int = 64,
        most_connections: int = 200,
    ) -> None:
        self.app, self.access, self.must_sign_in = app, access, must_sign_in
        self.free, self.sign_in_page = tuple(free), sign_in_page
        self.most_body, self.most_sockets, self.most_connections = most_body, most_sockets, most_connections
        self.under_way = {"http": 0, "websocket": 0}

    async def __call__(self, scope: "Scope", receive: "Receive", send: "Send") -> None:
        """Let a request through, or refuse it."""
        if scope["type"] not in self.under_way:
            await self.app(scope, receive, send)
            return
        self.under_way[scope["type"]] += 1
        try:
            if scope["type"] == "http":
                await self._http(scope, receive, _guarding(send))
            else:
                await self._socket(scope, receive, send)
        finally:
            self.under_way[scope["type"]] -= 1

    async def _http(self, scope: "Scope", receive: "Receive", send: "Send") -> None:
        connection = HTTPConnection(scope)
        refusal = self._refusal(connection)
        if refusal is None and _may_change(scope):
            body = await _whole_body(receive, self.most_body)
            if isinstance(body, bytes):
                receive = _again(body, receive)
            else:
                refusal = body
        if refusal is None:
            await self.app(scope, receive, send)
        else:
            await self._answer(refusal, connection)(scope, receive, send)

    async def _socket(self, scope: "Scope", receive: "Receive", send: "Send") -> None:
        refusal = self._refusal(HTTPConnection(scope))
        if refusal is None:
            await self.app(scope, receive, send)
        else:
            await receive()
            await send({"type": "websocket.close", "code": 1008, "reason": refusal.sentence})

    def _refusal(self, connection: HTTPConnection) -> "_Refusal | None":
        access, headers = self.access, connection.headers
        if not access.host_is_ours(headers.get("host")):
            return _Refusal(
                421, "found another Host than the dashboard's, expected the name that `sinew serve` printed"
            )
        origins = headers.getlist("origin")
        if _may_change(connection.scope) and not (
            all(map(access.origin_is_ours, origins)) and (origins or access.bearer_is_right(connection))
        ):
            return _Refusal(403, "found a request from elsewhere, expected one of the dashboard's own page")
        length = headers.get("content-length", "0")
        if not length.isdecimal() or len(length) > 12 or int(length) > self.most_body:
            return _too_large(self.most_body)
        is_signed_in = access.is_signed_in(connection)
        if self.must_sign_in and not is_signed_in and not self._is_free(connection.scope["path"]):
            return _Refusal(401, "nobody is signed in; sign in with the token that `sinew serve` printed")
        kind = connection.scope["type"]
        is_crowded = self.under_way[kind] > (self.most_sockets if kind == "websocket" else self.most_connections)
        if is_crowded and (kind == "websocket" or not is_signed_in):
            return _Refusal(503, "found too many connections at once; close other pages and try again")
        return None

    def _is_free(self, path: str) -> bool:
        return ".." not in path and any(
            path.startswith(free) if free.endswith("/") else path == free for free in self.free
        )

    def _answer(self, refusal: "_Refusal", connection: HTTPConnection) -> Response:
        wants_page = connection.scope["method"] == "GET" and "text/html" in connection.headers.get("accept", "")
        if refusal.status == 401 and wants_page and self.sign_in_page:
            return HTMLResponse(self.sign_in_page, 401)
        return JSONResponse({"ok": False, "sentence": refusal.sentence}, refusal.status)


def new_token() -> str:
    """Return a token that nobody guesses: 192 bits as text."""
    return secrets.token_urlsafe(24)


def _bracketed(name: str) -> str:
    return f"[{name}]" if ":" in name and not name.startswith("[") else name


def _octets(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass")  # JSON can hold half a surrogate pair


def _same(ours: str, given: str) -> bool:
    return hmac.compare_digest(_octets(ours), _octets(given))


class _Refusal(NamedTuple):
    status: int
    sentence: str


def _too_large(most: int) -> _Refusal:
    return _Refusal(413, f"found a request that is too large, expected at most {most} bytes")


def _may_change(scope: "Scope") -> bool:
    return scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")


async def _whole_body(receive: "Receive", most: int) -> "bytes | _Refusal":
    """Return a request's body, or why it is refused: a sender that drips or leaves would keep the application busy."""
    body = bytearray()
    try:
        async with asyncio.timeout(_BODY_S):
            while True:
                message = await receive()
                body += message.get("body", b"")
                if len(body) > most:
                    return _too_large(most)
                if message["type"] == "http.disconnect":
                    return _Refusal(400, "the request broke off; send it again")
                if not message.get("more_body", False):
                    return bytes(body)
    except TimeoutError:
        return _Refusal(408, f"found no whole request within {_BODY_S:g} s; send it again")


def _again(body: bytes, receive: "Receive") -> "Receive":
    """Return a source of messages that gives a body that was read, and then what else comes."""
    whole: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def next_message() -> "Message":
        return whole.pop() if whole else await receive()

    return next_message


def _guarding(send: "Send") -> "Send":
    """Return a way to send that says what browsers shall not do with an answer."""

    async def send_guarded(message: "Message") -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers.update(_GUARDS)
            headers.setdefault("Cache-Control", "no-store")
        await send(message)

    return send_guarded
