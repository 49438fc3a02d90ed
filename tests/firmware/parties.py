"""An IMU node on a line, three ways: Sinew's emulator, the firmware on this computer, the firmware in QEMU.

A party is asked by instructions, beside which other devices of the line may answer; it gives what a master hears.
"""

import math
import select
import socket
import struct
import subprocess
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from tests.unit.emulator_stand_in import StandIn, paper_rig

from sinew.emulator.device import ControlTable, Device, ImuNode
from sinew.emulator.line import Line
from sinew.hardware import codec as ask
from sinew.hardware.codec import (
    BROADCAST,
    HEADER,
    Decoder,
    FastStatus,
    Instruction,
    Packet,
    Status,
    crc16,
    encode,
    reads_of,
)
from sinew.hardware.registers import OPENCR_NODE, RegisterTable

NODE = 200
BAUD = 1_000_000
GYRO_COUNTS = (-1, 253, 300)  # FF FF FD 00: rates that need stuffing
FORCE_COUNTS = (16_384, -1000, 2000)
Others = Mapping[int, bytes | None]
"""What the other devices of the line answer to a read, by id; None: nothing."""


def bytes_of(wire: Instruction | bytes) -> bytes:
    return encode(wire) if isinstance(wire, Instruction) else wire


def answers_before(instruction: Instruction, others: Others, node: int) -> bytes:
    """Return what is on the line before the node's turn."""
    fast = instruction.code in (ask.FAST_SYNC_READ, ask.FAST_BULK_READ)
    reads = reads_of(instruction) or ()
    length = 1 + sum(read.length + 4 for read in reads)
    said = HEADER + bytes((BROADCAST, length & 0xFF, length >> 8, 0x55)) if fast and reads[0].id != node else b""
    for read in reads:
        data = others.get(read.id)
        if read.id == node:
            break
        if data is None and fast:
            return said if len(said) > 8 else b""
        if data is None:
            continue
        if not fast:
            said += encode(Status(read.id, 0, data))
            continue
        said += bytes((0, read.id)) + data
        said += crc16(said).to_bytes(2, "little")
    return said


def packets_of(data: bytes) -> list[Packet]:
    return Decoder().feed(data)


class _Puppet(Device):
    """Another device of the emulated line, which answers what it is told."""

    fast_reads_from = 0
    is_node = True

    def __init__(self, device: int, data: bytes | None, baud: int) -> None:
        super().__init__(ControlTable(RegisterTable("puppet", 1, OPENCR_NODE.rows)), 1, device, baud)
        self.data = data

    def hears(self, now: float) -> bool:
        return self.data is not None

    def refresh(self, address: int, length: int, now: float) -> None: ...

    def answer(self, address: int, length: int, now: float) -> Status | None:
        return Status(self.id, 0, self.data or b"")


class EmulatedNode:
    """The emulator's node, in virtual time."""

    knows_time = True

    def __init__(self) -> None:
        imu = paper_rig().imu
        quiet = ("gyro_noise", "gyro_bias", "accelerometer_noise")
        silent = {name: getattr(imu, name).model_copy(update={"value": 0.0}) for name in quiet}
        spec = imu.model_copy(update={**silent, "dead_band": 0})
        plant = StandIn()
        plant.gyro = cast(Any, tuple(count * imu.gyro_lsb.value for count in GYRO_COUNTS))
        plant.acceleration = cast(Any, tuple(count * imu.accelerometer_lsb.value for count in FORCE_COUNTS))
        self.plant = plant
        self.imu = ImuNode(spec, plant, np.random.default_rng(0), ppm=0.0)
        self.baud = BAUD
        self.line = Line([self.imu])
        self._spoke = self._heard = 0.0
        speak = self.line._speak

        def note(data: bytes, start: float) -> float:
            self._spoke = start
            return speak(data, start)

        self.line._speak = note  # type: ignore[method-assign]
        self.rest(0.1)

    def exchange(
        self, wire: Instruction | bytes, others: Others | None = None, *, answers: bool = True
    ) -> list[Packet]:
        puppets = [_Puppet(device, data, self.baud) for device, data in (others or {}).items()]
        self.line.devices = [*puppets, self.imu]
        self.line.host_baud = self.baud
        data = bytes_of(wire)
        self.line.receive(data, self.plant.time)
        self._heard = self.imu.clock(self.plant.time + len(data) * 10 / self.baud)
        self.rest(0.05)
        return packets_of(self.line.transmit(self.plant.time))

    def rest(self, seconds: float) -> None:
        until = self.plant.time + seconds
        while (due := min(self.imu.due, self.line.due)) <= until:
            self.plant.advance(due)
            self.imu.advance(due)
            self.line.work(due)
        self.plant.advance(until)

    @property
    def latched(self) -> tuple[float, float]:
        return self.imu.clock(self._spoke), self._heard

    def close(self) -> None: ...


