"""This is where the faults of an emulated bench happen, when their time has come.

Faults strike packets on either way, or do to the devices and the mechanics what a bad day does. With a seed they are
the same again, as long as the same packets are sent at the same times.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sinew.emulator.fault_spec import LINE_FAULTS, FaultSpec
from sinew.emulator.line import Line
from sinew.emulator.protection import OVERLOAD
from sinew.emulator.rig import EmulatedRig
from sinew.measure.errors import SpecError

__all__ = ["Faults", "FaultyRig", "Happening"]

_STEP = 0.05
"""How often a fault that goes on is seen to [s]."""
_OVERLOAD_TIME = 1.0
"""How long a motor bears too much load [s], as in `sinew.emulator.protection`."""

Arrivals = list[tuple[float, bytes]]


@dataclass(frozen=True, slots=True)
class Happening:
    """What a fault did. time: emulated [s]. kind: of the fault. what: it came, went, or struck once."""

    time: float
    kind: str
    what: Literal["begins", "ends", "strikes"]


class Faults:
    """Faults that happen to a bench.

    specs: which, and when. seed: of which packets are struck, and how. log: what has happened, in the order of time.
    """

    def __init__(self, specs: Sequence[FaultSpec], seed: int = 0) -> None:
        self.specs = tuple(specs)
        self.log: list[Happening] = []
        # A stream of random numbers for each: one fault more changes nothing about the others.
        self._chance = [np.random.default_rng([seed, number]) for number in range(len(self.specs))]
        self._there = [False] * len(self.specs)
        self._loaded = [0.0] * len(self.specs)
        self._acted = -math.inf
        self._nominal = math.nan

    def attach(self, rig: EmulatedRig) -> "FaultyRig":
        """Return the bench with these faults, to be used in the place of `rig` from now on.

        Raises SpecError for a motor or tendon that the bench does not have.
        """
        for spec in self.specs:
            _refuse_unknown_part(spec, rig)
        self._nominal = rig.supply
        if any(spec.kind in LINE_FAULTS for spec in self.specs):
            rig.line.disturb_down = rig.line.disturb_up = self.disturb
        return FaultyRig(rig, self)

    def next_time(self) -> float:
        """Return when `act` has something to do next [s]; infinite where it never has."""
        times = [time for spec in self.specs for time in (spec.start, spec.stop) if time > self._acted]
        if any(there and spec.kind in _LASTING for there, spec in zip(self._there, self.specs, strict=True)):
            times.append(self._acted + _STEP)
        return min(times, default=math.inf)

    def act(self, rig: EmulatedRig, now: float) -> None:
        """Let happen what happens at a time [s], to which the bench has been advanced."""
        elapsed = now - self._acted
        self._acted = now
        for number, spec in enumerate(self.specs):
            was, there = self._there[number], spec.is_there(now)
            if was and spec.kind in _LASTING:
                self._go_on(rig, number, elapsed)
            if was != there:
                self._there[number] = there
                self._note(now, spec.kind, "begins" if there else "ends")
                self._change(rig, spec, there)

    def disturb(self, now: float, data: bytes) -> Arrivals:
        """Return what arrives, and when [s], of bytes that would have arrived at `now`."""
        arrivals = [(now, data)]
        for spec, chance in zip(self.specs, self._chance, strict=True):
            strike = _STRIKES.get(spec.kind)
            if strike is None or not spec.is_there(now):
                continue
            struck: Arrivals = []
            for when, part in arrivals:
                if part and chance.random() < spec.value("p"):
                    struck += strike(when, part, spec, chance)
                    self._note(now, spec.kind, "strikes")
                else:
                    struck.append((when, part))
            arrivals = struck
        return arrivals

    def _note(self, time: float, kind: str, what: Literal["begins", "ends", "strikes"]) -> None:
        self.log.append(Happening(time, kind, what))

    def _values(self, kind: str, key: str) -> list[float]:
        """Return the values of a key of those faults of a kind that are there."""
        pairs = zip(self.specs, self._there, strict=True)
        return [spec.value(key) for spec, there in pairs if there and spec.kind == kind]

    def _change(self, rig: EmulatedRig, spec: FaultSpec, there: bool) -> None:
        """Let a fault come or go, unless another of its kind keeps it there."""
        kinds = {other.kind for other, present in zip(self.specs, self._there, strict=True) if present}
        if spec.kind == "unplug":
            rig.unplugged = "unplug" in kinds
        elif spec.kind == "brown-out":
            rig.set_supply(min(self._values("brown-out", "to"), default=self._nominal))
        elif spec.kind == "imu-freeze":
            rig.imu.frozen = "imu-freeze" in kinds
        elif spec.kind == "stuck-tendon":
            tendon = spec.value("tendon")
            rig.stick(int(tendon) - 1, tendon in self._values("stuck-tendon", "tendon"))
        elif spec.kind == "push":
            rig.push(sum(self._values("push", "torque")))
        elif spec.kind == "slip-tendon" and there:
            rig.slip(int(spec.value("tendon")) - 1, spec.value("by"))

    def _go_on(self, rig: EmulatedRig, number: int, elapsed: float) -> None:
        """Heat a motor, or load it until its protection trips."""
        spec = self.specs[number]
        motor = rig.motors[int(spec.value("motor"))]
        if spec.kind == "overheat":
            motor.protection.temperature += spec.value("rate") * elapsed
            return
        self._loaded[number] = self._loaded[number] + elapsed if motor.torque else 0.0
        if self._loaded[number] >= _OVERLOAD_TIME - _STEP / 2:
            self._loaded[number] = 0.0
            motor.fail(OVERLOAD)
            self._note(self._acted, spec.kind, "strikes")


class FaultyRig:
    """A bench to which faults happen, in the place of the bench itself.

    rig: the bench. faults: what happens to it.
    """

    def __init__(self, rig: EmulatedRig, faults: Faults) -> None:
        self.rig, self.faults = rig, faults
        self._next = faults.next_time()

    @property
    def line(self) -> Line:
        """The line that the master is on."""
        return self.rig.line

    @property
    def unplugged(self) -> bool:
        """Whether there is no way from the master to the line."""
        return self.rig.unplugged

    @property
    def time(self) -> float:
        """The time it has been advanced to [s]."""
        return self.rig.time

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes that the master begins to send at a time [s]."""
        self.advance(now)
        self.rig.receive(data, now)

    def transmit(self, now: float) -> bytes:
        """Return the bytes that have come to the master by a time [s]."""
        self.advance(now)
        return self.rig.transmit(now)

    def next_event(self) -> float:
        """Return when something happens next [s]: on the line, or a fault; infinite: nothing is foreseen."""
        return min(self._next, self.rig.next_event())

    def advance(self, now: float) -> None:
        """Let everything happen that is due by a time [s]; one that has passed changes nothing."""
        while self._next <= now:
            self.rig.advance(self._next)
            self.faults.act(self.rig, self._next)
            self._next = self.faults.next_time()
        self.rig.advance(now)

    def catch_up(self) -> None:
        """Move the mechanics on to the present: they lag until somebody needs them, and it takes a while."""
        self.rig.motion()


