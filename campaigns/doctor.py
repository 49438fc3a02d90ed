"""The campaign of the guide: emulated benches that are set and wired wrongly, led to a first run.

Each seed draws what is wrong (ids, bauds, a swapped pair of tendons, pulleys wound the other way, a reversed lever,
its middle, the board) and constants that are not the rig file's. The guide gets it in virtual time, with a person who
does what is asked; in half of the seeds first one who breaks off at a random moment, or whose computer dies. Then a
short plan runs on the rig that it wrote. Held against what was drawn: ids and bauds, places, senses, the lever's
middle, the board's axes, drive and delay; and that motors were safe at every end, as the mechanics say.

    python -m campaigns.doctor --seeds 50 --workers 2
"""

import itertools
import json
import math
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from campaigns.options import asked_seeds, spread_of, spread_trials, trial_parser
from sinew.bench.doctor import Finding
from sinew.bench.guide import STEPS, Guide, Step, lead, turned_frame
from sinew.bench.record.journal import Journal
from sinew.bench.run import Runner
from sinew.emulator.faults import FaultyRig
from sinew.emulator.found import Hands, Unbuilt, VirtualPort, draw_unbuilt, drawn_start, found_bench
from sinew.emulator.rig import EmulatedRig
from sinew.hardware.bus import Bus, BusTiming, Clock
from sinew.hardware.registers import BAUD_RATES
from sinew.hardware.rig import Rig
from sinew.measure.errors import SinewError, StartError, StoppedError
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_plan, dump_rig, load_rig, parse_plan

ONE_MOTION = """
name = "{name}"
sample_hz = 200
[pretension]
pretension_mm = [4]
rest_s = 0.3
[sweep]
frequency_hz = [3.2]
amplitude_deg = 20
settle_s = {settle_s}
periods = {periods}
repeats = 1
"""
"""A plan of one motion, without its name and how long it takes."""

PLAN = ONE_MOTION.format(name="first of all", settle_s=1, periods=3)
"""What runs behind the guide."""

SCENES: tuple[tuple[str, ...], ...] = (
    ("new", "tendons", "pulls", "lever", "zero", "board"),
    ("new", "tendons", "pulls", "lever", "zero"),
    ("ids", "baud", "pulls", "lever", "zero", "board"),
    ("double", "baud", "tendons", "pulls", "zero"),
    ("tendons", "lever", "baud", "board"),
)
"""What is wrong, in turn."""

_ALONE_S = 0.5  # until the watchdogs of a program that died have acted
_MIDDLE = math.radians(2.0)
_CHANCES = {"drive.friction": (0.1, 0.35), "drive.supply_voltage": (11.5, 14.5), "imu.residual_delay": (0.2e-3, 3e-3)}
_WITHIN = {
    "drive.friction": 0.03,
    "drive.supply_voltage": 0.06,
    "drive.no_load_speed": 0.15,
    "imu.residual_delay": 1e-3,
}
"""How far what is measured may be from what was drawn, in the units that the rig keeps."""


class DiedError(BaseException):
    """The program is no more."""


class MortalPort(VirtualPort):
    """A port whose program dies at a time [s], between one byte and the next; from then on nobody speaks."""

    dies_at = math.inf

    def write(self, data: bytes) -> None:
        if self.now() >= self.dies_at:
            raise DiedError
        super().write(data)


class Playing:
    """A person who does all that is asked, and breaks off at a time [s]."""

    def __init__(self, hands: Hands, port: MortalPort, leaves_at: float = math.inf) -> None:
        self._hands, self._port, self._leaves_at = hands, port, leaves_at
        self.told: list[Finding] = []
        self.step = ""

    def check(self) -> None:
        """Raise where it is time to go."""
        if self._port.now() >= self._leaves_at:
            raise StoppedError("interrupted by Ctrl-C")

    def begin(self, step: Step) -> None:
        self.step = step.name

    def tell(self, finding: Finding) -> None:
        self.told.append(finding)

    def do(self, _words: str, act: str) -> None:
        self.check()
        self._hands.do(act)

    def agrees(self, _question: str) -> bool:
        return True

    def repeats(self, _what: str, _failed: bool) -> bool:
        return False


@dataclass(slots=True)
class Verdict:
    """What became of a seed. wrong: what must not be, in words. s: the guide's time, and that of the run [s]."""

    seed: int
    kinds: tuple[str, ...]
    broke_off: str = ""
    ended: str = ""
    named: list[str] = field(default_factory=list)
    off: dict[str, float] = field(default_factory=dict)
    guide_s: float = 0.0
    run: str = ""
    wall_s: float = 0.0
    wrong: list[str] = field(default_factory=list)


