"""Scenarios, drawn at random, of one run of the campaign: plan, mode, safe state, joint, and the faults that strike.

A run is a function of seed and number alone, so any line of the table can be run again.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from sinew.emulator.faults import Arrivals, FaultSpec, random_fault
from sinew.emulator.line import Line
from sinew.hardware.codec import HEADER, Decoder, Status, encode
from sinew.plan.plan import Plan, TendonMode
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig, parse_plan

# What a hostile line does to answers on their way: late, swapped, repeated, zeroed, re-signed, echoed, wrong id, junk.
#
# Protocol 2.0 has no sequence number and its CRC no key, so all of these arrive whole and with a right CRC: as a USB
# hub that hands over late, an adapter that returns what is sent, two masters, or a device gone mad would make them.
# Each answer is struck with a probability, between two times, by a generator of its own: a run is a function of its
# seed.

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


# The scenarios.

Phase = Literal["set-up", "mode change", "levelling", "stop"]
Timeline = dict[Phase, tuple[float, float]]
"""When a phase begins and ends in the run without a fault [s]."""

PLANS = {
    "one pretension": """
        [pretension]
        pretension_mm = [4]
        rest_s = 0.3
        [sweep]
        frequency_hz = [3.2, 4.2]
        amplitude_deg = 20
        settle_s = 0.4
        periods = 3
        repeats = 1
        [ring_down]
        frequency_hz = [3.6, 3.6]
        amplitude_deg = 20
        drive_s = 0.6
        record_s = 0.6
        repeats = 1
    """,
    "two pretensions": """
        [pretension]
        pretension_mm = [1, 3]
        rest_s = 0.3
        [sweep]
        frequency_hz = [3.4]
        amplitude_deg = 20
        settle_s = 0.3
        periods = 3
        repeats = 1
    """,
    "one frequency": """
        [pretension]
        pretension_mm = [3]
        rest_s = 0.2
        [sweep]
        frequency_hz = [3.4]
        amplitude_deg = 20
        settle_s = 0.3
        periods = 4
        repeats = 1
    """,
    "tracking": """
        [pretension]
        pretension_mm = [4]
        rest_s = 0.3
        [track]
        amplitude_deg = [15]
        low_hz = 2.4
        high_hz = 4.4
        start_hz = 3.1
        duration_s = 4
    """,
    "tracking on the way": """
        [pretension]
        pretension_mm = [1]
        rest_s = 0.3
        [track]
        amplitude_deg = [15]
        low_hz = 2.4
        high_hz = 4.4
        duration_s = 2.5
        pretension_to_mm = 3
        lead_s = 1
        tail_s = 0.5
    """,
}
"""Plans by name: everything that a bench does, as short as that goes."""

NOMINAL_S = 17.0
"""About how long a run without a fault takes, its end included [s, virtual time]."""

_MOST_TILT_DEG = 3.0
_MOST_SLACK_M = 3e-3
_NOTHING, _FROM_START, _TWO, _INTERRUPTED, _AIMED = 0.03, 0.06, 0.25, 0.15, 0.25
_TWO_PRETENSIONS, _TRACKED = 0.25, 0.25
_PHASES = dict(zip(get_args(Phase), (0.2, 0.3, 0.15, 0.35), strict=True))


@dataclass(frozen=True, slots=True)
class Scenario:
    """One run.

    plan: of PLANS. slack_m, rest_tilt: of the joint as the run finds it [m; rad]. faults: their times count from the
    start, or, where the run is aimed at a phase, from that phase's beginning (`aimed`). interrupt_s: when the
    operator ends it [s], or infinite. fault_seed: of which packets are struck. lies: of a hostile line, if it is one.
    """

    number: int
    plan: str
    slack_m: tuple[float, ...]
    mode: TendonMode
    safe_state: str
    rest_tilt: tuple[float, float]
    faults: tuple[FaultSpec, ...]
    interrupt_s: float = math.inf
    phase: Phase | None = None
    fault_seed: int = 0
    lies: Lies | None = None

    @property
    def kind(self) -> str:
        """What the table files it under."""
        if self.lies is not None:
            return self.lies.kind
        if len(self.faults) > 1:
            return "two at once"
        return self.faults[0].kind if self.faults else "none"

    def without_faults(self) -> "Scenario":
        """Return the same run on a good day."""
        return replace(self, faults=(), interrupt_s=math.inf, phase=None, lies=None)

    def aimed(self, timeline: Timeline) -> "Scenario":
        """Return it with its faults moved into the phase at which it is aimed."""
        if self.phase is None or self.phase not in timeline:
            return self
        begin, end = timeline[self.phase]
        # A fault's start was drawn from 0 to NOMINAL_S: that is now the phase, and a little before it.
        early = begin - 0.05
        share = (end - early) / NOMINAL_S
        first = min(fault.start for fault in self.faults)
        moved = early + share * first - first
        return replace(self, phase=None, faults=tuple(_moved(fault, moved) for fault in self.faults))


def draw_scenario(seed: int, number: int) -> Scenario:
    """Return run `number` of the campaign with that seed."""
    rng = np.random.default_rng([seed, number])
    faults = [random_fault(rng, NOMINAL_S)] if rng.random() >= _NOTHING else []
    interrupt, phase = math.inf, None
    if faults and rng.random() < _FROM_START:
        faults = [_moved(faults[0], -faults[0].start)]
    elif faults and rng.random() < _TWO:
        # The second comes where the first has just stopped the run, or soon will.
        second = random_fault(rng, 0.0)
        faults.append(_moved(second, round(faults[0].start + float(rng.uniform(0.0, 1.5)), 3)))
    elif faults and rng.random() < _INTERRUPTED / (1 - _TWO):
        interrupt = round(faults[0].start + float(rng.uniform(-0.6, 0.3)), 3)
    elif faults and rng.random() < _AIMED / (1 - _TWO - _INTERRUPTED):
        phase = list(_PHASES)[int(rng.choice(len(_PHASES), p=list(_PHASES.values())))]
    tilt, turn = math.radians(float(rng.uniform(0, _MOST_TILT_DEG))), float(rng.uniform(0, math.tau))
    modes: tuple[TendonMode, ...] = get_args(TendonMode)
    mode = modes[int(rng.integers(len(modes)))]
    one, two, _, stands, moves = PLANS
    # By current, levelling at a low pretension takes so long that nothing else would be seen of such a run.
    plan = two if rng.random() < _TWO_PRETENSIONS and mode != "current" else one
    tracked = np.random.default_rng([seed, number, 1]).random(2)  # apart, so that all else stays as it was drawn
    if tracked[0] < _TRACKED:
        plan = moves if tracked[1] < 0.5 and mode == "position" else stands
    return Scenario(
        number=number,
        plan=plan,
        mode=mode,
        safe_state=("hold", "release")[int(rng.integers(2))],
        slack_m=tuple(round(float(slack), 5) for slack in rng.uniform(2e-4, _MOST_SLACK_M, 4)),
        rest_tilt=(round(tilt * math.cos(turn), 5), round(tilt * math.sin(turn), 5)),
        faults=tuple(faults),
        interrupt_s=interrupt,
        phase=phase,
        fault_seed=int(rng.integers(1 << 31)),
    )


_EARLY_S, _LATE_S = (0.0, 4.0), (7.0, 11.0)  # when it becomes hostile: set-up and pull; levelling and swing
_EARLY = 0.7  # of the runs, which are cheap


def draw_hostile(seed: int, number: int) -> Scenario:
    """Return run `number` of the campaign with that seed; kinds take turns."""
    rng = np.random.default_rng([seed, number, 19])
    start = float(rng.uniform(*(_EARLY_S if rng.random() < _EARLY else _LATE_S)))
    stop = float("inf") if rng.random() < 0.5 else start + float(rng.uniform(0.1, 4.0))
    share = float(10 ** rng.uniform(-2.0, 0.0))
    lies = Lies(
        LIE_KINDS[number % len(LIE_KINDS)], round(share, 4), round(start, 3), round(stop, 3), int(rng.integers(1 << 31))
    )
    interrupt = start + float(rng.uniform(0.2, 1.5)) if rng.random() < 0.95 else float("inf")
    drawn = draw_scenario(seed, number).without_faults()
    mode = drawn.mode if rng.random() < 0.5 else "position"
    return replace(drawn, plan="one frequency", mode=mode, lies=lies, interrupt_s=round(interrupt, 3))


def plan_of(scenario: Scenario) -> Plan:
    """Return the plan of a run."""
    plan = parse_plan(f'name = "{scenario.plan}"\nsample_hz = 200\n{PLANS[scenario.plan]}')
    return plan.model_copy(update={"pretension": plan.pretension.model_copy(update={"mode": scenario.mode})})


def rig_of(scenario: Scenario) -> RigSpec:
    """Return the paper's rig, with the run's safe state."""
    spec = load_rig("paper")
    return spec.model_copy(update={"limits": spec.limits.model_copy(update={"safe_state": scenario.safe_state})})


def _moved(fault: FaultSpec, by: float) -> FaultSpec:
    """Return a fault that comes and goes later by so much [s]."""
    start = max(0.0, fault.start + by)
    return replace(fault, start=round(start, 4), stop=round(start + fault.stop - fault.start, 4))