@dataclass(frozen=True)
class Burst:
    """Bytes that the node puts on the line without a pause. start: by its own clock [s]."""

    start: float
    data: bytes


_NEVER = 2**64 - 1


class NodeProcess:
    """The firmware at the other end of a pipe, in virtual time [s]. baud: that it listens at [1/s]. due: when it has
    something to do on the line [s]."""

    def __init__(self, program: Path, *options: str) -> None:
        self.process = subprocess.Popen(
            [program, "line", *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        self.baud, self.due = BAUD, 0.0

    def hear(self, start: float, data: bytes, baud: int) -> list[Burst]:
        """Return what it says by when the last of these bytes has come, which began at a time [s]."""
        return self._ask(b"B" + struct.pack("<QQI", round(start * 1e9), round(1e10 / baud), len(data)) + data)

    def advance(self, until: float) -> list[Burst]:
        """Return what it says by a time [s]."""
        return self._ask(b"A" + struct.pack("<Q", round(until * 1e9)))

    def freeze(self, frozen: bool) -> None:
        self._ask(b"F" + bytes((frozen,)))

    def cut_power(self) -> None:
        """Take the power away, and give it back."""
        self._ask(b"P")

    def keep_busy(self, microseconds: int) -> None:
        """Let it do nothing else for so long."""
        self._ask(b"D" + struct.pack("<I", microseconds))

    def close(self) -> None:
        """End it; raises AssertionError where the sanitizers found something."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        assert self.process.stdout is not None
        assert self.process.stderr is not None
        self.process.stdout.close()
        said = self.process.stderr.read().decode()
        self.process.stderr.close()
        assert (self.process.wait(20), said) == (0, "")

    def _ask(self, what: bytes) -> list[Burst]:
        assert self.process.stdin is not None
        self.process.stdin.write(what)
        self.process.stdin.flush()
        self.baud, due, count = struct.unpack("<IQI", self._take(16))
        self.due = math.inf if due == _NEVER else due * 1e-9
        bursts = []
        for _ in range(count):
            start, size = struct.unpack("<QI", self._take(12))
            bursts.append(Burst(start * 1e-9, self._take(size)))
        return bursts

    def _take(self, size: int) -> bytes:
        assert self.process.stdout is not None
        data = self.process.stdout.read(size)
        if len(data) < size:
            assert self.process.stderr is not None
            raise AssertionError(f"the firmware has ended: {self.process.stderr.read().decode()}")
        return data


class HostNode:
    """The firmware on this computer, with sanitizers, in virtual time."""

    knows_time = True

    def __init__(self, program: Path, *options: str) -> None:
        self.node = NodeProcess(program, *options)
        self.baud, self.id = BAUD, NODE
        self.time = 0.0
        self._latched = (0.0, 0.0)
        self.rest(0.25)

    def exchange(
        self, wire: Instruction | bytes, others: Others | None = None, *, answers: bool = True
    ) -> list[Packet]:
        data = bytes_of(wire)
        heard = [*self._say(data)]
        instructed = self.time
        if others and isinstance(wire, Instruction):
            before = answers_before(wire, others, self.id)
            start = self.time
            heard += [Burst(start, before), *self._say(before)] if before else []
        heard += self._until(self.time + 0.05)
        for burst in heard:
            self._latched = burst.start, instructed
        return packets_of(b"".join(burst.data for burst in sorted(heard, key=lambda burst: burst.start)))

    def rest(self, seconds: float) -> None:
        assert not self._until(self.time + seconds)

    @property
    def latched(self) -> tuple[float, float]:
        return self._latched

    def close(self) -> None:
        self.node.close()

    def _say(self, data: bytes) -> list[Burst]:
        start, self.time = self.time, self.time + len(data) * 10 / self.baud
        if self.node.baud != self.baud:
            return []
        return self.node.hear(start, data, self.baud)

    def _until(self, time: float) -> list[Burst]:
        self.time = time
        bursts = self.node.advance(time)
        return bursts if self.node.baud == self.baud else []


class QemuNode:
    """The firmware on a Cortex-M7 in QEMU: its UART on a socket, its trace on another. Time is that of its clock."""

    knows_time = False
    _PATIENCE, _SILENCE = 20.0, 0.3  # s of this computer

    def __init__(self, image: Path, folder: Path) -> None:
        self.baud, self.id = BAUD, NODE
        ports = [folder / "uart", folder / "trace"]
        serials = [part for port in ports for part in ("-serial", f"unix:{port},server=on,wait=on")]
        command = ["qemu-system-arm", "-M", "mps2-an500", "-kernel", str(image), "-display", "none", "-monitor", "none"]
        self.process = subprocess.Popen(
            [*command, "-icount", "shift=3,sleep=off", *serials], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE
        )
        self._uart, self._trace = (self._connect(port) for port in ports)
        self._latched = (0.0, 0.0)
        self._await(b"ready\n")

    def exchange(
        self, wire: Instruction | bytes, others: Others | None = None, *, answers: bool = True
    ) -> list[Packet]:
        before = answers_before(wire, others, self.id) if others and isinstance(wire, Instruction) else b""
        self._send(bytes_of(wire) + before)
        heard = before
        stop = time.monotonic() + (self._PATIENCE if answers else self._SILENCE)
        while time.monotonic() < stop:
            said = self._listen(self._uart, stop)
            heard += said
            if answers and said and heard.startswith(HEADER) and not _is_cut_off(heard):
                break
        self._read_trace()
        return packets_of(heard)

    def rest(self, seconds: float) -> None:
        time.sleep(seconds)

    @property
    def latched(self) -> tuple[float, float]:
        return self._latched

    def close(self) -> None:
        for end in (self._uart, self._trace):
            end.close()
        self.process.terminate()
        assert self.process.stderr is not None
        self.process.stderr.close()
        self.process.wait(20)

    def _connect(self, port: Path) -> socket.socket:
        end = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        stop = time.monotonic() + self._PATIENCE
        while True:
            try:
                end.connect(str(port))
                return end
            except OSError:
                assert time.monotonic() < stop, "QEMU does not get ready"
                time.sleep(0.02)

    def renew(self) -> None:
        """Bring the node to what it is from the factory, start it anew, and wait for its first sample."""
        self._send(encode(ask.write(BROADCAST, 7, bytes((NODE,)))))
        self._restart(Instruction(BROADCAST, ask.FACTORY_RESET, b"\1"))
        self.baud = BAUD
        stop = time.monotonic() + self._PATIENCE
        while get(self, "samples") == 0:
            assert time.monotonic() < stop, "the firmware in QEMU takes no sample"

    @property
    def line(self) -> socket.socket:
        """What the node says."""
        return self._uart

    def tell(self, packet: bytes, *, restarts: bool) -> None:
        """Have an instruction played to the node; one that it may restart of, until it has, or for two seconds."""
        self._read_trace()
        self._send(packet)
        said, stop = b"", time.monotonic() + 2.0
        while restarts and not said.endswith(b"ready\n") and time.monotonic() < stop:
            said += self._listen(self._trace, stop)

    def _send(self, data: bytes) -> None:
        """Have bytes played to the node, at its baud."""
        self._trace.sendall(struct.pack("<H", len(data)))
        self._await(b"go\n")
        self._uart.sendall(data)

    def _restart(self, instruction: Instruction) -> None:
        self._read_trace()
        self._send(encode(instruction))
        self._await(b"ready\n")

    def _await(self, word: bytes) -> None:
        said, stop = b"", time.monotonic() + self._PATIENCE
        while not said.endswith(word):
            assert time.monotonic() < stop, f"the firmware in QEMU does not say {word!r}"
            said += self._listen(self._trace, stop)

    def _listen(self, end: socket.socket, stop: float) -> bytes:
        ready = select.select([end], [], [], max(0.0, stop - time.monotonic()))[0]
        return end.recv(4096) if ready else b""

    def _read_trace(self) -> None:
        """Take the newest line of the trace: when the instruction was heard and the answer begun [µs]."""
        lines = b""
        while select.select([self._trace], [], [], 0.02)[0]:
            lines += self._trace.recv(4096)
        for line in lines.split(b"\n"):
            if len(words := line.split()) == 2:
                heard, spoke = (int(word, 16) * 1e-6 for word in words)
                self._latched = spoke, heard


def _is_cut_off(data: bytes) -> bool:
    """Return whether the last packet of what was heard is not whole."""
    decoder = Decoder()
    decoder.feed(data)
    return bool(decoder.rest)


def statuses(packets: Iterable[Packet]) -> list[Status]:
    return [packet for packet in packets if isinstance(packet, Status)]


def fast(packets: Sequence[Packet], lengths: list[int]) -> list[Status]:
    """Return the parts of the one packet that a fast read gives."""
    assert len(packets) <= 1
    return [
        part
        for packet in packets
        if isinstance(packet, FastStatus)
        for part in ask.fast_blocks(encode(packet), lengths)
    ]


AnyNode = EmulatedNode | HostNode | QemuNode
"""A node with a line to it. knows_time: whether `latched` is to be trusted, and the line's baud matters. `exchange`
returns what a master hears after an instruction, the others' answers among it; answers: whether the node is expected to
say something; where that takes the computer's time, so long it waits. latched: when the node began its last answer, by
its own clock, and when it had heard the instruction [s]."""


def get(party: AnyNode, name: str) -> int:
    """Return the count in a register of the node."""
    row = OPENCR_NODE[name]
    (answer,) = statuses(party.exchange(ask.read(getattr(party, "id", NODE), row.address, row.size)))
    assert answer.number == 0
    return int.from_bytes(answer.params, "little", signed=row.signed)
