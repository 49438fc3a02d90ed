"""`sinew run` on a bench in virtual time, inside the process of the tests."""

import io
import os
import signal
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import pytest
from tests.contracts.emulated_bench import QUESTIONS, WatchedPort

from sinew.apps.cli import main
from sinew.emulator.bench import EmulatedRig


class Said(NamedTuple):
    """What a command ended with: its status and both of its streams."""

    status: int
    out: str
    err: str


def run(capsys: pytest.CaptureFixture[str], plan: str, out: Path, *options: str) -> Said:
    """Run a plan on the bench that `virtual_port` has put in place of every serial port."""
    capsys.readouterr()
    status = main(["run", plan, "--port", "/dev/bench", "--out", str(out), *options])
    return Said(status, *capsys.readouterr())


@dataclass(frozen=True)
class RunHere:
    """`sinew run` of the tiny plan on the bench of a port, into a folder that is not there yet."""

    plan: str
    out: Path
    port: WatchedPort
    capsys: pytest.CaptureFixture[str]

    def __call__(self, *options: str) -> Said:
        return run(self.capsys, self.plan, self.out, *options)

    def refused(self, words: tuple[str, ...], *options: str) -> None:
        """Check that it is refused in one line that has the words, and that the bench was only asked."""
        told = self(*options)
        assert (told.status, told.out, told.err.count("\n")) == (2, "", 1)
        assert [word for word in words if word not in told.err] == []
        assert self.port.codes <= QUESTIONS


def spoken(*arguments: str) -> tuple[int, str, str]:
    """Give a command line; return status, stdout and stderr where no test's own capture is at hand."""
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as err:
        status = main(list(arguments))
    return status, out.getvalue(), err.getvalue()


def torques(rig: EmulatedRig) -> list[bool]:
    """Return whether each motor's torque is on."""
    return [state.torque for state in rig.states().values()]


def without_motor(rig: EmulatedRig) -> None:
    """Take tendon motor 4 off the line."""
    rig.line.devices = [device for device in rig.line.devices if device.id != 4]


def interrupt(port: WatchedPort, *times: float, number: int = signal.SIGINT) -> None:
    """Have this process get a signal at some times of the run [s]."""
    port.agenda = [(port.now() + time, lambda: os.kill(os.getpid(), number)) for time in times]
