"""The OpenCR's sketch, run on this computer upon what ROBOTIS's core does for it."""

import subprocess
from pathlib import Path

import pytest
from tests.firmware.built import built
from tests.firmware.parties import NODE, packets_of
from tools.build_firmware import build_sketch

from sinew.hardware import codec as ask
from sinew.hardware.codec import Instruction, Packet, encode

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def sketch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(build_sketch, tmp_path_factory.mktemp("sketch"), "g++")


def run(sketch: Path, *orders: str) -> list[list[str]]:
    """Return what happens, a line's words each."""
    done = subprocess.run([sketch], input="\n".join(orders), capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return [line.split() for line in done.stdout.splitlines()]


def hears(instruction: Instruction, where: str = "hear") -> str:
    return f"{where} {encode(instruction).hex()}"


def answers(said: list[list[str]], where: str) -> list[Packet]:
    return packets_of(b"".join(bytes.fromhex(words[1]) for words in said if words[0] == where))


def test_it_answers_on_the_line_and_on_usb(sketch: Path) -> None:
    said = run(sketch, "pass 10", hears(ask.ping(NODE)), "pass 10", hears(ask.ping(NODE), "usb"), "pass 10")
    assert (len(answers(said, "line")), len(answers(said, "usb"))) == (1, 1)


def test_what_was_heard_before_an_error_of_the_line_is_not_heard_again(sketch: Path) -> None:
    # Once round the ring up to the write, which lies there still: the core restarts the ring from its first place.
    ping, write = ask.ping(NODE), ask.write(NODE, 50, b"\x33")
    round_to_write = f"hear {bytes(1024 - len(encode(write))).hex()}"
    said = run(sketch, "pass 10", hears(ping), hears(write), round_to_write, "error", "pass 10")
    assert len(answers(said, "line")) == 2


def test_a_receiver_that_has_stopped_lets_the_watchdog_run_out(sketch: Path) -> None:
    said = run(sketch, "pass 5000", "stop", "pass 5000")
    assert [words for words in said if words == ["reset"]] == [["reset"]]


def test_a_usb_port_that_nobody_reads_does_not_hold_the_loop_up(sketch: Path) -> None:
    said = run(sketch, "pass 10", "full", hears(ask.ping(NODE), "usb"), "pass 10")
    assert int(said[-1][1]) < 1000  # µs; the core waits 100 ms for room


def test_the_board_does_not_feed_the_line_unless_it_is_built_to(sketch: Path) -> None:
    assert [words for words in run(sketch) if words[0] == "feeds"] == [["feeds", "0"]]
