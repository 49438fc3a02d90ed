"""`sinew run` on a real port, a pseudo-terminal: ports that cannot be had, and processes that something ends."""

import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from campaigns.same_numbers import TINY
from tests.contracts.emulated_bench import PATIENCE, SINEW, STARTS, Playing, ended, playing, rig_file, running
from tests.patience import await_end, comes, finished

from sinew.apps.cli import main
from sinew.bench.record.journal import JournalReader
from sinew.hardware.bus import MonotonicClock
from sinew.hardware.ports import SerialPort

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals and limits of Linux")


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.toml"
    path.write_text(TINY)
    return path


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Playing]:
    with playing(tmp_path) as emulator:
        yield emulator


def refused(capsys: pytest.CaptureFixture[str], plan: Path, port: str, folder: Path) -> str:
    """Return what is said; the folder must not be there before nor after."""
    capsys.readouterr()
    status = main(["run", str(plan), "--port", port, "--out", str(folder)])
    out, err = capsys.readouterr()
    assert (status, out, err.count("\n"), folder.exists()) == (2, "", 1, False)
    return err


def torques(truth: dict[str, list[dict[str, bool]]]) -> list[bool]:
    return [motor["torque"] for motor in truth["motors"]]


def test_a_port_that_another_program_has_is_refused(
    bench: Playing, plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    holder = SerialPort(bench.port, 1_000_000, MonotonicClock())
    said = refused(capsys, plan, bench.port, tmp_path / "out")
    holder.close()
    assert all(word in said for word in ("cannot open", bench.port, "no other program on it"))
    assert not any(torques(bench.truth()))


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.parametrize("state", ["hold", "release"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_run_in_the_declared_safe_state(
    bench: Playing, plan: Path, tmp_path: Path, number: signal.Signals, state: str
) -> None:
    rig = rig_file(tmp_path, limits={"safe_state": state})
    with running(bench.port, plan, tmp_path / "out", "--rig", rig) as process:
        process.send_signal(number)
        process.send_signal(number)
        status, out, err = ended(process)
    truth = bench.truth()
    assert (status, err.count("\n"), "Traceback" in err) == (1, 1, False)
    assert out.startswith("interrupted by Ctrl-C;" if number == signal.SIGINT else "terminated;")
    assert (truth["in_safe_state"], set(torques(truth))) == (True, {state == "hold"})


def close_terminal_of_a_run(command: list[str]) -> int | None:
    """Run a command in a terminal, close that when the motors pull; return the status, None if it ended before."""
    ours, theirs = os.openpty()
    in_terminal = (
        "import fcntl, os, sys, termios; os.setsid(); fcntl.ioctl(0, termios.TIOCSCTTY, 0); "
        "os.execv(sys.argv[1], sys.argv[1:])"
    )
    ends = {"stdin": theirs, "stdout": theirs, "stderr": theirs}
    with subprocess.Popen([sys.executable, "-c", in_terminal, *command], **ends) as process:
        os.close(theirs)
        shown = b""
        try:
            while b"pulled to first contact" not in shown:
                assert comes(ours, PATIENCE), "the run does not begin"
                shown += os.read(ours, 4096)
        except OSError:
            return None
        finally:
            os.close(ours)
            status = await_end(process, PATIENCE)
        return status


@pytest.mark.slow
@pytest.mark.realtime
def test_a_terminal_that_is_closed_ends_the_run_in_the_safe_state(bench: Playing, plan: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = [str(SINEW), "run", str(plan), "--port", bench.port, "--out", str(out)]
    for _ in range(STARTS):  # a pause of the computer may end a run before it pulls
        if (status := close_terminal_of_a_run(command)) is not None:
            break
        shutil.rmtree(out, ignore_errors=True)
    assert (status, any(torques(bench.truth()))) == (1, False)
    with JournalReader(out / "journal.sqlite") as journal:
        assert str(journal.events()[-1][1]).startswith("the terminal closed; release: tension let down")


@pytest.mark.slow
@pytest.mark.realtime
def test_a_disk_that_fills_up_ends_the_run_in_the_safe_state_with_a_readable_journal(
    bench: Playing, plan: Path, tmp_path: Path
) -> None:
    with running(bench.port, plan, tmp_path / "out") as process:
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (200_000, 200_000))
        status, out, err = ended(process)
    assert (status, "Traceback" in err) == (1, False)
    assert out.startswith(f"cannot write the journal {tmp_path}/out/journal.sqlite: ")
    assert "its disk has space" in out
    assert not any(torques(bench.truth()))
    with JournalReader(tmp_path / "out" / "journal.sqlite") as journal:
        assert journal.last_sample() > 100


@pytest.mark.slow
@pytest.mark.realtime
def test_a_full_disk_is_refused_and_nothing_stays_in_the_folder(bench: Playing, plan: Path, tmp_path: Path) -> None:
    limited = (
        "import os, resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000)); "
        "os.execv(sys.argv[1], sys.argv[1:])"
    )
    command = [SINEW, "run", str(plan), "--port", bench.port, "--out", str(tmp_path / "deep" / "out")]
    environment = {**os.environ, "JAX_ENABLE_COMPILATION_CACHE": "false"}  # it would warn that it cannot write either
    done = finished([sys.executable, "-c", limited, *command], PATIENCE, env=environment)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert "cannot write the journal" in done.stderr
    assert not (tmp_path / "deep").exists()
    assert not any(torques(bench.truth()))
