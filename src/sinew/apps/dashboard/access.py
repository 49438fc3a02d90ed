"""Whose requests reach the dashboard: hosts, origins, the token and its sessions, and the size of a request.

Browsers send cookies to every port of a host, and any page may send them requests. So three things are checked. The
Host header must be a name that we serve: a name that was rebound to our address is none. The Origin of whatever may
change something must be our own page. And who steers shows a cookie that only this start of the server can have signed,
or the token itself. Another dashboard on the same host has another port, and so cookies and sessions of its own.
"""

import asyncio
import hashlib
import hmac
import ipaddress
import json
import logging
import re
import secrets
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import uvicorn
from itsdangerous import BadData, TimestampSigner
from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection, Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route
from starlette.websockets import WebSocketClose

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send


SESSION_S = 7 * 24 * 3600
"""A session is over so long after the token was shown [s]."""

WRONG_S = 1.0
"""An answer to a wrong token takes so long, which slows guessing [s]."""

_GUARDS = {"X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "X-Frame-Options": "DENY"}
_LOCAL_NAMES = frozenset({"127.0.0.1", "localhost", "[::1]"})
_FORWARDED = ("forwarded", "via", "x-forwarded-for", "x-forwarded-host", "x-forwarded-proto", "x-real-ip")
_SCRIPT = re.compile(rb"<script(?=[\s>])", re.IGNORECASE)


class _Signer(TimestampSigner):
    """A signer whose clock nobody sets [s]: a clock that jumps ends no session."""

    clock: Callable[[], float] = time.monotonic

    def get_timestamp(self) -> int:
        return int(self.clock())


@dataclass(frozen=True)
class Access:
    """Who may come in.

    token: the secret that a viewer types or follows a link with.
    host, port: the address of the page, as it is bound; an IPv6 address without brackets.
    own_names: further names of this computer, without a port.
    key: signs the sessions; it is new at every start, so that a restart ends all of them.
    signed_out: sessions that were ended, as far as this process has heard. clock: monotonic [s].
    """

    token: str = field(repr=False)
    host: str
    port: int
    own_names: tuple[str, ...] = ()
    key: str = field(default_factory=lambda: secrets.token_urlsafe(32), repr=False, compare=False)
    signed_out: set[str] = field(default_factory=set, repr=False, compare=False)
    clock: Callable[[], float] = field(default=time.monotonic, repr=False, compare=False)

    @property
    def cookie_name(self) -> str:
        """The name of the cookie that holds a session: with our port, for browsers tell no ports of a host apart."""
        return f"sinew_session_{self.port}"

    @property
    def is_loopback(self) -> bool:
        """Whether only this computer reaches the page; else even looking takes a session or the token."""
        return self.host.lower() == "localhost" or _is_local(self.host)

    @property
    def steering_port(self) -> int:
        """The port of the commands: the one after that of the page."""
        return self.port + 1

    @property
    def near(self) -> str:
        """The address under which this computer reaches us; one of IPv6 without brackets."""
        return {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(self.host, self.host)

    def names(self) -> frozenset[str]:
        """Return the host names that we serve, in lower case, IPv6 addresses in brackets."""
        own = {_bracketed(name.lower()) for name in (self.host, *self.own_names)}
        return frozenset(own | _LOCAL_NAMES)

    def origins(self) -> list[str]:
        """Return the origins of our own page; browsers leave the usual port out."""
        port = "" if self.port == 80 else f":{self.port}"
        return sorted(f"http://{name}{port}" for name in self.names())

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
        return hmac.compare_digest(_octets(self.token), _octets(given))

    def new_session(self) -> str:
        """Return the value of a new session's cookie: `<id>.<now>.<signature>`."""
        return self._signer().sign(secrets.token_urlsafe(12)).decode("ascii")

    def session_in(self, cookie: str | None) -> str | None:
        """Return the id of the session that a cookie's value shows; None where we did not make it, or it is over."""
        try:
            name = self._signer().unsign(cookie or "", max_age=SESSION_S).decode("ascii")
        except (BadData, ValueError):  # a text that holds no ASCII is a ValueError, too
            return None
        return None if name in self.signed_out else name

    def session(self, connection: HTTPConnection) -> str | None:
        """Return the id of the session that a request shows, if any."""
        return self.session_in(connection.cookies.get(self.cookie_name))

    def set_cookie(self, response: Response, value: str) -> None:
        """Hand a session to the browser; an empty value takes it away."""
        age = SESSION_S if value else 0
        response.set_cookie(self.cookie_name, value, max_age=age, path="/", httponly=True, samesite="strict")

    def bearer_is_right(self, connection: HTTPConnection) -> bool:
        """Return whether a request carries the token itself in its Authorization header; no browser does so unasked."""
        scheme, _, given = connection.headers.get("authorization", "").partition(" ")
        return scheme.lower() == "bearer" and self.token_is_right(given.strip())

    def is_signed_in(self, connection: HTTPConnection) -> bool:
        """Return whether a request shows a session or the token."""
        return self.session(connection) is not None or self.bearer_is_right(connection)

    def is_at_machine(self, connection: HTTPConnection) -> bool:
        """Return whether a request comes from the computer that serves, and none that a proxy passed on to it."""
        if connection.client is None or any(name in connection.headers for name in _FORWARDED):
            return False
        server = connection.scope.get("server") or ("", None)
        return _is_local(connection.client.host) or connection.client.host == server[0]

    def may_stop(self, connection: HTTPConnection) -> bool:
        """Return whether a request may stop the bench at once: of who is signed in, or sits at this computer."""
        return self.is_signed_in(connection) or self.is_at_machine(connection)

    def security_policy(self, connection: HTTPConnection, nonce: str) -> str:
        """Return the Content-Security-Policy of a page: nothing of another host, no script that we did not write.

        nonce: of the scripts in the page. NiceGUI evaluates what its server sends and styles elements one by one, so
        `unsafe-eval` and inline styles stay.
        """
        host = connection.headers.get("host", "")
        name = _bracketed(urlsplit(f"//{host}").hostname or "") if self.host_is_ours(host) else ""
        reached = ["'self'", *([f"ws://{host}", f"http://{name}:{self.steering_port}"] if name else [])]
        return "; ".join(
            (
                "default-src 'self'",
                f"script-src 'self' 'nonce-{nonce}' 'unsafe-eval'",
                "style-src 'self' 'unsafe-inline'",
                "img-src 'self' data: blob:",
                "font-src 'self' data:",
                f"connect-src {' '.join(reached)}",
                "object-src 'none'",
                "base-uri 'none'",
                "form-action 'self'",
                "frame-ancestors 'none'",
            )
        )

    def _signer(self) -> _Signer:
        signer = _Signer(_octets(self.key), salt=self.cookie_name, digest_method=hashlib.sha256)
        signer.clock = self.clock
        return signer


class Gate:
    """An ASGI application before another one, which only requests get to that may.

    free: paths that never take a session or the token; one that ends in a slash stands for all below it. sign_in_page:
    HTML for a browser that has to sign in; programs get JSON. most_body: of a request [bytes].

    Refused are, before the application hears of it: 421 another Host; 403 a foreign Origin, or none without the token,
    where something may change (a web socket is closed with 1008 before it is accepted); 401 nobody signed in; 413 a
    body that says to be too large. One that turns out to be is HTTPException 413 to whoever reads it.
    """

    def __init__(
        self,
        app: "ASGIApp",
        access: Access,
        *,
        free: Collection[str] = ("/login",),
        sign_in_page: str = "",
        most_body: int = 256 * 1024,
    ) -> None:
        self.app, self.access = app, access
        self.free, self.sign_in_page, self.most_body = tuple(free), sign_in_page, most_body

    async def __call__(self, scope: "Scope", receive: "Receive", send: "Send") -> None:
        """Let a request through, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        refusal = self._refusal(connection)
        if scope["type"] == "websocket":
            if refusal is None:
                await self.app(scope, receive, send)
            else:
                await receive()
                await WebSocketClose(1008, refusal.detail)(scope, receive, send)
            return
        nonce = secrets.token_urlsafe(16)
        send = _guarding(send, self.access.security_policy(connection, nonce), nonce)
        if refusal is None:
            await self.app(_uncompressed(scope, connection), _bounded(receive, self.most_body), send)
        else:
            wants_page = scope["method"] == "GET" and "text/html" in connection.headers.get("accept", "")
            if refusal.status_code == 401 and wants_page and self.sign_in_page:
                await HTMLResponse(self.sign_in_page, 401)(scope, receive, send)
            else:
                await said(refusal.status_code, refusal.detail)(scope, receive, send)

    def _refusal(self, connection: HTTPConnection) -> HTTPException | None:
        access, headers = self.access, connection.headers
        if not access.host_is_ours(headers.get("host")):
            return HTTPException(
                421, "found another Host than the dashboard's, expected the name that `sinew serve` printed"
            )
        origins = headers.getlist("origin")
        may_change = connection.scope["type"] == "websocket" or connection.scope["method"] not in ("GET", "HEAD")
        if may_change and not (
            all(map(access.origin_is_ours, origins)) and (origins or access.bearer_is_right(connection))
        ):
            return HTTPException(403, "found a request from elsewhere, expected one of the dashboard's own page")
        length = headers.get("content-length", "0")
        if not length.isdecimal() or len(length) > 12 or int(length) > self.most_body:
            return HTTPException(413, _too_large(self.most_body))
        if (
            not access.is_loopback
            and not access.is_signed_in(connection)
            and not self._is_free(connection.scope["path"])
        ):
            return HTTPException(401, "nobody is signed in; sign in with the token that `sinew serve` printed")
        return None

    def _is_free(self, path: str) -> bool:
        return ".." not in path and any(
            path.startswith(free) if free.endswith("/") else path == free for free in self.free
        )


def said(status: int, sentence: str, **more: object) -> Response:
    """Return an answer as all ports give it: {"ok", "sentence", ...}. status: of HTTP, 4xx where it is not ok."""
    return JSONResponse({"ok": status < 400, "sentence": sentence, **more}, status)


def new_token() -> str:
    """Return a token that nobody guesses: 192 bits as text."""
    return secrets.token_urlsafe(24)


def _is_local(address: str) -> bool:
    try:
        found = ipaddress.ip_address(address)
    except ValueError:
        return False
    return (getattr(found, "ipv4_mapped", None) or found).is_loopback


def _bracketed(name: str) -> str:
    return f"[{name}]" if ":" in name and not name.startswith("[") else name


def _octets(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass")  # JSON can hold half a surrogate pair


def _too_large(most: int) -> str:
    return f"found a request that is too large, expected at most {most} bytes"


def _bounded(receive: "Receive", most: int) -> "Receive":
    """Return a source of a request's body that gives no more of it than it may have. Raises HTTPException."""
    left = most

    async def next_message() -> "Message":
        nonlocal left
        message = await receive()
        left -= len(message.get("body", b""))
        if left < 0:
            raise HTTPException(413, _too_large(most))
        return message

    return next_message


def _uncompressed(scope: "Scope", connection: HTTPConnection) -> "Scope":
    """Return what asks for a page as it is, so that its scripts can be marked as ours."""
    if scope["method"] != "GET" or "text/html" not in connection.headers.get("accept", ""):
        return scope
    return {**scope, "headers": [pair for pair in scope["headers"] if pair[0] != b"accept-encoding"]}


def _guarding(send: "Send", policy: str, nonce: str) -> "Send":
    """Return a way to send that says what browsers shall not do with an answer, and marks the scripts of a page.

    What comes from people stands in no page as markup, so every script in one is ours or NiceGUI's; what a page is made
    to build later has no mark and does not run.
    """
    start: Message | None = None
    page = b""

    async def send_guarded(message: "Message") -> None:
        nonlocal start, page
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers.update(_GUARDS)
            headers.setdefault("Content-Security-Policy", policy)
            headers.setdefault("Cache-Control", "no-store")
            is_page = headers.get("content-type", "").startswith("text/html") and "content-encoding" not in headers
            if is_page and f"'nonce-{nonce}'" in headers["Content-Security-Policy"]:
                start = message
                return
        elif start is not None and message["type"] == "http.response.body":
            page += message.get("body", b"")
            if message.get("more_body", False):
                return
            marked = _SCRIPT.sub(b'<script nonce="' + nonce.encode() + b'"', page)
            headers = MutableHeaders(scope=start)
            if "content-length" in headers:
                headers["content-length"] = str(int(headers["content-length"]) + len(marked) - len(page))
            await send(start)
            start, message = None, {**message, "body": marked}
        await send(message)

    return send_guarded


# Signing in: a viewer shows the token and gets a session.
#
# `sinew serve` prints an address that ends in `#token=...`. What follows the `#` never leaves the browser, so the token
# stands in no request line and no log; the page's script posts it once and takes it out of the address.


def sign_in_routes(access: Access, page: str) -> list[Route]:
    """Return the routes GET /login (the page, HTML) and POST /login {"token": ...}, which sets the cookie."""

    async def sign_in(request: Request) -> Response:
        given = None
        with suppress(ValueError, RecursionError, AttributeError):
            given = json.loads(await request.body()).get("token")
        if not isinstance(given, str):
            return said(400, 'found no token, expected {"token": "..."}')
        if not access.token_is_right(given):
            await asyncio.sleep(WRONG_S)
            return said(401, "this is not the token; copy the one that `sinew serve` printed")
        answer = said(200, "signed in")
        access.set_cookie(answer, access.new_session())
        return answer

    return [
        Route("/login", lambda _: HTMLResponse(page), methods=["GET"]),
        Route("/login", sign_in, methods=["POST"]),
    ]


def server_config(app: Any, **settings: Any) -> uvicorn.Config:
    """Return uvicorn's settings for an application: small heads and messages, no logs of requests, no trust in proxies.

    settings: what is to be otherwise, as uvicorn.Config takes it; `ws="none"` where there are no web sockets.
    """
    for name in ("uvicorn.error", "uvicorn.access"):
        logging.getLogger(name).setLevel(logging.ERROR)
    chosen: dict[str, Any] = {
        "http": "h11",
        "log_config": None,
        "access_log": False,
        "server_header": False,
        "proxy_headers": False,
        "timeout_keep_alive": 5,
        "timeout_graceful_shutdown": 2,
        "h11_max_incomplete_event_size": 16 * 1024,
        "ws_max_size": 256 * 1024,
        "lifespan": "off",
    }
    return uvicorn.Config(app, **(chosen | settings))