@dataclass(slots=True)
class Scene:
    """A bench with something wrong, and how it is opened."""

    spec: RigSpec
    unbuilt: Unbuilt
    bench: FaultyRig
    port: MortalPort
    hands: Hands

    @contextmanager
    def open_rig(self, spec: RigSpec) -> Iterator[tuple[Rig, Clock]]:
        """Give the bench at the baud of a rig, as a port does."""
        self.bench.line.host_baud = spec.wiring.baud
        timing = BusTiming(spec.wiring.baud, latency=1e-3 * spec.wiring.latency_ms)
        yield Rig(Bus(self.port, self.port, timing, 2), self.port, spec), self.port

    @property
    def emulated(self) -> EmulatedRig:
        """The bench behind the line."""
        return self.bench.rig


def make_scene(seed: int, kinds: Sequence[str], *, drawn: bool = True) -> Scene:
    """Return the bench of a seed. drawn: whether its constants are not the rig file's."""
    spec = load_rig("paper")
    chance = np.random.default_rng([seed, 4])
    true = spec.with_values({name: float(chance.uniform(*ends)) for name, ends in _CHANCES.items()}) if drawn else spec
    unbuilt = draw_unbuilt(true, kinds, seed)
    bench = found_bench(true, drawn_start(true, seed), seed, unbuilt=unbuilt)
    return Scene(spec, unbuilt, bench, MortalPort(bench), Hands(bench.rig, unbuilt))


def guided(scene: Scene, person: Playing, spec: RigSpec, steps: Sequence[Step] = STEPS) -> tuple[bool, RigSpec]:
    """Return whether the guide came through, and the rig that it kept last."""
    kept = [spec]
    guide = Guide(scene.open_rig, person, spec, kept.append, person.check)
    return lead(guide, steps), kept[-1]


def unsafe(scene: Scene) -> str:
    """Return what is not safe about a bench that nobody speaks to any more; an empty text where all is."""
    scene.bench.advance(scene.bench.time + _ALONE_S)
    states = scene.emulated.states()
    if scene.emulated.in_safe_state():
        return ""
    return "; ".join(f"{number}: {state}" for number, state in states.items())


