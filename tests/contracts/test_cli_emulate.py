"""`sinew emulate`: what it says when it is ready, how it ends, what it tells afterwards, and how it refuses."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from tests import patience
from tests.contracts.commands import command_lines, refused
from tests.contracts.virtual_run import spoken
from tests.patience import comes, communicate

from sinew.apps.cli import main
from sinew.emulator.faults import FAULT_KINDS
from sinew.hardware.bus import Bus, BusTiming, MonotonicClock
from sinew.hardware.ports import SerialPort
from sinew.hardware.registers import XH430_W350

SINEW = Path(sys.executable).with_name("sinew")
PATIENCE = 60.0  # s


@contextmanager
def started(*options: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Give the process and the first line it says; whatever happens, it is over at the end."""
    command = [SINEW, "emulate", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert comes(process.stdout, PATIENCE)
            yield process, process.stdout.readline()
        finally:
            process.kill()


def finished(*options: str) -> subprocess.CompletedProcess[str]:
    return patience.finished([SINEW, "emulate", *options], PATIENCE)


def bus(link: Path) -> Bus:
    clock = MonotonicClock()
    # The emulator shares this computer with other tests: patience costs nothing where an answer comes.
    return Bus(SerialPort(str(link), 1_000_000, clock), clock, BusTiming(latency=0.5))


@pytest.fixture
def link(tmp_path: Path) -> Path:
    return tmp_path / "bench"


@dataclass(frozen=True)
class Served:
    """What one emulator said and did from its first line until a signal ended it.

    answered: devices that answered a ping. second, refusal: status and words of another one on its link. left: whether
    the link was there behind it. ended: its status and both of its streams. truth: the file that it left.
    """

    link: Path
    line: str
    answered: list[int]
    second: int
    refusal: str
    ended: tuple[int, str, str]
    left: bool
    truth: dict[str, Any]


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Served:
    folder = tmp_path_factory.mktemp("served")
    link, truth = folder / "bench", folder / "truth.json"
    options = ("--link", str(link), "--seed", "7", "--fault", "unplug@600", "--truth", str(truth))
    with started(*options) as (process, line):
        master = bus(link)
        answered = [device for device in (1, 2, 3, 4, 5, 200) if master.ping(device).ok]
        for device in (2, 5):
            assert master.write(device, XH430_W350["torque_enable"].address, b"\1").ok
        master.close()
        second, _, refusal = spoken("emulate", "--link", str(link))
        process.send_signal(signal.SIGTERM)
        out, err = communicate(process, PATIENCE)
    told = json.loads(truth.read_text())
    return Served(link, line, answered, second, refusal, (process.returncode, out, err), link.is_symlink(), told)


TRUTH = """rig seed time_s clock_s_at_zero slipped_s lost_bytes motors stopped in_safe_state frozen_since_s torsion_deg
tilt_deg tension_n pretension_mm instructions faults"""


def test_it_serves_alone_until_a_signal_ends_it_and_leaves_the_truth(served: Served) -> None:
    words = (str(served.link), "rig paper", "1000000 baud", "seed 7", "unplug@600", "Ctrl-C")
    assert [word for word in words if word not in served.line] == []
    assert served.answered == [1, 2, 3, 4, 5, 200]
    assert (served.second, "is another emulator running" in served.refusal) == (2, True)
    assert (served.ended, served.left) == ((0, "", ""), False)
    assert [motor["id"] for motor in served.truth["motors"] if motor["torque"]] == [2, 5]
    assert " ".join(served.truth) == TRUTH.replace("\n", " ")


def test_its_line_as_json_has_the_keys_of_the_reference(link: Path) -> None:
    with started("--link", str(link), "--json") as (_, line):
        said = json.loads(line)
    assert " ".join(said) == "link terminal rig baud devices seed tilt_deg slack_mm faults clock"


def test_it_ends_after_the_emulated_time_asked_for_and_its_truth_lists_what_the_faults_did(
    link: Path, tmp_path: Path
) -> None:
    truth = tmp_path / "truth.json"
    fault = ("--fault", "imu-freeze@0.5-0.75")
    finished("--link", str(link), "--for", "1", *fault, "--truth", str(truth))
    told = json.loads(truth.read_text())
    assert 1.0 <= told["time_s"] < 1.5
    assert [(each["time_s"], each["what"]) for each in told["faults"]] == [(0.5, "begins"), (0.75, "ends")]


def test_a_bench_that_ends_by_itself_says_so(link: Path) -> None:
    done = finished("--link", str(link), "--for", "0.1")
    assert f"{link} ended after 0.1 s, as --for says" in done.stderr


@pytest.mark.slow
def test_a_joint_is_found_with_the_tilt_and_the_slack_asked_for(link: Path, tmp_path: Path) -> None:
    truth = tmp_path / "truth.json"
    done = finished(
        *("--link", str(link), "--tilt", "3", "--slack", "1,2,0.5,1", "--for", "0.1", "--json", "--truth", str(truth))
    )
    told = json.loads(truth.read_text())
    assert json.loads(done.stdout)["slack_mm"] == pytest.approx([1, 2, 0.5, 1])
    assert sum(angle**2 for angle in told["tilt_deg"]) ** 0.5 == pytest.approx(3, abs=0.01)


@pytest.mark.parametrize("kind", FAULT_KINDS)
def test_the_help_names_every_kind_of_fault(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    main(["emulate", "--help"])
    assert kind in capsys.readouterr().out.replace("-\n  ", "-")


@command_lines("""
    --fault meteor => unknown fault 'meteor'
    --fault overheat:motor=9 => no motor 9
    --slack 1,2,3 => expected 4 numbers
    --slack a,b,c,d => 4 numbers from 0 to 50 mm
    --baud 12345 => 12345 baud
    --rig papre => did you mean paper
    --truth /proc/truth.json => cannot write into /proc
""")
def test_a_wrong_command_line_is_refused_in_one_line(
    arguments: tuple[str, ...], sentence: str, link: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sentence in refused(capsys, "emulate", "--link", link, *arguments)
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_place_of_the_link_is_refused_and_kept(link: Path, capsys: pytest.CaptureFixture[str]) -> None:
    link.write_text("kept")
    status = main(["emulate", "--link", str(link)])
    assert (status, "is no link" in capsys.readouterr().err, link.read_text()) == (2, True, "kept")
