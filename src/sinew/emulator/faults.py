"""Faults of an emulated bench, which happen when their time has come.

Faults strike packets on either way, or do to the devices and the mechanics what a bad day does. With a seed they are
the same again, as long as the same packets are sent at the same times.

A fault is written down as which, how strong, from when to when:

    KIND[:key=value,...][@START[-STOP]]     such as   drop:p=0.01   unplug@12.5   brown-out:to=5V@3-3.4

Times are seconds of emulated time since the start; without them a fault is there from the start, or to the end. A
value may carry its unit; a bare number has the first unit listed for its key.
"""

import difflib
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from sinew.emulator.device import ImuNode
from sinew.emulator.line import Line
from sinew.emulator.motor import Motor
from sinew.emulator.plant import JointPlant
from sinew.measure.errors import SpecError, UnitError
from sinew.measure.units import convert
from sinew.plan.rig import RigSpec

_NUMBER = r"\d*\.?\d+(?:[eE][+-]?\d+)?|\d+\.(?:[eE][+-]?\d+)?"
_VALUE = re.compile(rf"({_NUMBER})\s*(\S*)")
_WINDOW = re.compile(rf"({_NUMBER})(?:-({_NUMBER}))?")


@dataclass(frozen=True)
class FaultKey:
    """What one value of a fault may be.

    unit: of a bare number, and of the value kept. low, high: bounds. default: value where none is given; None: it must
    be given. drawn: between which values `random_fault` draws it, evenly in its logarithm; None: it is a whole number,
    of a motor or tendon.
    """

    unit: str
    low: float
    high: float
    default: float | None = None
    drawn: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class FaultSpec:
    """One fault.

    kind: of FAULT_KINDS. values: of its keys, every one, in their units.
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

    @property
    def part(self) -> tuple[str, float | None]:
        """What it strikes: faults of one kind, and of one motor or tendon, add up."""
        values = dict(self.values)
        return self.kind, values.get("motor", values.get("tendon"))

    def is_there(self, time: float) -> bool:
        """Return whether the fault is there at a time [s]."""
        return self.start <= time < self.stop

    def __str__(self) -> str:
        keys = FAULT_KINDS[self.kind].keys
        shown = [f"{k}={repr(v) if keys[k].drawn else int(v)}{keys[k].unit}" for k, v in self.values]
        window = "" if self.stop == math.inf else f"-{self.stop!r}"
        when = f"@{self.start!r}{window}" if self.start or window else ""
        return self.kind + (":" if shown else "") + ",".join(shown) + when


@dataclass(frozen=True, slots=True)
class Happening:
    """What a fault did. time: emulated [s]. kind: of the fault. what: it came, went, or struck once."""

    time: float
    kind: str
    what: Literal["begins", "ends", "strikes"]


class Bench(Protocol):
    """What faults happen to: an `emulator.bench.EmulatedRig`."""

    spec: RigSpec
    motors: dict[int, Motor]
    imu: ImuNode
    plant: JointPlant
    line: Line
    unplugged: bool
    log: list[Happening]
    faults: "Faults | None"

    def set_supply(self, voltage: float) -> None:
        """Feed the bench another voltage [V], from now on."""


Arrivals = list[tuple[float, bytes]]
Strike = Callable[[bytes, FaultSpec, np.random.Generator], Arrivals]
"""Turns bytes into what arrives instead, each with by how much later [s]; nothing for what is lost."""
Change = Callable[[Bench, FaultSpec, list[FaultSpec]], object]
"""Does to a bench what follows when a fault has come or gone. The list: which of its kind, and of its motor or tendon,
are there now."""


def _flip(data: bytes, _spec: FaultSpec, chance: np.random.Generator) -> Arrivals:
    """Turn one bit over."""
    spoilt = bytearray(data)
    at, bit = divmod(int(chance.integers(8 * len(data))), 8)
    spoilt[at] ^= 1 << bit
    return [(0.0, bytes(spoilt))]


def _truncate(data: bytes, _spec: FaultSpec, chance: np.random.Generator) -> Arrivals:
    """Lose the end, at least a byte and at most all but one."""
    return [(0.0, data[: int(chance.integers(1, len(data)))])] if len(data) > 1 else []


def _sets(name: str, of: Callable[[Bench, FaultSpec], object], value: Callable[[list[FaultSpec]], object]) -> Change:
    """Return what sets an attribute of a part of the bench to what the faults that are there make of it."""
    return lambda rig, one, there: setattr(of(rig, one), name, value(there))


def _motor(rig: Bench, fault: FaultSpec) -> Motor:
    return rig.motors[int(fault.value("motor"))]


def _imu(rig: Bench, _: FaultSpec) -> ImuNode:
    return rig.imu


def _brown_out(rig: Bench, _: FaultSpec, there: list[FaultSpec]) -> None:
    nominal = rig.spec.drive.supply_voltage.value
    rig.set_supply(min((one.value("to") for one in there), default=nominal))


def _total(key: str) -> Callable[[list[FaultSpec]], float]:
    return lambda there: sum(fault.value(key) for fault in there)


@dataclass(frozen=True)
class FaultKind:
    """All that there is to a kind of fault.

    strike: to packets, either way, each with probability p. change: to the bench. at_once: it happens at its start and
    has no stop. breaks: whether `random_fault` draws it; a push only moves the head, a lost sample is only counted.
    """

    keys: dict[str, FaultKey]
    example: str
    strike: Strike | None = None
    change: Change | None = None
    at_once: bool = False
    breaks: bool = True


_P = FaultKey("", 0.0, 1.0, 0.01, drawn=(1e-3, 0.3))
_MOTOR, _TENDON = FaultKey("", 0, 252), FaultKey("", 1, 12)
_LATER = FaultKey("s", 0.0, 10.0, 0.02, drawn=(1e-3, 0.1))
_VOLTS = FaultKey("V", 0.0, 30.0, 5.0, drawn=(3.0, 9.0))
_HEATING = FaultKey("K/s", 0.0, 1000.0, 20.0, drawn=(5.0, 100.0))
_LENGTH = FaultKey("mm", 0.0, 100.0, 1.0, drawn=(0.2, 6.0))
_TORQUE = FaultKey("N*m", 0.0, 20.0, 0.5, drawn=(0.1, 2.0))

FAULT_KINDS: dict[str, FaultKind] = {
    "drop": FaultKind({"p": _P}, "drop:p=0.01", lambda *_: []),
    "flip": FaultKind({"p": _P}, "flip:p=0.01@5-8", _flip),
    "duplicate": FaultKind({"p": _P}, "duplicate:p=0.01", lambda data, *_: [(0.0, data), (0.0, data)]),
    "delay": FaultKind({"p": _P, "by": _LATER}, "delay:p=0.01,by=20ms", lambda data, f, _: [(f.value("by"), data)]),
    "truncate": FaultKind({"p": _P}, "truncate:p=0.01", _truncate),
    "unplug": FaultKind({}, "unplug@12.5", change=_sets("unplugged", lambda rig, _: rig, bool)),
    "brown-out": FaultKind({"to": _VOLTS}, "brown-out:to=5V@3-3.4", change=_brown_out),
    "overload": FaultKind({"motor": _MOTOR}, "overload:motor=2@5", change=_sets("is_burdened", _motor, bool)),
    "overheat": FaultKind(
        {"motor": _MOTOR, "rate": _HEATING}, "overheat:motor=3@5", change=_sets("heated_by", _motor, _total("rate"))
    ),
    "imu-freeze": FaultKind({}, "imu-freeze@4-4.5", change=_sets("frozen", _imu, bool)),
    "imu-lose": FaultKind(
        {"share": _P},
        "imu-lose:share=5%@4-9",
        change=_sets("loses", _imu, lambda there: max((f.value("share") for f in there), default=0.0)),
        breaks=False,
    ),
    "stuck-tendon": FaultKind(
        {"tendon": _TENDON},
        "stuck-tendon:tendon=1@4",
        change=lambda rig, one, there: rig.plant.stick(int(one.value("tendon")) - 1, bool(there)),
    ),
    "slip-tendon": FaultKind(
        {"tendon": _TENDON, "by": _LENGTH},
        "slip-tendon:tendon=2,by=1mm@4",
        change=lambda rig, one, _: rig.plant.slip(int(one.value("tendon")) - 1, 1e-3 * one.value("by")),
        at_once=True,
    ),
    "push": FaultKind(
        {"torque": _TORQUE},
        "push:torque=0.5@20-20.1",
        change=lambda rig, _, there: rig.plant.push(_total("torque")(there)),
        breaks=False,
    ),
}
"""Every kind of fault."""

DRAWN_KINDS = tuple(name for name, kind in FAULT_KINDS.items() if kind.breaks)
"""Kinds that `random_fault` draws."""


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
    values = {key: row.default for key, row in kind.keys.items()}
    for part in filter(None, (part.strip() for part in rest.split(","))):
        key, said = (word.strip() for word in part.partition("=")[::2])
        if key not in values:
            there = f"there is {', '.join(values)}" if values else "it has none"
            raise SpecError(f"fault {text!r} has the unknown key {key!r}; {there}; for example {kind.example}")
        values[key] = _value(text, key, said, kind)
    given = tuple((key, value) for key, value in values.items() if value is not None)
    if len(given) < len(values):
        missing = next(key for key, value in values.items() if value is None)
        raise SpecError(f"fault {text!r} does not say {missing}; for example {kind.example}")
    return FaultSpec(name, given, start, stop)


def random_fault(
    rng: np.random.Generator, latest: float = 10.0, motors: Sequence[int] = (1, 2, 3, 4, 5), tendons: int = 4
) -> FaultSpec:
    """Return a fault drawn at random: its kind, its strength, and when it begins; half of those that can stop do.

    latest: when it begins at the latest [s]. motors: ids. tendons: how many.
    """
    name = str(rng.choice(list(DRAWN_KINDS)))
    numbered = {"motor": list(motors), "tendon": list(range(1, tendons + 1))}
    values = tuple(
        (key, float(f"{_log_even(rng, row.drawn):.4g}") if row.drawn else float(rng.choice(numbered[key])))
        for key, row in FAULT_KINDS[name].keys.items()
    )
    start = round(float(rng.uniform(0.0, latest)), 3)
    ends = bool(rng.random() < 0.5) and not FAULT_KINDS[name].at_once
    return FaultSpec(name, values, start, round(start + _log_even(rng, (0.03, 5.0)), 3) if ends else math.inf)


def _log_even(rng: np.random.Generator, ends: tuple[float, float]) -> float:
    return float(np.exp(rng.uniform(*np.log(ends))))


def _window(text: str, window: str, kind: FaultKind) -> tuple[float, float]:
    found = _WINDOW.fullmatch(window.strip())
    if found is None:
        raise SpecError(
            f"fault {text!r}: {window!r} is no time; expected START or START-STOP in s, as in {kind.example}"
        )
    start, stop = float(found[1]), float(found[2] or math.inf)
    if kind.at_once and found[2]:
        raise SpecError(f"fault {text!r} happens at once and has no stop; write {kind.example}")
    if not start < stop:
        raise SpecError(f"fault {text!r} stops before it starts; expected START-STOP with START first")
    return start, stop


def _value(text: str, key: str, written: str, kind: FaultKind) -> float:
    row, found = kind.keys[key], _VALUE.fullmatch(written)
    wrong = f"fault {text!r}: {key}={written}"
    if found is None:
        raise SpecError(
            f"{wrong} is not {f'a number in {row.unit}' if row.unit else 'a number'}; for example {kind.example}"
        )
    try:
        value = float(found[1]) * (convert(found[2], row.unit) if found[2] else 1.0)
    except UnitError as trouble:
        raise SpecError(f"{wrong}: {trouble}; for example {kind.example}") from trouble
    if not row.low <= value <= row.high or not (row.drawn or value == round(value)):
        what = "a number" if row.drawn else "a whole number"
        bounds = f"{what} from {row.low:g} to {row.high:g} {row.unit}".strip()
        raise SpecError(f"{wrong} is out of bounds; expected {bounds}")
    return value


class Faults:
    """Faults that happen to a bench from now on. What happened stands in the bench's log.

    specs: which, and when. seed: of which packets are struck, and how. due: when `act` has something to do next [s];
    infinite: never. Raises SpecError for a motor or tendon that the bench does not have.
    """

    def __init__(self, rig: Bench, specs: Sequence[FaultSpec], seed: int = 0) -> None:
        for spec in specs:
            _refuse_unknown_part(spec, rig)
        self._rig, self.specs = rig, tuple(specs)
        # A stream of random numbers for each: one fault more changes nothing about the others.
        self._chance = [np.random.default_rng([seed, number]) for number in range(len(specs))]
        self._there: set[int] = set()
        if any(FAULT_KINDS[spec.kind].strike for spec in specs):
            rig.line.disturb_down = rig.line.disturb_up = self.disturb
        self._look_ahead(-math.inf)
        rig.faults = self

    def _look_ahead(self, now: float) -> None:
        times = (time for spec in self.specs for time in (spec.start, spec.stop))
        self.due = min((time for time in times if time > now), default=math.inf)

    def act(self, now: float) -> None:
        """Let faults come and go at a time [s], to which the bench has been advanced."""
        for number, spec in enumerate(self.specs):
            there = spec.is_there(now)
            if there == (number in self._there):
                continue
            self._there ^= {number}
            self._rig.log.append(Happening(now, spec.kind, "begins" if there else "ends"))
            if change := FAULT_KINDS[spec.kind].change:
                all_there = [self.specs[other] for other in sorted(self._there)]
                change(self._rig, spec, [other for other in all_there if other.part == spec.part])
        self._look_ahead(now)

    def disturb(self, now: float, data: bytes) -> Arrivals:
        """Return what arrives, and when [s], of bytes that would have arrived at `now`."""
        arrivals = [(now, data)]
        for spec, chance in zip(self.specs, self._chance, strict=True):
            strike = FAULT_KINDS[spec.kind].strike
            if strike is None or not spec.is_there(now):
                continue
            struck: Arrivals = []
            for when, part in arrivals:
                if part and chance.random() < spec.value("p"):
                    struck += [(when + later, left) for later, left in strike(part, spec, chance)]
                    self._rig.log.append(Happening(now, spec.kind, "strikes"))
                else:
                    struck.append((when, part))
            arrivals = struck
        return arrivals


def _refuse_unknown_part(spec: FaultSpec, rig: Bench) -> None:
    values, tendons = dict(spec.values), rig.spec.tendons.count
    if "motor" in values and values["motor"] not in rig.motors:
        ids = ", ".join(map(str, rig.motors))
        raise SpecError(f"fault {str(spec)!r}: rig {rig.spec.name} has no motor {values['motor']:g}; there is {ids}")
    if "tendon" in values and not 1 <= values["tendon"] <= tendons:
        raise SpecError(
            f"fault {str(spec)!r}: rig {rig.spec.name} has no tendon {values['tendon']:g}; expected 1 to {tendons}"
        )