def misunderstood(scene: Scene, rig: RigSpec) -> Iterator[str]:
    """Yield what the guide took for other than it is. All numbers of the tendons may go round with the board."""
    true, found, motors = scene.unbuilt.spec.wiring, rig.wiring, list(scene.emulated.motors.values())
    count = len(true.tendon_ids)
    ids = [motor.id for motor in motors]
    if len(set(ids)) < count + 1:
        yield f"ids {ids} are not each another"
    if any(BAUD_RATES[motor.registers["baud_rate"]] != found.baud for motor in motors):
        yield "bauds differ"
    if found.drive_id != ids[count]:
        yield f"drive is {found.drive_id}, truly {ids[count]}"
    turns = next((k for k in range(4) if turned_frame(true.imu_axes, k) == found.imu_axes), None)
    if turns is None:
        yield f"board {found.imu_axes}, truly {true.imu_axes}"
        return
    places = [(tendon + turns * count // 4) % count for tendon in range(count)]
    if [ids[place] for place in places] != list(found.tendon_ids):
        yield f"tendons {found.tendon_ids}, truly {[ids[place] for place in places]}"
    if [true.tendon_pull[place] for place in places] != list(found.tendon_pull):
        yield f"pulls {found.tendon_pull}, truly {true.tendon_pull}, turned {turns}"
    if found.drive_sign != true.drive_sign:
        yield f"lever {found.drive_sign}, truly {true.drive_sign}"
    if abs(found.drive_zero_counts - true.drive_zero_counts) * math.tau / 4096 > _MIDDLE:
        yield f"middle {found.drive_zero_counts}, truly {true.drive_zero_counts}"


def deviations(scene: Scene, rig: RigSpec) -> dict[str, float]:
    """Return by how much each constant is off, in the rig's units; NaN for one that was not measured."""
    true, found = dict(scene.unbuilt.spec.parameters()), dict(rig.parameters())
    measured = {name for name in _WITHIN if found[name].origin == "measured"}
    return {name: found[name].value - true[name].value if name in measured else math.nan for name in _WITHIN}


@cache
def _tension(mm: tuple[float, ...]) -> dict[float, float]:
    from sinew.twin.simulate import rest_tension

    return dict(zip(mm, rest_tension(list(mm), load_rig("paper")).tolist(), strict=True))


def first_run(scene: Scene, rig: RigSpec) -> tuple[bool, str]:
    """Return whether a short plan is recorded whole on the bench as the rig describes it, and how it ended."""
    plan: Plan = parse_plan(PLAN)
    with TemporaryDirectory() as folder, scene.open_rig(rig) as (bench, clock):
        texts = (dump_plan(plan), dump_rig(rig))
        with Journal.create(Path(folder) / "journal.sqlite", *texts) as journal:
            runner = Runner(bench, clock, plan, journal, _tension(plan.pretension.pretension_mm))
            try:
                report = runner.run()
            except StartError as refusal:
                return False, str(refusal)
    return report.is_complete, report.sentence


def try_seed(seed: int, *, with_run: bool = True) -> Verdict:
    """Return what became of one bench."""
    began = time.process_time()
    kinds = SCENES[seed % len(SCENES)]
    scene, chance = make_scene(seed, kinds), np.random.default_rng([seed, 5])
    verdict, spec = Verdict(seed, scene.unbuilt.kinds), scene.spec
    if seed % 2:
        spec = _broken_off(scene, verdict, chance)
    person = Playing(scene.hands, scene.port)
    start = scene.port.now()
    try:
        well, rig = guided(scene, person, spec)
        verdict.ended = "came through" if well else f"ended at {person.step}"
    except SinewError as trouble:
        well, rig, verdict.ended = False, spec, f"{type(trouble).__name__}: {trouble}"
    verdict.guide_s = scene.port.now() - start
    verdict.named = [f"{told.subject}: {told.found}" for told in person.told if told.severity == "note"]
    faults = [f"{told.subject}: {told.found}" for told in person.told if told.severity == "fault"]
    if not well:
        verdict.wrong.append(f"{verdict.ended}; {'; '.join(faults)}")
    if left := unsafe(scene):
        verdict.wrong.append(f"unsafe behind the guide: {left}")
    if well:
        verdict.wrong += misunderstood(scene, rig)
        verdict.off = deviations(scene, rig)
        verdict.wrong += [f"{name} off by {off:.3g}" for name, off in verdict.off.items() if abs(off) > _WITHIN[name]]
        if with_run:
            complete, verdict.run = first_run(scene, rig)
            if not complete:
                verdict.wrong.append(f"the first run: {verdict.run}")
            if left := unsafe(scene):
                verdict.wrong.append(f"unsafe behind the run: {left}")
    verdict.wall_s = time.process_time() - began
    return verdict


def _broken_off(scene: Scene, verdict: Verdict, chance: np.random.Generator) -> RigSpec:
    """Begin, and break off at a drawn moment, by Ctrl-C or because the program dies; return the rig that was kept."""
    at = scene.port.now() + float(chance.uniform(1.0, 75.0))
    dies = bool(chance.integers(2))
    person = Playing(scene.hands, scene.port, math.inf if dies else at)
    scene.port.dies_at = at if dies else math.inf
    kept = [scene.spec]
    guide = Guide(scene.open_rig, person, scene.spec, kept.append, person.check)
    try:
        lead(guide, STEPS)
        how = "came through before"
    except StoppedError:
        how = "Ctrl-C"
    except DiedError:
        how = "died"
    verdict.broke_off = f"{how} at {person.step}"
    if left := unsafe(scene):
        verdict.wrong.append(f"unsafe after {verdict.broke_off}: {left}")
    if how == "died":
        # The next program finds what a killed one leaves: motors that stand, stopped by their watchdogs.
        from sinew.bench.stops import stop

        scene.port.dies_at = math.inf
        with scene.open_rig(kept[-1]) as (rig, clock):
            stop(rig, clock, "release")
    scene.port.dies_at = math.inf
    return kept[-1]


def main(arguments: Sequence[str]) -> int:
    """Run the campaign; return 1 where something was wrong."""
    parser = trial_parser("doctor", __doc__, count=50, of="benches", workers=1)
    parser.add_argument("--out", type=Path, help="file for the verdicts, as JSON")
    asked = parser.parse_args(arguments)
    verdicts: list[Verdict] = []
    for verdict in spread_trials(try_seed, asked_seeds(asked), spread=spread_of(asked)):
        verdicts.append(verdict)
        said = "; ".join(verdict.wrong) or "well"
        print(
            f"{verdict.seed}: {verdict.broke_off or '-'}; {verdict.ended}; {verdict.guide_s:.0f} s; {said}", flush=True
        )
    wrong = [verdict for verdict in verdicts if verdict.wrong]
    kinds = Counter(itertools.chain.from_iterable(verdict.kinds for verdict in verdicts))
    print(f"{len(verdicts)} benches, {len(wrong)} wrong; {', '.join(f'{kind} {n}' for kind, n in kinds.items())}")
    for name, within in _WITHIN.items():
        offs = np.array([verdict.off[name] for verdict in verdicts if name in verdict.off])
        if offs.size:
            rms, most = math.sqrt(float(np.nanmean(offs**2))), float(np.nanmax(np.abs(offs)))
            print(f"{name}: rms {rms:.3g}, most {most:.3g}, allowed {within}")
    if asked.out is not None:
        asked.out.write_text(json.dumps([asdict(verdict) for verdict in verdicts], indent=1))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
