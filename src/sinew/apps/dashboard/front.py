"""This is where uvicorn is told how patient it may be: idle, dripping or countless connections keep nobody out.

uvicorn waits for the first request of a connection for ever. Here a connection that has not sent a whole head within
a few seconds is closed, and where there are too many, the idle one that was there longest makes room for the newcomer.
"""

import asyncio
import logging
import resource
import time
from typing import Any

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

__all__ = ["AT_ONCE", "HEAD_S", "MOST_OPEN", "PatientProtocol", "raise_file_limit", "server_config"]

HEAD_S = 10.0
"""Within so long a whole head must be here [s]."""

MOST_OPEN = 700
"""Open connections, those of the idle included.

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
        """Take a new connection; where there are too many, drop the one that has been idle longest."""
        super().connection_made(transport)
        self.made = time.monotonic()
        self._head_timer: asyncio.TimerHandle | None = None
        self._await_head()
        staying = [each for each in self.connections if isinstance(each, PatientProtocol) and not each.is_leaving()]
        if len(staying) > MOST_OPEN:
            idle = [each for each in staying if each.is_idle() and each is not self]
            min(idle, key=lambda each: each.made, default=self).transport.abort()

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

    def is_idle(self) -> bool:
        """Return whether no request is under way."""
        return self.cycle is None or self.cycle.response_complete

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
