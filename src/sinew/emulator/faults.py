"""Faults of an emulated bench, which happen when their time has come.

Faults strike packets on either way, or do to the devices and the mechanics what a bad day does. With a seed they are
the same again, as long as the same packets are sent at the same times.
"""

import difflib
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sinew.emulator.line import Line
from sinew.emulator.rig import EmulatedRig
from sinew.hardware.registers import OVERLOAD
from sinew.measure.errors import SpecError

# A fault of the emulated bench is written down: which, how strong, from when to when.
#
#     KIND[:key=value,...][@START[-STOP]]     such as   drop:p=0.01   unplug@12.5   brown-out:to=5V@3-3.4
#
# Times are seconds of emulated time since the start; without them a fault is there from the start, or to the end. A
# value may carry its unit; a bare number has the first unit listed for its key.

_NUMBER = r"\d*\.?\d+(?:[eE][+-]?\d+)?|\d+\.(?:[eE][+-]?\d+)?"
_VALUE = re.compile(rf"({_NUMBER})\s*(\S*)")
_WINDOW = re.compile(rf"({_NUMBER})(?:-({_NUMBER}))?")
_CHANCE, _SECONDS, _LENGTH, _VOLTS = {"": 1.0, "%": 0.01}, {"s": 1.0, "ms": 1e-3}, {"mm": 1e-3, "m": 1.0}, {"V": 1.0}
_WHOLE, _HEATING, _TORQUE = {"": 1.0}, {"K/s": 1.0}, {"N*m": 1.0}


@dataclass(frozen=True)
class FaultKey:
    """What one value of a fault may be.

    units: spelling and factor to the unit kept; the first is that of a bare number. low, high: bounds in the unit kept.
    default: value where none is given; None: it must be given. whole: whether it is a whole number.
    """

    units: dict[str, float]
    low: float
    high: float
    default: float | None = None
    whole: bool = False

    @property
    def kept_unit(self) -> str:
        """How the unit is spelt in which the value is kept."""
        return next(unit for unit, factor in self.units.items() if factor == 1.0)


@dataclass(frozen=True)
class FaultKind:
    """What there is to say about faults of a kind. at_once: it happens at its start and has no stop."""

    keys: dict[str, FaultKey]
    example: str
    at_once: bool = False


_P = FaultKey(_CHANCE, 0.0, 1.0, 0.01)
_MOTOR = FaultKey(_WHOLE, 0, 252, whole=True)
_TENDON = FaultKey(_WHOLE, 1, 12, whole=True)

LINE_FAULTS = ("drop", "flip", "duplicate", "delay", "truncate")
"""Kinds that strike packets, either way, each with probability p."""

FAULT_KINDS: dict[str, FaultKind] = {
    "drop": FaultKind({"p": _P}, "drop:p=0.01"),
    "flip": FaultKind({"p": _P}, "flip:p=0.01@5-8"),
    "duplicate": FaultKind({"p": _P}, "duplicate:p=0.01"),
    "delay": FaultKind({"p": _P, "by": FaultKey(_SECONDS, 0.0, 10.0, 0.02)}, "delay:p=0.01,by=20ms"),
    "truncate": FaultKind({"p": _P}, "truncate:p=0.01"),
    "unplug": FaultKind({}, "unplug@12.5"),
    "brown-out": FaultKind({"to": FaultKey(_VOLTS, 0.0, 30.0, 5.0)}, "brown-out:to=5V@3-3.4"),
    "overload": FaultKind({"motor": _MOTOR}, "overload:motor=2@5"),
    "overheat": FaultKind({"motor": _MOTOR, "rate": FaultKey(_HEATING, 0.0, 1000.0, 20.0)}, "overheat:motor=3@5"),
    "imu-freeze": FaultKind({}, "imu-freeze@4-4.5"),
    "imu-lose": FaultKind({"share": FaultKey(_CHANCE, 0.0, 1.0, 0.01)}, "imu-lose:share=5%@4-9"),
    "stuck-tendon": FaultKind({"tendon": _TENDON}, "stuck-tendon:tendon=1@4"),
    "slip-tendon": FaultKind(
        {"tendon": _TENDON, "by": FaultKey(_LENGTH, 0.0, 0.1, 1e-3)}, "slip-tendon:tendon=2,by=1mm@4", at_once=True
    ),
    "push": FaultKind({"torque": FaultKey(_TORQUE, 0.0, 20.0, 0.5)}, "push:torque=0.5@20-20.1"),
}
"""Every kind of fault: its keys and an example."""

