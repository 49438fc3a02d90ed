"""The codec against rustypot, a master in Rust: it opens a pseudo-terminal, and our side of the line answers."""

import os
import select
import threading
import tty
from collections.abc import Iterator
from typing import Any

import pytest
from tests.unit.hardware_line import Line, ManualClock, Slave

rustypot: Any = pytest.importorskip("rustypot", reason="rustypot is not installed")


def serve(far: int, line: Line, stop: threading.Event) -> None:
    """Answer what comes in at the far end until told to stop."""
    while not stop.is_set():
        if select.select([far], [], [], 0.02)[0]:
            line.write(os.read(far, 4096))
            while answer := line.read(line.clock.time + 1):
                os.write(far, answer)


@pytest.fixture
def line() -> Iterator[tuple[Any, Line]]:
    """Return rustypot as master, and the line with devices 1 to 3 at its other end."""
    far, near = os.openpty()
    tty.setraw(near)
    devices = Line(ManualClock(), Slave(1), Slave(2), Slave(3))
    stop = threading.Event()
    thread = threading.Thread(target=serve, args=(far, devices, stop))
    thread.start()
    try:
        yield rustypot.Xl430PyController(os.ttyname(near), 1_000_000, 2.0), devices
    finally:
        stop.set()
        thread.join()
        os.close(near)
        os.close(far)


def test_rustypot_pings_a_device(line: tuple[Any, Line]) -> None:
    assert line[0].ping(2)


@pytest.mark.parametrize("data", [b"\1\2\3\4", b"\xff\xff\xfd\x00", b"\xff\xff\xfd\xfd", b"\xff\xff\xff\xfd"])
def test_rustypot_reads_what_a_device_holds_stuffed_or_not(line: tuple[Any, Line], data: bytes) -> None:
    line[1].slaves[1].memory[132:136] = data
    assert bytes(line[0].read_raw_data(1, 132, 4)) == data


@pytest.mark.parametrize("data", [b"\1\2\3\4", b"\xff\xff\xfd\x00", b"\xff\xff\xfd\xfd", b"\xff\xff\xff\xfd"])
def test_what_rustypot_writes_arrives_stuffed_or_not(line: tuple[Any, Line], data: bytes) -> None:
    line[0].write_raw_data(1, 116, list(data))
    assert bytes(line[1].slaves[1].memory[116:120]) == data


def test_rustypot_reads_a_group(line: tuple[Any, Line]) -> None:
    blocks = line[0].sync_read_raw_data([1, 2, 3], 126, 10)
    assert [bytes(block) for block in blocks] == [bytes(range(126, 136))] * 3


def test_rustypot_writes_to_a_group(line: tuple[Any, Line]) -> None:
    master, devices = line
    master.sync_write_raw_data([1, 2, 3], 116, [[device, 0, 0, 0] for device in (1, 2, 3)])
    master.ping(1)  # nobody answers a sync write; what was sent before a ping has arrived when it is answered
    assert [devices.slaves[device].memory[116] for device in (1, 2, 3)] == [1, 2, 3]


def test_rustypot_sees_the_alert(line: tuple[Any, Line]) -> None:
    master, devices = line
    devices.slaves[1].error = 0x80
    assert 0x80 in master.read_raw_data_with_error(1, 132, 4)
