"""Whose requests reach the dashboard: hosts, origins, the token, its sessions, and how much of each may be under way.

Browsers send cookies to every port of a host, and any page may send them requests. So three things are asked. The Host
header must be a name that we serve: a name that was rebound to our address is none. The Origin of whatever may change
something must be our own page. And who steers shows a cookie that only the token can have made, or the token itself.
The page server and the steering port know the same token and the same list of sessions that were ended, so a session of
one is a session of the other. Another dashboard on the same host has another port, and so cookies and sessions of its
own.
"""

import asyncio
import hashlib
import hmac
import ipaddress
import json
import logging
import os
import re
import resource
import secrets
import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import urlsplit

import h11
import uvicorn
from itsdangerous import BadData, TimestampSigner
from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection, Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route
from uvicorn.protocols.http.h11_impl import H11Protocol

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send


IDLE_S = 12 * 3600.0
"""A session that no page has used for so long is over [s]."""

LONGEST_S = 7 * 24 * 3600.0
"""A session is over so long after the token was shown, however much it is used [s]."""

RENEWED_S = 600.0
"""A session whose cookie is older gets a new one when its page asks for the status [s]."""

_BODY_S = 10.0
_HURRY_S = 0.25  # for the body of a stranger's urgent request in a crowd
_SKEW_S = 60.0  # a clock that is set back by so much ends no session
_GUARDS = {"X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "X-Frame-Options": "DENY"}
_LOCAL_NAMES = frozenset({"127.0.0.1", "localhost", "[::1]"})
_FORWARDED = ("forwarded", "via", "x-forwarded-for", "x-forwarded-host", "x-forwarded-proto", "x-real-ip")
_SCRIPT = re.compile(rb"<script(?=[\s>])", re.IGNORECASE)


class Session(NamedTuple):
    """Who once showed the token. id: of the session. begun: when that was; used: when it was renewed [s since 1970]."""

    id: str
    begun: int
    used: int


class SignedOut:
    """The sessions that were ended before their time; whoever is given the same file knows of the same ones.

    file: a line `<id> <when it would have ended anyway>` for each; None: known here alone. What was read stays known,
    even if the file goes away.
    """

    def __init__(self, file: Path | None = None) -> None:
        self._file, self._stamp = file, (0, 0, 0)
        self._ends: dict[str, float] = {}

    def __contains__(self, session_id: object) -> bool:
        self._look()
        return session_id in self._ends

    def add(self, session: Session) -> None:
        """End a session for everybody who knows the file. Raises OSError where it cannot be written."""
        self._look()
        self._ends[session.id] = session.begun + LONGEST_S
        if self._file is not None:
            self._write(self._file)

    def _write(self, file: Path) -> None:
        now = time.time()
        lines = [f"{name} {end:.0f}\n" for name, end in self._ends.items() if end > now]
        fresh = file.with_name(f".{file.name}.{secrets.token_hex(4)}")
        with os.fdopen(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as out:
            out.write("".join(lines))
            out.flush()
            os.fsync(out.fileno())
        fresh.replace(file)

    def _look(self) -> None:
        if self._file is None:
            return
        try:
            about = self._file.lstat()
            stamp = about.st_ino, about.st_size, about.st_mtime_ns
            if stamp == self._stamp:
                return
            text = self._file.read_text(encoding="ascii")
        except (OSError, UnicodeDecodeError):
            return
        self._stamp = stamp
        for line in text.splitlines():
            name, _, end = line.partition(" ")
            if end.isdecimal():
                self._ends[name] = float(end)


class _Signer(TimestampSigner):
    """A signer with a clock of ours [s since 1970]."""

    clock: Callable[[], float] = time.time

    def get_timestamp(self) -> int:
        return int(self.clock())


@dataclass(frozen=True)
class Access:
    """Who may come in.

    token: the secret that a viewer types or follows a link with.
    host, port: the address of the page, as it is bound; an IPv6 address without brackets.
    hosts: names under which a proxy brings browsers, without a port. own_names: further ones of this computer.
    signed_out: sessions that were ended. clock: [s since 1970].
    """

    token: str = field(repr=False)
    host: str
    port: int
    hosts: tuple[str, ...] = ()
    own_names: tuple[str, ...] = ()
    signed_out: SignedOut = field(default_factory=SignedOut, repr=False, compare=False)
    clock: Callable[[], float] = field(default=time.time, repr=False, compare=False)

    @property
    def cookie_name(self) -> str:
        """The name of the cookie that holds a session: with our port, for browsers tell no ports of a host apart."""
        return f"sinew_session_{self.port}"

    @property
    def has_proxy(self) -> bool:
        """Whether a proxy is declared, which brings strangers under an address of this computer."""
        return bool(self.hosts)

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
        return not self.is_loopback or self.has_proxy

    @property
    def near(self) -> str:
        """The address under which this computer reaches us; one of IPv6 without brackets."""
        return {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(self.host, self.host)

    def names(self) -> frozenset[str]:
        """Return the host names that we serve, in lower case, IPv6 addresses in brackets."""
        own = {_bracketed(name.lower()) for name in (self.host, *self.hosts, *self.own_names)}
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

    def new_session(self) -> str:
        """Return the value of a new session's cookie: `<id>.<when it began>.<now>.<signature under the token>`."""
        return self._sign(Session(secrets.token_urlsafe(12), int(self.clock()), 0))

    def session_in(self, cookie: str | None) -> Session | None:
        """Return the session that a cookie's value shows; None where we did not make it, or it is over."""
        if not cookie:
            return None
        try:
            told, used = self._signer().unsign(cookie, return_timestamp=True)
            name, begun = told.decode("ascii").split(".")
            session = Session(name, int(begun), int(used.timestamp()))
        except (BadData, ValueError):  # a text that holds no ASCII is a ValueError, too
            return None
        now = self.clock()
        is_fresh = -_SKEW_S <= now - session.used <= IDLE_S and now - session.begun <= LONGEST_S
        return session if is_fresh and session.id not in self.signed_out else None

    def session(self, connection: HTTPConnection) -> Session | None:
        """Return the session that a request shows, if any."""
        return self.session_in(connection.cookies.get(self.cookie_name))

    def keep_session(self, response: Response, connection: HTTPConnection) -> None:
        """Give the session of a request more time, where its cookie is not new any more."""
        session = self.session(connection)
        if session is not None and self.clock() - session.used > RENEWED_S:
            self.set_cookie(response, connection, self._sign(session))

    def set_cookie(self, response: Response, connection: HTTPConnection, value: str) -> None:
        """Hand a session to the browser; an empty value takes it away."""
        response.set_cookie(
            self.cookie_name,
            value,
            max_age=int(IDLE_S) if value else 0,
            path="/",
            secure=self.is_https(connection),
            httponly=True,
            samesite="strict",
        )

    def end_session(self, connection: HTTPConnection) -> None:
        """End the session that a request shows, for both servers and for good. Raises OSError where it is not kept."""
        session = self.session(connection)
        if session is not None:
            self.signed_out.add(session)

    def bearer_is_right(self, connection: HTTPConnection) -> bool:
        """Return whether a request carries the token itself in its Authorization header; no browser does so unasked."""
        scheme, _, given = connection.headers.get("authorization", "").partition(" ")
        return scheme.lower() == "bearer" and self.token_is_right(given.strip())

    def is_signed_in(self, connection: HTTPConnection) -> bool:
        """Return whether a request shows a session or the token."""
        return self.session(connection) is not None or self.bearer_is_right(connection)

    def is_at_machine(self, connection: HTTPConnection) -> bool:
        """Return whether a request comes from the computer that serves, and no proxy can have brought it.

        A proxy that is declared may bring anybody; one that is not is known by what proxies add to a request.
        """
        if self.has_proxy or connection.client is None or any(name in connection.headers for name in _FORWARDED):
            return False
        server = connection.scope.get("server") or ("", None)
        return _is_local(connection.client.host) or connection.client.host == server[0]

    def may_stop(self, connection: HTTPConnection) -> bool:
        """Return whether a request may stop the bench at once: of who is signed in, or sits at this computer."""
        return self.is_signed_in(connection) or self.is_at_machine(connection)

    def is_https(self, connection: HTTPConnection) -> bool:
        """Return whether the browser spoke to us, or to our proxy, under TLS."""
        if connection.scope.get("scheme") in ("https", "wss"):
            return True
        origin = connection.headers.get("origin")
        if self.origin_is_ours(origin):
            return str(origin).lower().startswith("https:")
        return self._is_proxy(connection) and connection.headers.get("x-forwarded-proto", "").lower() == "https"

    def source(self, connection: HTTPConnection) -> str:
        """Return where a request comes from: an address, of IPv6 its network; behind our proxy whom that names last."""
        told = connection.client.host if connection.client is not None else ""
        if self._is_proxy(connection):
            told = connection.headers.get("x-forwarded-for", told).rpartition(",")[2].strip()
        try:
            address = ipaddress.ip_address(told)
        except ValueError:
            return told[:64]
        return str(ipaddress.ip_network(f"{address}/64", strict=False) if address.version == 6 else address)

    def security_policy(self, connection: HTTPConnection, steering_port: int | None, nonce: str) -> str:
        """Return the Content-Security-Policy of a page: nothing of another host, no script that we did not write.

        steering_port: of the commands, to which pages speak; None where they do not. nonce: of the scripts in the page.
        NiceGUI evaluates what its server sends and styles elements one by one, so `unsafe-eval` and inline styles stay.
        """
        host = connection.headers.get("host", "")
        name = _bracketed(urlsplit(f"//{host}").hostname or "") if self.host_is_ours(host) else ""
        reached = ["'self'", *(f"{scheme}://{host}" for scheme in ("ws", "wss") if name)]
        if steering_port is not None and name:
            reached += [f"{scheme}://{name}:{steering_port}" for scheme in ("http", "https")]
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

    def _is_proxy(self, connection: HTTPConnection) -> bool:
        return self.has_proxy and connection.client is not None and _is_local(connection.client.host)

    def _sign(self, session: Session) -> str:
        return self._signer().sign(f"{session.id}.{session.begun}").decode("ascii")

    def _signer(self) -> _Signer:
        signer = _Signer(_octets(self.token), salt=f"{self.cookie_name}", digest_method=hashlib.sha256)
        signer.clock = self.clock
        return signer


class Gate:
    """An ASGI application before another one, which only requests get to that may.

    must_sign_in: whether even looking takes a session or the token. free: paths that never do; one that ends in a slash
    stands for all below it. urgent: paths of which a stranger's request is heard in the thickest crowd, if its body
    comes with its head. sign_in_page: HTML for a browser that has to sign in; programs get JSON. steering_port: of the
    commands, if the pages behind us speak to it.
    most_body: of a request [bytes]. most_sockets: open web sockets of one session; most_in_all: of all sessions;
    most_strangers: of all who are not signed in together, so that these take no place from those.
    most_connections: requests under way of those who are not signed in, so that no crowd keeps an operator out.

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
        urgent: Collection[str] = ("/login",),
        sign_in_page: str = "",
        steering_port: int | None = None,
        most_body: int = 256 * 1024,
        most_sockets: int = 24,
        most_in_all: int = 128,
        most_strangers: int = 48,
        most_connections: int = 200,
    ) -> None:
        self.app, self.access, self.must_sign_in = app, access, must_sign_in
        self.free, self.urgent, self.sign_in_page = tuple(free), tuple(urgent), sign_in_page
        self.steering_port = steering_port
        self.most_body, self.most_connections = most_body, most_connections
        self.most_sockets, self.most_in_all, self.most_strangers = most_sockets, most_in_all, most_strangers
        self.under_way = 0
        self.sockets: Counter[str] = Counter()

    async def __call__(self, scope: "Scope", receive: "Receive", send: "Send") -> None:
        """Let a request through, or refuse it."""
        if scope["type"] == "websocket":
            await self._socket(scope, receive, send)
        elif scope["type"] == "http":
            self.under_way += 1
            try:
                await self._http(scope, receive, send)
            finally:
                self.under_way -= 1
        else:
            await self.app(scope, receive, send)

    async def _http(self, scope: "Scope", receive: "Receive", send: "Send") -> None:
        connection = HTTPConnection(scope)
        nonce = secrets.token_urlsafe(16)
        send = _guarding(send, self.access.security_policy(connection, self.steering_port, nonce), nonce)
        refusal = self._refusal(connection)
        if refusal is None and self._is_crowded(connection):
            if scope["path"] not in self.urgent:
                refusal = _CROWDED
            patience_s = _HURRY_S
        else:
            patience_s = _BODY_S
        if refusal is None and _may_change(scope):
            body = await _whole_body(receive, self.most_body, patience_s)
            if isinstance(body, bytes):
                receive = _again(body, receive)
            else:
                refusal = body
        if refusal is None:
            await self.app(_uncompressed(scope, connection), receive, send)
        else:
            await self._answer(refusal, connection)(scope, receive, send)

    async def _socket(self, scope: "Scope", receive: "Receive", send: "Send") -> None:
        connection = HTTPConnection(scope)
        session = self.access.session(connection)
        who = session.id if session is not None else _PROGRAM if self.access.bearer_is_right(connection) else _STRANGER
        refusal = self._refusal(connection) or self._no_place(who)
        if refusal is not None:
            await receive()
            await send({"type": "websocket.close", "code": 1008, "reason": refusal.sentence})
            return
        self.sockets[who] += 1
        try:
            await self.app(scope, receive, send)
        finally:
            self.sockets[who] -= 1
            self.sockets += Counter()  # forget who has none

    def _no_place(self, who: str) -> "_Refusal | None":
        """Return why somebody gets no further web socket, if so."""
        strangers = self.sockets[_STRANGER]
        if who == _STRANGER:
            return _CROWDED if strangers >= self.most_strangers else None
        is_full = self.sockets[who] >= self.most_sockets or self.sockets.total() - strangers >= self.most_in_all
        return _CROWDED if is_full else None

    def _is_crowded(self, connection: HTTPConnection) -> bool:
        return self.under_way > self.most_connections and not self.access.is_signed_in(connection)

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
        if self.must_sign_in and not access.is_signed_in(connection) and not self._is_free(connection.scope["path"]):
            return _Refusal(401, "nobody is signed in; sign in with the token that `sinew serve` printed")
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


def _same(ours: str, given: str) -> bool:
    return hmac.compare_digest(_octets(ours), _octets(given))


class _Refusal(NamedTuple):
    status: int
    sentence: str


_CROWDED = _Refusal(503, "found too many connections at once; sign in, or close other pages, and try again")
_STRANGER, _PROGRAM = "", "with the token"


def _too_large(most: int) -> _Refusal:
    return _Refusal(413, f"found a request that is too large, expected at most {most} bytes")


def _may_change(scope: "Scope") -> bool:
    return scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")


async def _whole_body(receive: "Receive", most: int, patience_s: float) -> "bytes | _Refusal":
    """Return a request's body, or why it is refused: a sender that drips or leaves would keep the application busy."""
    body = bytearray()
    try:
        async with asyncio.timeout(patience_s):
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
        return _Refusal(408, f"found no whole request within {patience_s:g} s; send it again")


def _again(body: bytes, receive: "Receive") -> "Receive":
    """Return a source of messages that gives a body that was read, and then what else comes."""
    whole: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def next_message() -> "Message":
        return whole.pop() if whole else await receive()

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


# Signing in and out: a viewer shows the token and gets a session, or ends it.
#
# `sinew serve` prints an address that ends in `#token=...`. What follows the `#` never leaves the browser, so the token
# stands in no request line and no log; the page's script posts it once and takes it out of the address.

WRONG_MOST = 10
"""So many wrong tokens of one source are answered as such in a window."""

WINDOW_S = 60.0
"""Length of a window [s]."""

_MOST_SOURCES = 1024

SIGN_IN = """\
<h1>Sinew</h1>
<p>Sign in with the token that <code>sinew serve</code> printed.</p>
<form id="sinew-sign-in-form">
<label for="token">Token</label>
<input id="token" type="password" autocomplete="off" required>
<button class="sinew-button main">Sign in</button>
<p id="said" role="status"></p>
</form>
<script>
const form = document.getElementById("sinew-sign-in-form"), said = document.getElementById("said");
async function signIn(token) {
  try {
    const answer = await fetch("/login", {
      method: "POST", headers: {"Content-Type": "application/json"}, body: JSON.stringify({token}),
    });
    if (answer.ok) location.replace(location.pathname === "/login" ? "/" : location.pathname);
    else said.textContent = (await answer.json()).sentence;
  } catch { said.textContent = "the dashboard does not answer; is sinew serve running?"; }
}
form.addEventListener("submit", event => {
  event.preventDefault();
  signIn(document.getElementById("token").value.trim());
});
const given = new URLSearchParams(location.hash.slice(1)).get("token");
if (given) { history.replaceState(null, "", location.pathname); signIn(given); }
</script>
"""
"""What a page holds, as HTML, that asks for the token, or takes it from the address's fragment."""


class Attempts:
    """How many wrong tokens came of late from each source. clock: monotonic [s].

    This keeps guessing from being cheap and from filling the day. It is no lock: a right token is always taken, or
    whoever sends wrong ones could keep its owner from the stop. One of 20 characters and more is not found by trying.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._wrong: OrderedDict[str, tuple[int, float]] = OrderedDict()

    def wait_s(self, source: str) -> float:
        """Return how long a source waits until a wrong token of it is answered as such again [s]; 0 where it is now."""
        wrong, began = self._wrong.get(source, (0, 0.0))
        left = began + WINDOW_S - self._clock()
        return left if wrong >= WRONG_MOST and left > 0 else 0.0

    def note_wrong(self, source: str) -> None:
        """Count a wrong token; the first one after a window begins the next. The oldest source is forgotten."""
        now = self._clock()
        wrong, began = self._wrong.pop(source, (0, now))
        self._wrong[source] = (wrong + 1, began) if now < began + WINDOW_S else (1, now)
        if len(self._wrong) > _MOST_SOURCES:
            self._wrong.popitem(last=False)


def sign_in_routes(access: Access, page: str, attempts: Attempts | None = None) -> list[Route]:
    """Return the routes GET /login (the page, HTML), POST /login {"token": ...} (sets the cookie) and POST /logout.

    A session that is signed out is over for both servers, wherever its cookie was copied to.
    """
    counted = attempts or Attempts()

    async def sign_in(request: Request) -> Response:
        given = _given_token(await request.body())
        if given is None:
            return _refused(400, 'found no token, expected {"token": "..."}')
        if not access.token_is_right(given):
            return refuse_wrong(request)
        answer = JSONResponse({"ok": True, "sentence": "signed in"})
        access.set_cookie(answer, request, access.new_session())
        return answer

    def refuse_wrong(request: Request) -> Response:
        source = access.source(request)
        if not access.is_at_machine(request):
            if (wait_s := counted.wait_s(source)) > 0:
                sentence = f"too many wrong tokens; try again in {wait_s:.0f} s"
                return _refused(429, sentence, {"Retry-After": str(int(wait_s) + 1)})
            counted.note_wrong(source)
        return _refused(401, "this is not the token; copy the one that `sinew serve` printed")

    async def sign_out(request: Request) -> Response:
        answer = JSONResponse({"ok": True, "sentence": "signed out"})
        try:
            access.end_session(request)
        except OSError as trouble:
            sentence = f"signed out here, but the bench was not told ({trouble.strerror}); end `sinew serve` to be sure"
            answer = _refused(500, sentence)
        access.set_cookie(answer, request, "")
        return answer

    return [
        Route("/login", lambda _: HTMLResponse(page), methods=["GET"]),
        Route("/login", sign_in, methods=["POST"]),
        Route("/logout", sign_out, methods=["POST"]),
    ]


def _given_token(body: bytes) -> str | None:
    try:
        told = json.loads(body)
    except (ValueError, RecursionError):
        return None
    given = told.get("token") if isinstance(told, dict) else None
    return given if isinstance(given, str) else None


def _refused(status: int, sentence: str, headers: dict[str, str] | None = None) -> JSONResponse:
    return JSONResponse({"ok": False, "sentence": sentence}, status, headers)


# Uvicorn is told how patient it may be: idle, dripping or countless connections keep nobody out.
#
# uvicorn waits for the first request of a connection for ever. Here a connection that has not sent a whole head
# within a few seconds is closed, and where there are too many, the one that has owed its request longest makes room for
# the newcomer.

HEAD_S = 10.0
"""Within so long a whole head must be here [s]."""

MOST_OPEN = 700
"""Open connections, those included that owe their request.

With what else is open that stays well below 1024, where select() ends, by which a serial port is read: a port that is
opened while a crowd is here must get a lower number.
"""

AT_ONCE = 64
"""So many newcomers are taken before those that make room have left."""

_MOST_HEAD = 16 * 1024  # bytes
_FILES = 1024
_KEEP_ALIVE_S = 5


class PatientProtocol(H11Protocol):
    """HTTP/1.1 of uvicorn for one connection, with an end to its patience."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a new connection; where there are too many, drop the oldest of those that owe their request."""
        super().connection_made(transport)
        self.made = time.monotonic()
        self._head_timer: asyncio.TimerHandle | None = None
        self._await_head()
        staying = [each for each in self.connections if isinstance(each, PatientProtocol) and not each.is_leaving()]
        if len(staying) > MOST_OPEN:
            owing = [each for each in staying if each.owes_request() and each is not self]
            min(owing, key=lambda each: each.made, default=self).transport.abort()

    def data_received(self, data: bytes) -> None:
        """Take what has come; the patience with a head begins with its first byte, and drops do not renew it."""
        super().data_received(data)
        if self.conn.their_state is h11.IDLE:
            self._await_head()
        else:
            self._forget_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """Let go of a connection that is over."""
        self._forget_head()
        super().connection_lost(exc)

    def is_leaving(self) -> bool:
        """Return whether it is being closed."""
        return self.transport.is_closing()

    def owes_request(self) -> bool:
        """Return whether no request is under way, or only a part of one has come."""
        return self.cycle is None or self.cycle.response_complete or self.conn.their_state is h11.SEND_BODY

    def _await_head(self) -> None:
        if self._head_timer is None:
            self._head_timer = self.loop.call_later(HEAD_S, self.transport.abort)

    def _forget_head(self) -> None:
        if self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None


def server_config(app: Any, **settings: Any) -> uvicorn.Config:
    """Return uvicorn's settings for an application: small heads and messages, no logs of requests, no trust in proxies.

    settings: what is to be otherwise, as uvicorn.Config takes it; `ws="none"` where there are no web sockets.
    """
    for name in ("uvicorn.error", "uvicorn.access"):
        logging.getLogger(name).setLevel(logging.ERROR)
    chosen: dict[str, Any] = {
        "http": PatientProtocol,
        "log_config": None,
        "access_log": False,
        "server_header": False,
        "proxy_headers": False,
        "timeout_keep_alive": _KEEP_ALIVE_S,
        "timeout_graceful_shutdown": 2,
        "h11_max_incomplete_event_size": _MOST_HEAD,
        "ws_max_size": 256 * 1024,
        "backlog": AT_ONCE,
        "lifespan": "off",
    }
    return uvicorn.Config(app, **(chosen | settings))


def raise_file_limit() -> None:
    """Let this process open the files that `MOST_OPEN` connections are, where the system begins with fewer."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    enough = _FILES if hard == resource.RLIM_INFINITY else min(hard, _FILES)
    if soft < enough:
        resource.setrlimit(resource.RLIMIT_NOFILE, (enough, hard))
