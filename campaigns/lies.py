"""What a hostile line does to answers on their way: late, swapped, repeated, zeroed, re-signed, echoed, wrong id, junk.

Protocol 2.0 has no sequence number and its CRC no key, so all of these arrive whole and with a right CRC: as a USB hub
that hands over late, an adapter that returns what is sent, two masters, or a device gone mad would make them. Each
answer is struck with a probability, between two times, by a generator of its own: a run is a function of its seed.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from sinew.emulator.faults import Arrivals
from sinew.emulator.line import Line
from sinew.hardware.codec import HEADER, Decoder, Status, encode

LieKind = Literal["late", "swapped", "repeated", "zeroed", "re-signed", "echoed", "wrong id", "junk"]
LIE_KINDS: tuple[LieKind, ...] = get_args(LieKind)

FALSE_KINDS = ("zeroed", "re-signed", "wrong id")
"""Kinds whose values may be false and yet could be true, which nobody can tell: of these only the impossible count."""

_LATEST_S = 0.02  # four cycles
_STRANGERS = (0, 42, 252)
_MOST_JUNK = 24


@dataclass(frozen=True, slots=True)
class Lies:
    """kind: of them. share: of the answers that are struck. start, stop: from when to when [s]. seed: of the chance."""

    kind: LieKind
    share: float
    start: float
    stop: float
    seed: int

    def __str__(self) -> str:
        return f"{self.kind} {100 * self.share:.3g} % @{self.start:.2f}-{self.stop:.2f}"


class HostileLine:
    """Strikes a line's answers. lies: how. struck: how often it has."""

    def __init__(self, lies: Lies, line: Line) -> None:
        self.lies, self.struck = lies, 0
        self._chance = np.random.default_rng(lies.seed)
        self._ids = [device.id for device in line.devices]
        self._before: dict[tuple[int, int], bytes] = {}
        self._kept: bytes = b""
        self._line = line
        line.disturb_up = self._up
        line.disturb_down = self._down

    def _is_on(self, now: float) -> bool:
        return self.lies.start <= now < self.lies.stop

    def _down(self, at: float, data: bytes) -> Arrivals:
        self._line.echoes = self.lies.kind == "echoed" and self._is_on(at)
        return [(at, data)]

    def _up(self, at: float, data: bytes) -> Arrivals:
        kept, self._kept = self._kept, b""
        packet = _status(data)
        key = (data[4], len(data)) if len(data) > 4 else (-1, 0)
        before = self._before.get(key, data)
        if packet is not None:
            self._before[key] = data
        after: Arrivals = [(at, kept)] if kept else []
        if not self._is_on(at) or self._chance.random() >= self.lies.share:
            return [(at, data), *after]
        self.struck += 1
        match self.lies.kind:
            case "late":
                return [(at + float(self._chance.uniform(2e-4, _LATEST_S)), data), *after]
            case "swapped":
                self._kept = data
                return after
            case "repeated":
                return [(at, before), *after]
            case "junk":
                return [(at, self._junk() + data), *after]
            case "zeroed" | "re-signed" | "wrong id" if packet is not None:
                return [(at, encode(self._altered(packet))), *after]
        return [(at, data), *after]

    def _altered(self, packet: Status) -> Status:
        chance, params = self._chance, bytearray(packet.params)
        if self.lies.kind == "wrong id":
            others = [device for device in (*self._ids, *_STRANGERS) if device != packet.id]
            return Status(int(chance.choice(others)), packet.error, packet.params)
        if not params:
            return packet
        if self.lies.kind == "zeroed":
            begin, stop = sorted(chance.integers(0, len(params) + 1, 2).tolist())
            if chance.random() < 0.5:
                begin, stop = 0, len(params)
            params[begin:stop] = bytes(stop - begin)
        else:
            for _ in range(int(chance.integers(1, 4))):
                at, bit = divmod(int(chance.integers(8 * len(params))), 8)
                params[at] ^= 1 << bit
        return Status(packet.id, packet.error, bytes(params))

    def _junk(self) -> bytes:
        """Return bytes that are no packet: noise, or a header with what may look like the beginning of one."""
        noise = self._chance.bytes(int(self._chance.integers(1, _MOST_JUNK)))
        return noise if self._chance.random() < 0.5 else HEADER[: int(self._chance.integers(1, 5))] + noise


def _status(data: bytes) -> Status | None:
    packets = Decoder().feed(data)
    return packets[0] if len(packets) == 1 and isinstance(packets[0], Status) else None
