"""Port and clock of an emulated bench in virtual time."""

import pytest
from tests.unit.emulator_stand_in import Bench

from sinew.emulator.bench import VirtualPort
from sinew.hardware import codec as ask
from sinew.hardware.codec import encode
from sinew.measure.errors import PortError

BYTE = 10e-6


def test_every_call_keeps_the_host_busy() -> None:
    bench = Bench()
    port = VirtualPort(bench.rig, host_cost=1e-3)
    port.write(b"")
    port.read(0.0)
    assert port.now() == pytest.approx(2e-3)


def test_a_read_returns_when_the_answer_has_come() -> None:
    bench = Bench(return_delay=0)
    port = VirtualPort(bench.rig, host_cost=0.0)
    port.write(encode(ask.ping(1)))
    data = port.read(1.0)
    assert (len(data), port.now()) == (14, pytest.approx(24 * BYTE))


def test_a_read_of_a_silent_line_takes_until_its_deadline() -> None:
    port = Bench().port
    assert port.read(0.25) == b""
    assert port.now() == 0.25


def test_an_unplugged_port_is_gone() -> None:
    bench = Bench()
    bench.rig.unplugged = True
    with pytest.raises(PortError, match="plug it in"):
        bench.port.write(b"x")
    with pytest.raises(PortError, match="plug it in"):
        bench.port.read(1.0)


def test_bytes_on_their_way_are_lost_when_the_port_is_unplugged() -> None:
    bench = Bench()
    bench.port.write(encode(ask.ping(1)))
    bench.rig.unplugged = True
    bench.wait(0.1)
    bench.rig.unplugged = False
    assert bench.port.read(bench.port.now() + 0.1) == b""