DRAWN_KINDS = tuple(kind for kind in FAULT_KINDS if kind not in ("push", "imu-lose"))
"""Kinds that `random_fault` draws: what breaks. A push only moves the head, a lost sample is only counted."""


@dataclass(frozen=True, slots=True)
class FaultSpec:
    """One fault.

    kind: of FAULT_KINDS. values: of its keys, every one, in seconds, metres, volts, newton metres or
    kelvin per second.
    start, stop: when it is there [s, emulated time]; stop is infinite where it stays.
    `str` gives the text that `parse_fault` reads back to the same.
    """

    kind: str
    values: tuple[tuple[str, float], ...] = ()
    start: float = 0.0
    stop: float = math.inf

    def value(self, key: str) -> float:
        """Return the value of a key of this kind."""
        return dict(self.values)[key]

    def is_there(self, time: float) -> bool:
        """Return whether the fault is there at a time [s]."""
        return self.start <= time < self.stop

    def __str__(self) -> str:
        keys = FAULT_KINDS[self.kind].keys
        shown = [f"{k}={int(v) if keys[k].whole else repr(v)}{keys[k].kept_unit}" for k, v in self.values]
        window = "" if self.stop == math.inf else f"-{self.stop!r}"
        when = f"@{self.start!r}{window}" if self.start or window else ""
        return self.kind + (":" if shown else "") + ",".join(shown) + when


def parse_fault(text: str) -> FaultSpec:
    """Return the fault that a text `KIND[:key=value,...][@START[-STOP]]` describes.

    Raises SpecError, which names what there is, for an unknown kind or key and for a value out of its bounds.
    """
    what, at, window = text.strip().partition("@")
    name, _, rest = what.partition(":")
    if name not in FAULT_KINDS:
        close = difflib.get_close_matches(name, FAULT_KINDS, n=1)
        advice = f"did you mean {FAULT_KINDS[close[0]].example}?" if close else "for example unplug@12.5"
        raise SpecError(f"unknown fault {name!r}; there is {', '.join(FAULT_KINDS)}; {advice}")
    kind = FAULT_KINDS[name]
    start, stop = _window(text, window, kind) if at else (0.0, math.inf)
    given = _values(text, rest, kind)
    missing = [key for key, row in kind.keys.items() if key not in given and row.default is None]
    if missing:
        raise SpecError(f"fault {text!r} does not say {missing[0]}; for example {kind.example}")
    values = {key: row.default if row.default is not None else 0.0 for key, row in kind.keys.items()} | given
    return FaultSpec(name, tuple(values.items()), start, stop)


def random_fault(
    rng: np.random.Generator, latest: float = 10.0, motors: Sequence[int] = (1, 2, 3, 4, 5), tendons: int = 4
) -> FaultSpec:
    """Return a fault drawn at random: its kind, its strength, and when it begins; half of those that can stop do.

    latest: when it begins at the latest [s]. motors: ids. tendons: how many.
    """
    name = str(rng.choice(list(DRAWN_KINDS)))
    drawn: dict[tuple[str, str], float] = {
        ("delay", "by"): round(float(rng.uniform(1e-3, 0.1)), 4),
        ("brown-out", "to"): round(float(rng.uniform(3.0, 9.0)), 2),
        ("overheat", "rate"): round(float(rng.uniform(5.0, 100.0)), 1),
        ("slip-tendon", "by"): round(float(rng.uniform(2e-4, 6e-3)), 5),
    }
    alike = {
        "p": round(float(10 ** rng.uniform(-3.0, math.log10(0.3))), 5),
        "motor": float(rng.choice(list(motors))),
        "tendon": float(rng.integers(1, tendons + 1)),
    }
    kind = FAULT_KINDS[name]
    values = tuple((key, drawn.get((name, key), alike.get(key, 0.0))) for key in kind.keys)
    start = round(float(rng.uniform(0.0, latest)), 3)
    lasts = round(float(10 ** rng.uniform(-1.5, 0.7)), 3)
    ends = bool(rng.random() < 0.5) and not kind.at_once
    return FaultSpec(name, values, start, round(start + lasts, 3) if ends else math.inf)


