"""The firmware on one line with the emulator's motors, under Sinew's own bus, in virtual time."""

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from tests.firmware.parties import Burst, NodeProcess
from tests.unit.emulator_stand_in import Bench

from sinew.emulator.line import Line
from sinew.hardware.codec import Read
from sinew.hardware.imu import Imu

pytestmark = pytest.mark.slow

MOTORS = (1, 2, 3, 4, 5)
NODE = 200
PATTERN = b"\xff\xff\xfd"
_PIECE = 4  # bytes that it is handed at once; less than what it waits for before it takes another for silent


class _OnLine:
    """Puts the firmware on an emulated line: it hears all bytes, and what it says is heard by all."""

    def __init__(self, line: Line, node: NodeProcess) -> None:
        self._line, self._node = line, node
        self._put, self._is_speaking = line._put, False
        line._put = self._put_and_tell  # type: ignore[method-assign]
        self._go_on([], 0.0)

    def _put_and_tell(self, start: float, data: bytes) -> Any:
        burst = self._put(start, data)
        if not self._is_speaking:
            byte = 10 / self._line.host_baud
            for at in range(0, len(data), _PIECE):
                stop = start + min(at + _PIECE, len(data)) * byte
                self._line._plan(stop, partial(self._hear, burst, at))
        return burst

    def _hear(self, burst: Any, at: int, now: float) -> None:
        start = burst.start + at * 10 / self._line.host_baud
        self._go_on(self._node.hear(start, bytes(burst.data[at : at + _PIECE]), self._line.host_baud), now)

    def _go_on(self, bursts: list[Burst], now: float) -> None:
        self._is_speaking = True
        for burst in bursts:
            self._line._speak(burst.data, burst.start)
        self._is_speaking = False
        if self._node.due < math.inf:  # it has something to do: to answer, or to wait no longer
            self._line._plan(max(now + 1e-6, self._node.due), self._wake)

    def _wake(self, now: float) -> None:
        if now >= self._node.due:
            self._go_on(self._node.advance(now), now)


@pytest.fixture
def bench(host_program: Path) -> Iterator[Bench]:
    """Return a bench whose sensor is the firmware."""
    bench = Bench(return_delay=0)
    node = NodeProcess(host_program)
    bench.rig.line.devices.remove(bench.rig.imu)
    _OnLine(bench.rig.line, node)
    bench.wait(0.3)
    yield bench
    node.close()


def asked(imu: Imu) -> list[Read]:
    return [*(Read(motor, 126, 10) for motor in MOTORS), imu.ask]


def test_five_motors_and_the_node_answer_every_cycle(bench: Bench) -> None:
    imu = Imu(bench.bus, NODE)
    ages = []
    for _ in range(100):
        replies = bench.bus.bulk_read(asked(imu), retries=0)
        assert all(reply.ok for reply in replies.values()), replies
        reading = imu.decode(replies[NODE], bench.bus.left_wire)
        assert reading is not None
        ages.append(bench.port.now() - reading.time)
        bench.wait(3e-3)
    assert bench.bus.statistics.strays == 0
    assert max(ages) < 5e-3  # a cycle of 1.6 ms on the wire and a sample's period of 1 ms


@pytest.mark.parametrize("silent", [[5], [1], [2, 3], [1, 2, 3, 4, 5]])
def test_the_node_answers_in_the_cycle_in_which_motors_are_silent(bench: Bench, silent: list[int]) -> None:
    for motor in silent:
        bench.rig.motors[motor].registers["id"] = 100 + motor
    imu = Imu(bench.bus, NODE)
    replies = bench.bus.bulk_read(asked(imu), retries=0)
    # A motor waits for the answer before its own, the node only for that one's time.
    assert [device for device, reply in replies.items() if reply.ok] == [*(m for m in MOTORS if m < min(silent)), NODE]


def test_the_node_waits_for_motors_whose_answers_look_like_headers(bench: Bench) -> None:
    for motor in MOTORS:
        bench.rig.motors[motor].registers.memory[84:94] = PATTERN + PATTERN + PATTERN + b"\xfd"
    replies = bench.bus.bulk_read([*(Read(motor, 84, 10) for motor in MOTORS), Read(NODE, 32, 28)], retries=0)
    assert all(reply.ok for reply in replies.values())
    assert bench.bus.statistics.crc_errors == 0
