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

__all__ = ["HEAD_S", "MOST_OPEN", "PatientProtocol", "raise_file_limit", "server_config"]

HEAD_S = 10.0
"""Within so long a whole head must be here [s]."""

MOST_OPEN = 2000
"""Open connections, those of the idle included."""

_MOST_HEAD = 16 * 1024  # bytes
_MOST_FILES = 65536
_KEEP_ALIVE_S = 5


class PatientProtocol(H11Protocol):
    """HTTP/1.1 of uvicorn for one connection, with an end to its patience."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a new connection; where there are too many, drop the one that has been idle longest."""
        super().connection_made(transport)
        self.made = time.monotonic()
        self._head_timer: asyncio.TimerHandle | None = None
        self._await_head()
        if len(self.connections) > MOST_OPEN:
            idle = [other for other in self.connections if isinstance(other, PatientProtocol) and other.is_idle()]
            if len(idle) > 1:
                min(idle, key=lambda other: other.made).transport.abort()

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
        "lifespan": "off",
    }
    return uvicorn.Config(app, **(chosen | settings))


def raise_file_limit() -> None:
    """Let this process open as many files as the system lets it without asking: a connection is a file."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = _MOST_FILES if hard == resource.RLIM_INFINITY else min(hard, _MOST_FILES)
    if soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
