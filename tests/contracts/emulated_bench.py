"""Benches for the command line: in virtual time inside this process, or behind a pseudo-terminal in another."""

import fcntl
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from tests.patience import await_end, comes, communicate, finished
from tests.unit.emulator_stand_in import StandIn

from sinew.emulator.bench import EmulatedRig, VirtualPort
from sinew.emulator.plant import JointPlant
from sinew.hardware import codec as ask
from sinew.hardware.codec import Decoder, Instruction
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_rig, load_rig

SINEW = Path(sys.executable).with_name("sinew")
PATIENCE = 90.0  # s; how long a step of another process may take, see tests.patience
STARTS = 5
QUESTIONS = {ask.PING, ask.READ, ask.SYNC_READ, ask.BULK_READ}


class WatchedPort(VirtualPort):
    """A port that notes which instructions were sent, and when the last; it may be closed and used again.

    agenda: what happens when something is sent at or after a time [s], in order. witness: called before each sending.
    """

    def __init__(self, rig: EmulatedRig) -> None:
        super().__init__(rig)
        self.codes: set[int] = set()
        self.spoke = 0.0
        self.agenda: list[tuple[float, Callable[[], object]]] = []
        self.witness: Callable[[], object] = lambda: None
        self._ear = Decoder()

    def write(self, data: bytes) -> None:
        self.witness()
        if self.agenda and self.now() >= self.agenda[0][0]:
            self.agenda.pop(0)[1]()
        self.codes |= {packet.code for packet in self._ear.feed(data) if isinstance(packet, Instruction)}
        super().write(data)
        self.spoke = self.now()


def virtual_port(
    monkeypatch: pytest.MonkeyPatch,
    spec: RigSpec | None = None,
    plant: JointPlant | None = None,
    *,
    baud: int | None = None,
) -> WatchedPort:
    """Have the command line find this port, and its time, wherever it looks for a serial port."""
    spec = spec or load_rig("paper")
    port = WatchedPort(EmulatedRig(spec, plant or StandIn(), baud=baud))
    monkeypatch.setattr("sinew.hardware.ports.SerialPort", lambda *_: port)
    monkeypatch.setattr("sinew.hardware.bus.MonotonicClock", lambda: port)
    return port


def joint(spec: RigSpec) -> JointPlant:
    return JointPlant(spec, slack_m=(1.0e-3, 2.5e-3, 1.8e-3, 0.6e-3), rest_tilt=(0.01, -0.01))


def rig_file(folder: Path, *, limits: dict[str, Any] | None = None, **wiring: Any) -> str:
    """Return the path of the paper's rig with other limits or wiring."""
    spec = load_rig("paper")
    changed = {
        "wiring": spec.wiring.model_copy(update=wiring),
        "limits": spec.limits.model_copy(update=limits or {}),
    }
    path = folder / "rig.toml"
    path.write_text(dump_rig(spec.model_copy(update=changed)))
    return str(path)


@dataclass
class Playing:
    """An emulator at work. port: to open. process: to stop it."""

    port: str
    process: subprocess.Popen[str]
    file: Path

    def truth(self) -> dict[str, Any]:
        """End the emulator and return what truly happened."""
        self.process.terminate()
        await_end(self.process, PATIENCE)
        return dict(json.loads(self.file.read_text()))


@contextmanager
def alone() -> Iterator[None]:
    """Wait until no other process is in here: what runs in real time has the computer to itself, as far as we can."""
    with (Path(tempfile.gettempdir()) / "sinew-real-time.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@contextmanager
def playing(folder: Path, *options: str) -> Iterator[Playing]:
    """Give an emulator that is ready, and no other at the same time; whatever happens, it is over at the end."""
    with alone():
        yield from _playing(folder, *options)


def _playing(folder: Path, *options: str) -> Iterator[Playing]:
    link, truth = folder / "bench", folder / "truth.json"
    command = [SINEW, "emulate", "--link", str(link), "--truth", str(truth), *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        try:
            assert process.stdout is not None
            assert comes(process.stdout, PATIENCE), "the emulator does not get ready"
            assert str(link) in process.stdout.readline()
            yield Playing(str(link), process, truth)
        finally:
            process.kill()


@contextmanager
def running(port: str, plan: Path, out: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """Give a run whose motors have just begun to pull, in a process of its own; it is over at the end.

    Where a pause of the computer ends it before that, as motors do that hear nothing for 80 ms, it is begun anew.
    """
    command = [SINEW, "run", str(plan), "--port", port, "--out", str(out), *options]
    said = []
    for _ in range(STARTS):
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            try:
                assert process.stderr is not None
                assert comes(process.stderr, PATIENCE), "the run does not begin"
                if (line := process.stderr.readline()) == "sinew: the tendons are pulled to first contact\n":
                    yield process
                    return
                status, told, err = ended(process)
            finally:
                process.kill()
        assert status == 1, line + err
        said.append(told)
        shutil.rmtree(out)
        stop = [SINEW, "stop", "--port", port, "--state", "release"]
        finished(stop, PATIENCE, check=True)
    raise AssertionError(f"no run got as far as pulling: {said}")


def ended(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Return status, stdout and the rest of stderr of a process that is about to end."""
    out, err = communicate(process, PATIENCE)
    return process.returncode, out, err
