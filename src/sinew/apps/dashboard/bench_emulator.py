"""This is where the dashboard gets an emulated bench to play with, or finds the one that a steward before it began."""

import json
import select
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from sinew.apps.dashboard.processes import Adopted, Process, adopt_from, end_process, write_pid
from sinew.apps.run_control import forget_socket
from sinew.measure.errors import FileError

__all__ = ["BenchEmulator"]

_READY_S = 90.0
_END_S = 5.0
_PID, _RIG = "emulator.pid", "rig"


class BenchEmulator:
    """`sinew emulate` in a process of its own. folder: for its link, its log and what truly happened (truth.json)."""

    def __init__(self, folder: Path, command: Callable[..., list[str]]) -> None:
        self._folder, self._command = folder, command
        self._process: Process | None = None

    @property
    def port(self) -> str:
        """The name of its port."""
        return str(self._folder / "port")

    @property
    def is_there(self) -> bool:
        """Whether the emulator goes on."""
        return self._process is not None and self._process.poll() is None

    def open(self, rig: str, seed: int) -> bool:
        """Begin the emulator, or take over one that is there; return whether it was there.

        rig: TOML file or name. Raises FileError where it does not get ready, or plays another rig.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        self._process = self._found(rig)
        if self._process is not None:
            return True
        link = Path(self.port)
        if link.is_symlink():
            # Its emulator is gone; what it leads to may be somebody else's terminal by now.
            forget_socket(link.readlink())
            link.unlink()
        self._begin(rig, seed)
        return False

    def close(self) -> None:
        """End the emulator."""
        if self._process is not None:
            end_process(self._process, _END_S)
            (self._folder / _PID).unlink(missing_ok=True)

    def _found(self, rig: str) -> Adopted | None:
        process = adopt_from(self._folder / _PID, ["emulate", self.port])
        if process is None or not Path(self.port).exists():
            return None
        playing = (self._folder / _RIG).read_text(encoding="utf-8") if (self._folder / _RIG).exists() else ""
        if playing != rig:
            process.close()
            raise FileError(
                f"an emulator plays the rig {playing} on {self.port} already, expected {rig}; "
                f"serve with --rig {playing}, or end process {process.pid}"
            )
        return process

    def _begin(self, rig: str, seed: int) -> None:
        truth = str(self._folder / "truth.json")
        words = (
            "emulate",
            "--link",
            self.port,
            "--socket",
            "--rig",
            rig,
            "--seed",
            str(seed),
            "--truth",
            truth,
            "--json",
        )
        log = self._folder / "emulator.log"
        with log.open("wb") as file:
            process = subprocess.Popen(
                self._command(*words),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=file,
                start_new_session=True,
            )
        self._process = process
        write_pid(self._folder / _PID, process.pid)
        (self._folder / _RIG).write_text(rig, encoding="utf-8")
        if not _is_ready(process):
            self.close()
            said = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
            raise FileError(f"the emulator does not get ready: {said[-1] if said else 'it says nothing'}; see {log}")


def _is_ready(process: "subprocess.Popen[bytes]") -> bool:
    assert process.stdout is not None
    with process.stdout as out:
        end = time.monotonic() + _READY_S
        if not select.select([out], [], [], max(0.0, end - time.monotonic()))[0]:
            process.send_signal(signal.SIGKILL)
            return False
        try:
            return isinstance(json.loads(out.readline()), dict)
        except ValueError:
            return False
