"""Events of a run: what happens besides samples; of each kind its fields, its sentence, and how loud it is.

The journal holds an event as text, `written()`: its sentence, or its fields as JSON; `read_event` is the way back.
"""

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from typing import ClassVar, Literal, Self

from pydantic import TypeAdapter, ValidationError

Severity = Literal["state", "note", "warning"]
"""A state is replaced by the next of its kind, a note is told once, a warning stands out."""


class Event(ABC):
    """What happened in a run besides samples; `str` is its sentence."""

    kind: ClassVar[str]
    severity: ClassVar[Severity] = "note"

    @abstractmethod
    def written(self) -> str:
        """Return it as the journal holds it."""


@dataclass(frozen=True)
class _Said(Event):
    """An event that is its sentence. form: the sentence, with the names of what stands in it."""

    sentence: str
    form: ClassVar[str] = "{sentence}"

    @classmethod
    def of(cls, **parts: float | str) -> Self:
        """Return it from the parts of its form."""
        return cls(cls.form.format(**parts))

    def written(self) -> str:
        return self.sentence

    def __str__(self) -> str:
        return self.sentence


class Pulled(_Said):
    """The tendons are being pulled until each carries the tension of first contact."""

    kind, form = "pull", "the tendons are pulled to first contact"


class Contact(_Said):
    """First contact was found, at this mean of the motors' currents."""

    kind, form = "contact", "first contact at {current_ma:.0f} mA"


class Paused(_Said):
    """The run rests, as it was asked to."""

    kind, form = "paused", "the run rests before {group}"


class Resumed(_Said):
    """The run goes on after a pause that was asked for."""

    kind, form = "resumed", "the run goes on with {group}"


class Anew(Resumed):
    """The run goes on by itself after a hole; of the same kind in the journal."""

    form = "the tendons are pulled anew, and the run goes on from its last whole group"


class Hole(_Said):
    """The computer paused until the watchdogs stopped the motors; of so many times the rig allows at most some."""

    kind, severity = "hole", "warning"
    form = "{why}; the motors stand, then let go, then the run goes on by itself ({times} of {most})"


class Repeat(_Said):
    """A group did not count."""

    kind, severity, form = "repeat", "warning", "{group} has too many holes and is measured again"


class Doubted(_Said):
    """What speaks against the group that was just recorded, in the words of `sinew.analysis.doubts`."""

    kind, severity = "doubt", "warning"


class Frozen(_Said):
    """All motors stand, as an emergency stop asked."""

    kind, form = "frozen", "all motors stand, {after_ms:.0f} ms after the request"


class Lock(_Said):
    """A law that tracks a resonance found it."""

    kind, form = "lock", "locked at {frequency_hz:.3f} Hz, {elapsed_s:.1f} s after the start"


class Unlock(Lock):
    """A law that tracks a resonance lost it; of the same kind in the journal."""

    form = "the lock is lost at {frequency_hz:.3f} Hz, {elapsed_s:.1f} s after the start"


class Ended(_Said):
    """The run is over: what ended it, and how the rig was left."""

    kind, form = "end", "{why}; {left}"


class Note(_Said):
    """What a journal of another version tells in a way that this one does not know."""

    kind = "note"


@dataclass(frozen=True)
class _Measured(Event):
    """An event that is its fields."""

    def written(self) -> str:
        return json.dumps(asdict(self))


@dataclass(frozen=True)
class Pretensioned(_Measured):
    """A pretension as it was set and as it came out.

    asked_mm. reached_mm: mean take-up of the motors since first contact, less their give under load; NaN by current.
    asked_current_a, current_a: mean of the motors' currents; asked is NaN by position. tilt_deg: that is left.
    offsets: levelling correction about y and z [rad]. levelling_s: how long levelling took. limit_a: mean current limit
    of the motors; None where they have none.
    """

    kind = "pretension"
    asked_mm: float
    reached_mm: float
    asked_current_a: float
    current_a: float
    tilt_deg: float
    offsets: tuple[float, float]
    levelling_s: float
    limit_a: float | None = None

    def __str__(self) -> str:
        return f"pretension {self.asked_mm:g} mm is set, tilt {self.tilt_deg:.2f}°"


@dataclass(frozen=True)
class Track(_Measured):
    """The state of a law that tracks a resonance, told twice a second; None is what is not known.

    phase_error_deg: of the lag. command_deg, lever_deg, torsion_deg: amplitudes. wanted_hz: that the pretension is to
    bring about. is_limited: by pretension or swing. lock_cycles: until the first lock; lock_losses: how many.
    """

    kind, severity = "track", "state"
    elapsed_s: float
    is_locked: bool
    is_coasting: bool
    frequency_hz: float
    phase_error_deg: float | None = None
    command_deg: float | None = None
    lever_deg: float | None = None
    torsion_deg: float | None = None
    pretension_mm: float | None = None
    wanted_hz: float | None = None
    is_limited: bool = False
    lock_cycles: float | None = None
    lock_losses: float = 0.0

    def __str__(self) -> str:
        def number(value: float | None, form: str, unit: str) -> str:
            return f"{'-' if value is None else format(value, form)}{unit}"

        lock = "locked" if self.is_locked else ("coasting" if self.is_coasting else "searching")
        parts = [
            f"{self.elapsed_s:6.1f} s",
            f"{lock:9s}",
            f"{self.frequency_hz:.3f} Hz",
            f"error {number(self.phase_error_deg, '+5.1f', '°')}",
            f"torsion {number(self.torsion_deg, '5.1f', '°')}",
            f"command {number(self.command_deg, '4.1f', '°')}",
            number(self.pretension_mm, "5.2f", " mm"),
        ]
        return "  ".join(parts if self.wanted_hz is None else [*parts, f"wanted {self.wanted_hz:.3f} Hz"])


@dataclass(frozen=True)
class Health(_Measured):
    """How a run fares, told once a second.

    state: in words. cycles: how many there were, how many missed or incomplete, how late the latest began, how long one
    was busy. bus: what its line counted. done_s, total_s: of the plan. group: under way, from 0; None before the first.
    """

    kind, severity = "health", "state"
    state: str
    cycles: int
    missed: int
    incomplete: int
    worst_late_ms: float
    busy_ms: float
    temperature_c: Mapping[str, float]
    supply_v: float | None
    bus: Mapping[str, int]
    done_s: float
    total_s: float
    group: int | None
    groups: int


_SAID = (Pulled, Contact, Paused, Resumed, Hole, Repeat, Doubted, Frozen, Lock, Ended)
_MEASURED = (Pretensioned, Track, Health)
STATES = tuple(one.kind for one in _MEASURED if one.severity == "state")
"""Kinds of which only the newest matters."""


def read_event(kind: str, text: str) -> Event:
    """Return an event from a journal's row; a `Note` where the kind, or a field, is of another version."""
    for measured in _MEASURED:
        if measured.kind == kind:
            try:
                return _reader(measured).validate_json(text)
            except ValidationError:
                return Note(text)
    return next((said(text) for said in _SAID if said.kind == kind), Note(text))


@cache
def _reader(kind: type[_Measured]) -> TypeAdapter[_Measured]:
    return TypeAdapter(kind)