def _window(text: str, window: str, kind: FaultKind) -> tuple[float, float]:
    found = _WINDOW.fullmatch(window.strip())
    if found is None:
        raise SpecError(
            f"fault {text!r}: {window!r} is no time; expected START or START-STOP in s, as in {kind.example}"
        )
    start, stop = float(found[1]), float(found[2]) if found[2] else math.inf
    if kind.at_once and found[2]:
        raise SpecError(f"fault {text!r} happens at once and has no stop; write {kind.example}")
    if not start < stop:
        raise SpecError(f"fault {text!r} stops before it starts; expected START-STOP with START first")
    return start, stop


def _values(text: str, rest: str, kind: FaultKind) -> dict[str, float]:
    values: dict[str, float] = {}
    for part in filter(None, (part.strip() for part in rest.split(","))):
        key, _, said = part.partition("=")
        row = kind.keys.get(key.strip())
        if row is None:
            there = f"there is {', '.join(kind.keys)}" if kind.keys else "it has none"
            raise SpecError(f"fault {text!r} has the unknown key {key!r}; {there}; for example {kind.example}")
        values[key.strip()] = _value(text, key.strip(), said.strip(), row, kind)
    return values


def _value(text: str, key: str, said: str, row: FaultKey, kind: FaultKind) -> float:
    found = _VALUE.fullmatch(said)
    unit = (found[2] or next(iter(row.units))) if found else ""
    if found is None or unit not in row.units:
        units = " or ".join(filter(None, row.units))
        expected = f"a number, in {units}" if units else "a number"
        raise SpecError(f"fault {text!r}: {key}={said} is not {expected}; for example {kind.example}")
    value = float(found[1]) * row.units[unit]
    if not row.low <= value <= row.high or (row.whole and value != round(value)):
        what = "a whole number" if row.whole else "a number"
        bounds = f"{what} from {row.low:g} to {row.high:g} {row.kept_unit}".strip()
        raise SpecError(f"fault {text!r}: {key}={said} is out of bounds; expected {bounds}")
    return value


_STEP = 0.05
"""How often a fault that goes on is seen to [s]."""
_OVERLOAD_TIME = 1.0
"""How long a motor bears too much load [s], as in `sinew.emulator.motor`."""

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
        elif spec.kind == "imu-lose":
            rig.imu.loses = max(self._values("imu-lose", "share"), default=0.0)
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
    """A bench to which faults happen, in the place of the bench itself, and to be used like it.

    rig: the bench. faults: what happens to it.
    """

    def __init__(self, rig: EmulatedRig, faults: Faults) -> None:
        self.rig, self.faults = rig, faults
        self._next = faults.next_time()

    @property
    def line(self) -> Line:
        return self.rig.line

    @property
    def unplugged(self) -> bool:
        return self.rig.unplugged

    @property
    def time(self) -> float:
        return self.rig.time

    def receive(self, data: bytes, now: float) -> None:
        self.advance(now)
        self.rig.receive(data, now)

    def transmit(self, now: float) -> bytes:
        self.advance(now)
        return self.rig.transmit(now)

    def next_event(self) -> float:
        return min(self._next, self.rig.next_event())

    def advance(self, now: float) -> None:
        while self._next <= now:
            self.rig.advance(self._next)
            self.faults.act(self.rig, self._next)
            self._next = self.faults.next_time()
        self.rig.advance(now)

    def catch_up(self) -> None:
        """Move the mechanics on to the present: they lag until somebody needs them, and it takes a while."""
        self.rig.mechanics.catch_up()


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
