"""Emulated benches that are set and wired wrongly, led to a rig file and a first run by the guide, in virtual time.

What comes out is held against the bench as it is: ids and bauds, places, senses, the lever's middle, the board's axes,
supply and delay; and that motors were safe at every end, as the mechanics say.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tests.unit.emulator_stand_in import StandIn

from sinew.bench.doctor import Finding
from sinew.bench.guide import STEPS, Guide, Step, lead
from sinew.bench.record.journal import Journal
from sinew.bench.run import Runner
from sinew.bench.stops import stop
from sinew.bench.tilt import turned_frame
from sinew.emulator.bench import EmulatedRig, VirtualPort, drawn_start, emulated_bench
from sinew.hardware.bus import Bus, BusTiming, Clock
from sinew.hardware.registers import BAUD_RATES
from sinew.hardware.rig import Rig
from sinew.measure.errors import StartError, StoppedError
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_plan, dump_rig, load_rig, parse_plan
from sinew.twin.simulate import rest_tension

PLAN = parse_plan("""
name = "first of all"
sample_hz = 200
[pretension]
pretension_mm = [4]
rest_s = 0.3
[sweep]
frequency_hz = [3.2]
amplitude_deg = 20
settle_s = 1
periods = 3
repeats = 1
""")
"""What runs behind the guide."""

TRUE = {"drive.supply_voltage": 12.6, "imu.residual_delay": 1.5e-3}
"""What the rig file does not know of the bench, in its units."""
WITHIN = {"drive.supply_voltage": 0.06, "imu.residual_delay": 1e-3}
"""How far what is measured may be from that."""

_ALONE_S = 0.5  # until the watchdogs of a program that died have acted
_MIDDLE = math.radians(2.0)


@dataclass(frozen=True, slots=True)
class Wrong:
    """What is wrong with a bench. wiring: keys of its true wiring. is_new: motors out of their boxes. ids, bauds: of
    motors by their place, set otherwise than the wiring has them."""

    wiring: Mapping[str, Any]
    is_new: bool = False
    ids: Mapping[int, int] = field(default_factory=dict)
    bauds: Mapping[int, int] = field(default_factory=dict)


SENSES = {"tendon_pull": (1, -1, 1, -1), "drive_sign": -1, "drive_zero_counts": 2390}
NEW = Wrong({**SENSES, "tendon_ids": (2, 1, 3, 4), "imu_axes": ("+z", "-y", "+x")}, is_new=True)
"""Out of the boxes, put together in a hurry: two cables swapped, senses, middle and board otherwise."""
USED = Wrong(
    {**SENSES, "tendon_ids": (12, 3, 7, 9), "drive_id": 4, "imu_axes": ("+x", "+z", "-y")},
    bauds={0: 57_600, 4: 2_000_000},
)
"""Used motors, with ids and bauds of their own."""
DOUBLE = Wrong({**SENSES, "tendon_ids": (3, 2, 1, 4)}, ids={3: 2}, bauds={0: 57_600})
"""Two motors with one id."""


class DiedError(BaseException):
    """The program is no more."""


class MortalPort(VirtualPort):
    """A port whose program dies at a time [s], between one byte and the next; from then on nobody speaks."""

    dies_at = math.inf

    def write(self, data: bytes) -> None:
        if self.now() >= self.dies_at:
            raise DiedError
        super().write(data)


class Scene:
    """A bench with something wrong, and the person before it, who does all that is asked.

    ends: the step in which the person leaves, or the program dies, and how long after its begin [s]; None: never.
    has_joint: whether the motors have a joint to move.
    """

    def __init__(self, wrong: Wrong, *, has_joint: bool = True) -> None:
        self.spec = load_rig("paper")
        wiring = self.spec.wiring.model_copy(update=dict(wrong.wiring))
        self.true = self.spec.with_values(TRUE).model_copy(update={"wiring": wiring})
        if has_joint:
            self.bench = emulated_bench(self.true, drawn_start(self.true, 0), 0, is_new=wrong.is_new)
        else:
            self.bench = EmulatedRig(self.true, StandIn())
            if wrong.is_new:
                self.bench.unbox()
        self.motors = list(self.bench.motors.values())
        for place, number in wrong.ids.items():
            self.motors[place].registers["id"] = number
        for place, baud in wrong.bauds.items():
            self.motors[place].registers["baud_rate"] = BAUD_RATES.index(baud)
        self.port = MortalPort(self.bench)
        self.told: list[Finding] = []
        self.step, self.leaves_at = "", math.inf
        self.ends: tuple[str, float] | None = None
        self.dies = False

    @contextmanager
    def open_rig(self, spec: RigSpec) -> Iterator[tuple[Rig, Clock]]:
        """Give the bench at the baud of a rig, as a port does."""
        self.bench.line.host_baud = spec.wiring.baud
        timing = BusTiming(spec.wiring.baud, latency=1e-3 * spec.wiring.latency_ms)
        yield Rig(Bus(self.port, self.port, timing, 2), self.port, spec), self.port

    def guided(self, spec: RigSpec, steps: Sequence[Step] = STEPS) -> tuple[bool | str, RigSpec]:
        """Return whether the guide came through, or how it was broken off, and the rig that it kept last."""
        kept = [spec]
        try:
            return lead(Guide(self.open_rig, self, spec, kept.append, self.check), steps), kept[-1]
        except (StoppedError, DiedError) as end:
            return type(end).__name__, kept[-1]

    def check(self) -> None:
        """Raise where it is time to go."""
        if self.port.now() >= self.leaves_at:
            raise StoppedError("interrupted by Ctrl-C")

    def begin(self, step: Step) -> None:
        self.step = step.name
        if self.ends is not None and self.ends[0] == step.name:
            at = self.port.now() + self.ends[1]
            self.leaves_at, self.port.dies_at = (math.inf, at) if self.dies else (at, math.inf)

    def tell(self, finding: Finding) -> None:
        self.told.append(finding)

    def do(self, _words: str, act: int) -> None:
        self.check()
        self.bench.do(act)

    def agrees(self, _question: str) -> bool:
        return True

    def repeats(self, _what: str, _failed: bool) -> bool:
        return False

    def unsafe(self) -> list[str]:
        """Return what is not safe about the bench when nobody has spoken to it for a while."""
        self.bench.advance(self.bench.time + _ALONE_S)
        states = self.bench.states()
        return [] if self.bench.in_safe_state() else [f"{number}: {state}" for number, state in states.items()]


def misunderstood(scene: Scene, rig: RigSpec) -> Iterator[str]:
    """Yield what a rig takes for other than it is. All numbers of the tendons may go round with the board."""
    true, found = scene.true.wiring, rig.wiring
    count, ids = len(true.tendon_ids), [motor.id for motor in scene.motors]
    if len(set(ids)) < count + 1 or any(motor.baud != found.baud for motor in scene.motors):
        yield f"ids {ids} or bauds are not as they should be"
    turns = next((k for k in range(4) if turned_frame(true.imu_axes, k) == found.imu_axes), None)
    if turns is None:
        yield f"board {found.imu_axes}, truly {true.imu_axes}"
        return
    places = [(tendon + turns * count // 4) % count for tendon in range(count)]
    for what, told, truth in (
        ("tendons", found.tendon_ids, tuple(ids[place] for place in places)),
        ("pulls", found.tendon_pull, tuple(true.tendon_pull[place] for place in places)),
        ("drive and its sign", (found.drive_id, found.drive_sign), (ids[count], true.drive_sign)),
    ):
        if told != truth:
            yield f"{what} {told}, truly {truth}, turned by {turns}"
    if abs(found.drive_zero_counts - true.drive_zero_counts) * math.tau / 4096 > _MIDDLE:
        yield f"middle {found.drive_zero_counts}, truly {true.drive_zero_counts}"


def mismeasured(rig: RigSpec) -> Iterator[str]:
    """Yield which constants were not measured, or wrongly."""
    found = dict(rig.parameters())
    for name, value in TRUE.items():
        if found[name].origin != "measured" or abs(found[name].value - value) > WITHIN[name]:
            yield f"{name} {found[name].value:.4g} ({found[name].origin}), truly {value}"


def first_run(scene: Scene, rig: RigSpec) -> str:
    """Return how a short plan ended on the bench as a rig describes it; an empty text where it is recorded whole."""
    mm = PLAN.pretension.pretension_mm
    tension = dict(zip(mm, rest_tension(list(mm), scene.spec).tolist(), strict=True))
    texts = dump_plan(PLAN), dump_rig(rig)
    with (
        TemporaryDirectory() as folder,
        scene.open_rig(rig) as (bench, clock),
        Journal.create(Path(folder) / "journal.sqlite", *texts) as journal,
    ):
        try:
            report = Runner(bench, clock, PLAN, journal, tension).run()
        except StartError as refusal:
            return str(refusal)
    return "" if report.is_complete else report.sentence


def led(scene: Scene, spec: RigSpec) -> tuple[list[str], RigSpec]:
    """Return what was wrong about a guide that is led to its end, and the rig that it wrote."""
    well, rig = scene.guided(spec)
    unsafe = [f"unsafe behind the guide: {what}" for what in scene.unsafe()]
    if well is not True:
        faults = [f"{told.subject}: {told.found}" for told in scene.told if told.severity == "fault"]
        return [f"{well} at {scene.step}: {'; '.join(faults)}", *unsafe], rig
    return [*misunderstood(scene, rig), *mismeasured(rig), *unsafe], rig


def broken_off(scene: Scene, step: str, after_s: float, *, dies: bool) -> tuple[list[str], RigSpec]:
    """Return what was unsafe about a guide that ended in a step, by Ctrl-C or with its program, and the rig it kept."""
    scene.ends, scene.dies = (step, after_s), dies
    how, rig = scene.guided(scene.spec)
    assert (how, scene.step) == ("DiedError" if dies else "StoppedError", step)
    unsafe = [f"unsafe after {how}: {what}" for what in scene.unsafe()]
    scene.ends, scene.leaves_at, scene.port.dies_at = None, math.inf, math.inf
    if dies:
        # The next program finds what a killed one leaves: motors that stand, stopped by their watchdogs.
        assert any(state.is_tripped for state in scene.bench.states().values())
        with scene.open_rig(rig) as (bench, clock):
            stop(bench, clock, "release")
    return unsafe, rig
