"""This is where the page server is kept alive: a process that may fall over without anything moving.

It gets what it needs to know as one line of JSON on its stdin, for arguments and environments can be read by others;
that its stdin ends is its sign that nobody needs it any more.
"""

import json
import socket
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from sinew.apps.dashboard.processes import end_process

__all__ = ["MOST_RESTARTS", "WITHIN_S", "PageProcess"]

MOST_RESTARTS = 5
"""So often it is begun anew within `WITHIN_S`; then it rests until the oldest time is that long ago."""

WITHIN_S = 60.0
"""See `MOST_RESTARTS` [s]."""

_LOOK_S = 0.1
_PATIENCE_S = 3.0
_REST_S = 0.3  # before it is begun anew


class PageProcess:
    """The page server, begun again when it dies.

    command: what begins it. config: what it is told. address: where it listens, (host, port). log: for what it says.
    """

    def __init__(
        self,
        command: Sequence[str],
        config: dict[str, Any],
        address: tuple[str, int],
        log: Path,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._command, self._config, self._address, self._log = list(command), config, address, log
        self._clock = clock
        self._begun: deque[float] = deque()
        self._over = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._keep, name="page", daemon=True)
        self.state = "starting"

    def open(self) -> None:
        """Begin the page server, and watch it from now on."""
        self._thread.start()

    def close(self) -> None:
        """End the page server: its stdin ends, and after a while it is ended by force."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()
        if self._process is not None:
            assert self._process.stdin is not None
            self._process.stdin.close()
            try:
                self._process.wait(_PATIENCE_S)
            except subprocess.TimeoutExpired:
                end_process(self._process, _PATIENCE_S)

    @property
    def pid(self) -> int | None:
        """The number of its process, or None where there is none."""
        process = self._process
        return process.pid if process is not None and process.poll() is None else None

    def _keep(self) -> None:
        while not self._over.is_set():
            if self._process is None or self._process.poll() is not None:
                self._begin_again()
            elif self.state == "starting" and self._answers():
                self.state = "up"
            self._over.wait(_LOOK_S)

    def _begin_again(self) -> None:
        now = self._clock()
        while self._begun and now - self._begun[0] >= WITHIN_S:
            self._begun.popleft()
        if len(self._begun) > MOST_RESTARTS:
            self.state = "down"
            return
        self.state = "starting"
        if self._process is not None:
            assert self._process.stdin is not None
            self._process.stdin.close()
            self._over.wait(_REST_S)
        self._begun.append(now)
        try:
            self._process = self._begin()
        except OSError:
            self._process = None

    def _begin(self) -> "subprocess.Popen[bytes]":
        with self._log.open("ab") as log:
            # Unbuffered: what a process that has died did not take is not tried again when its stdin is closed.
            process = subprocess.Popen(
                self._command,
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        assert process.stdin is not None
        with suppress(BrokenPipeError):  # it has died already, which is seen at the next look
            process.stdin.write(json.dumps(self._config).encode() + b"\n")
        return process

    def _answers(self) -> bool:
        try:
            with socket.create_connection(self._address, timeout=_LOOK_S):
                return True
        except OSError:
            return False
