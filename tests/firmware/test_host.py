"""The firmware on this computer: what only it has, or what only virtual time shows."""

import json
import random
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.firmware.parties import NODE, EmulatedNode, HostNode, get, statuses
from tools.build_firmware import build_fuzz

from sinew.hardware import codec as ask
from sinew.hardware.codec import Instruction, Status, encode
from sinew.hardware.registers import OPENCR_NODE

pytestmark = pytest.mark.slow


@pytest.fixture
def node(host_program: Path) -> Iterator[HostNode]:
    party = HostNode(host_program)
    yield party
    party.close()


def clock_and_samples(node: HostNode) -> tuple[int, int]:
    (answer,) = statuses(node.exchange(ask.read(NODE, OPENCR_NODE["clock"].address, 8)))
    return int.from_bytes(answer.params[:4], "little"), int.from_bytes(answer.params[4:], "little")


@pytest.mark.parametrize(("chip", "delay", "period"), [(0x71, 5900, 1000), (0xE0, 3109, 889)])
def test_either_chip_is_found_and_read_at_its_own_rate(host_program: Path, chip: int, delay: int, period: int) -> None:
    node = HostNode(host_program, "--chip", f"{chip:x}")
    told = [get(node, name) for name in ("who_am_i", "filter_delay", "sample_period", "gyro_y", "acceleration_x")]
    assert told == [chip, delay, period, 253, 16_384]
    node.close()


def test_without_a_chip_every_answer_raises_the_alert(host_program: Path) -> None:
    node = HostNode(host_program, "--chip", "12")
    assert statuses(node.exchange(ask.read(NODE, 70, 2))) == [Status(NODE, 0x80, b"\x08\x00")]
    node.close()


def test_a_chip_that_stops_raises_the_alert_until_it_goes_on(node: HostNode) -> None:
    node.node.freeze(True)
    node.rest(0.1)
    stopped = statuses(node.exchange(ask.read(NODE, 70, 1)))
    node.node.freeze(False)
    node.rest(0.1)
    assert stopped + statuses(node.exchange(ask.read(NODE, 70, 1))) == [
        Status(NODE, 0x80, b"\x08"),
        Status(NODE, 0, b"\0"),
    ]


def test_samples_that_the_board_did_not_read_are_counted(node: HostNode) -> None:
    before = get(node, "samples") + get(node, "lost_samples")
    clock = get(node, "clock")
    node.node.keep_busy(10_300)
    node.time += 10.3e-3
    node.rest(0.1)
    lost = get(node, "lost_samples")
    passed = (get(node, "clock") - clock) / 1000
    assert lost in (9, 10)
    assert get(node, "samples") + lost - before == pytest.approx(passed, abs=200)  # seven reads of 50 ms apart


def test_a_sample_that_waits_for_the_board_is_not_counted_as_lost(node: HostNode) -> None:
    # Held up for less than a period the board finds at most one sample waiting, and takes it before the next.
    chance = random.Random(3)
    started, before = clock_and_samples(node)
    for _ in range(2_000):
        node.rest(chance.uniform(0.5e-3, 3e-3))
        held_us = chance.randrange(950)
        node.node.keep_busy(held_us)
        node.time += held_us * 1e-6
    node.rest(5e-3)
    ended, after = clock_and_samples(node)
    assert after - before == pytest.approx((ended - started) / 1000, abs=1)
    assert get(node, "lost_samples") == 0


def test_what_is_kept_outlives_a_loss_of_power(node: HostNode) -> None:
    node.exchange(ask.write(NODE, 7, b"\x0c"))
    node.node.cut_power()
    node.rest(0.2)
    assert [status.id for status in statuses(node.exchange(ask.ping(12)))] == [12]


def test_the_microseconds_wrap_at_32_bits(node: HostNode) -> None:
    node.rest(2**32 * 1e-6 - node.time - 0.5)
    before = get(node, "clock")
    node.rest(1.0)
    assert before > 2**32 - 500_001
    assert get(node, "clock") < 1_000_000
    assert get(node, "lost_samples") == 0


def test_a_master_that_goes_on_gets_the_answer_to_its_newest_question(node: HostNode) -> None:
    node.exchange(ask.write(NODE, 9, b"\xfa"))
    both = encode(ask.read(NODE, 50, 1)) + encode(ask.ping(NODE))
    assert [len(status.params) for status in statuses(node.exchange(both))] == [3]


def test_the_firmware_answers_as_the_emulator_does_to_random_instructions(node: HostNode) -> None:
    chance, emulated = random.Random(11), EmulatedNode()
    codes = [ask.PING, ask.READ, ask.WRITE, ask.REG_WRITE, ask.ACTION, ask.FACTORY_RESET, 0x10, 0x82, 0x83, 0x8A, 0x92]
    live = range(OPENCR_NODE["sample_time"].address, OPENCR_NODE["lost_samples"].stop)
    told = {OPENCR_NODE[name].address for name in ("firmware_version", "filter_delay", "sample_period", "who_am_i")}
    for turn in range(600):
        code = chance.choice([*codes, 0x93, 0x9A])
        address = chance.choice([0, 7, 8, 9, 12, 32, 44, 50, 68, 69, 76, chance.randrange(80)])
        length = chance.randrange(1, 6)
        span = bytes((address, 0, length, 0))
        if not {address + at for at in range(length)}.isdisjoint({*live, *told}):
            continue
        data = bytes(chance.choice([0, 1, 2, 200, 0xFD, 0xFF]) for _ in range(length))
        if address <= 8 < address + length or (address <= 7 < address + length):
            data = bytes(length)[: 7 - address] + bytes((NODE, 3, 0))[: length - max(0, 7 - address)]
        params = {
            ask.READ: span,
            ask.WRITE: span[:2] + data,
            ask.REG_WRITE: span[:2] + data,
            ask.FACTORY_RESET: bytes((chance.choice([0, 3, 7]),)),
            0x82: span + bytes((NODE,)),
            0x8A: span + bytes((NODE,)),
            0x83: span + bytes((NODE,)) + data,
            0x92: bytes((NODE,)) + span,
            0x9A: bytes((NODE,)) + span,
            0x93: bytes((NODE,)) + span + data,
        }.get(code, b"")
        if chance.random() < 0.15:
            params = params[: chance.randrange(len(params) + 1)]
        instruction = Instruction(NODE if code < 0x80 else ask.BROADCAST, code, params)
        if code == ask.PING:
            continue
        assert node.exchange(instruction) == emulated.exchange(instruction), (turn, instruction)


def test_twenty_thousand_fuzzed_streams_leave_it_answering(tmp_path: Path) -> None:
    done = subprocess.run([build_fuzz(tmp_path), "20000", "7"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["streams"] == 20_000