def _refuse_unknown_part(spec: FaultSpec, rig: EmulatedRig) -> None:
    values, tendons = dict(spec.values), rig.spec.tendons.count
    if "motor" in values and values["motor"] not in rig.motors:
        ids = ", ".join(map(str, rig.motors))
        raise SpecError(f"fault {str(spec)!r}: rig {rig.spec.name} has no motor {values['motor']:g}; there is {ids}")
    if "tendon" in values and not 1 <= values["tendon"] <= tendons:
        raise SpecError(
            f"fault {str(spec)!r}: rig {rig.spec.name} has no tendon {values['tendon']:g}; expected 1 to {tendons}"
        )


def _drop(_when: float, _data: bytes, _spec: FaultSpec, _chance: np.random.Generator) -> Arrivals:
    return []


def _flip(when: float, data: bytes, _spec: FaultSpec, chance: np.random.Generator) -> Arrivals:
    """Turn one bit over."""
    spoilt = bytearray(data)
    at, bit = divmod(int(chance.integers(8 * len(data))), 8)
    spoilt[at] ^= 1 << bit
    return [(when, bytes(spoilt))]


def _duplicate(when: float, data: bytes, _spec: FaultSpec, _chance: np.random.Generator) -> Arrivals:
    return [(when, data), (when, data)]


def _delay(when: float, data: bytes, spec: FaultSpec, _chance: np.random.Generator) -> Arrivals:
    return [(when + spec.value("by"), data)]


def _truncate(when: float, data: bytes, _spec: FaultSpec, chance: np.random.Generator) -> Arrivals:
    """Lose the end, at least a byte and at most all but one."""
    return [(when, data[: int(chance.integers(1, len(data)))])] if len(data) > 1 else []


_LASTING = ("overheat", "overload")
_STRIKES: dict[str, Callable[[float, bytes, FaultSpec, np.random.Generator], Arrivals]] = {
    "drop": _drop,
    "flip": _flip,
    "duplicate": _duplicate,
    "delay": _delay,
    "truncate": _truncate,
}
