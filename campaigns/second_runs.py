"""The campaign of second runs: does a bench measure right, whatever the run before it left behind?

Each pair is a first run that ends in one of seven ways on an emulated bench in virtual time, what other software may
write to the motors in between, and a second run on the same bench, by a program that knows nothing of the first.
What the second measures is held against the twin's own answer to the same plan: gain within 2 %, phase within 2°, D
within 5 %. A pair ends right; refused by a register's name; stopped, where a register changed while it ran; flagged,
where the analysis says that the recording contradicts itself; or silently wrong, which must not happen.

    python -m campaigns.second_runs --pairs 200 --seed 0 --workers 2
"""

import gc
import json
import math
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal, NamedTuple, get_args

import numpy as np
import xarray as xr

from campaigns.doctor import ONE_MOTION
from campaigns.options import campaign_parser, spread_of, spread_trials
from sinew.analysis.analysed import analyse_recording
from sinew.analysis.doubts import doubts_of
from sinew.bench.doctor import apply_fixes, call_roll, examine_motors, list_fixes
from sinew.bench.record.conversion import recording_from_journal
from sinew.bench.record.journal import Journal
from sinew.bench.run import Runner, RunReport
from sinew.bench.stops import stop
from sinew.emulator.found import VirtualPort
from sinew.emulator.joint_plant import JointPlant
from sinew.emulator.rig import EmulatedRig
from sinew.hardware.bus import Bus, BusTiming
from sinew.hardware.configuration import KNOWN_STATE
from sinew.hardware.registers import XH430_W350, Register
from sinew.hardware.rig import Rig
from sinew.measure.errors import SinewError, StartError
from sinew.measure.tasks import HERE, Spread
from sinew.plan.plan import Plan, TendonMode
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_plan, dump_rig, load_rig, parse_plan

End = Literal["normal", "hold", "release", "emergency", "killed", "lost line", "other software"]
"""How the first run ends; before the last, 30 registers change at its normal end."""

Way = Literal["fresh", "resume"]
"""How the second begins: after `sinew stop --state release` where motors have torque, or by --resume."""

Outcome = Literal["right", "refused", "stopped", "flagged", "unnamed", "silently wrong"]

BAD: tuple[Outcome, ...] = ("unnamed", "silently wrong")
"""What must not happen; unnamed: it ended without the name of what is wrong."""

GAIN, PHASE_DEG, DAMPING = 0.02, 2.0, 0.05
"""How far the second run may be from the twin: relative, degrees, relative."""

BEFORE = ONE_MOTION.format(name="a run before", settle_s=0.3, periods=2)
"""A first run that is to end by itself."""

PLAN = """
name = "second runs"
sample_hz = 200
[pretension]
pretension_mm = [6]
rest_s = 0.3
[sweep]
frequency_hz = [3.4]
amplitude_deg = 20
settle_s = 2
periods = 4
repeats = 1
[ring_down]
frequency_hz = [3.7, 3.7]
amplitude_deg = 20
drive_s = 1.5
record_s = 2
repeats = 1
"""

_SLACK_M = (1.0e-3, 2.5e-3, 1.8e-3, 0.6e-3)
_LONGEST_S = 60.0
_EARLIEST_S, _LATEST_S = 0.5, 16.0  # of the first run's end: pull, change of mode, levelling, sweep
_ALONE_S = 0.5  # until the watchdogs have acted and a motor that started anew listens
_MEDDLED, _DISTURBED, _LETHAL, _GENTLE = 0.15, 0.4, 0.08, 0.5
_MOST = 30
# What makes a motor deaf, or drives it: alone, or hardly a pair would get any further.
_LETHAL_ONES = ("id", "baud_rate", "protocol_type", "status_return_level", "torque_enable")
_REFUSED = tuple({row.register for row in KNOWN_STATE if row.is_refused})


class Write(NamedTuple):
    """What other software writes: counts to a register of a motor, by id."""

    device: int
    register: str
    counts: int


@dataclass(frozen=True, slots=True)
class Pair:
    """A first run and a second.

    end_s: when the first ends, unless normally [s after its begin]. writes: of other software between the two, or, at
    `meddle_s` [s after the second's first sample], beside the second.
    """

    number: int
    mode: TendonMode
    end: End
    way: Way
    end_s: float
    writes: tuple[Write, ...]
    meddle_s: float = math.inf
    seed: int = 0


@dataclass(slots=True)
class Result:
    """What became of a pair. sentence: of the refusal or the end. off: the worst of the second run's values, in parts
    of what is allowed, by name. doubts: of the analysis. after_doctor: what became of a refused one after his --fix."""

    number: int
    mode: str
    end: str
    way: str
    end_s: float
    writes: list[str]
    outcome: str = "unnamed"
    sentence: str = ""
    first: str = ""
    off: dict[str, float] = field(default_factory=dict)
    doubts: list[str] = field(default_factory=list)
    after_doctor: str = ""
    wall_s: float = 0.0


class KilledError(BaseException):
    """The process of the first run is gone; nothing of it may act any more."""


class _MortalPort(VirtualPort):
    """A port whose master dies at a time [s], so that nothing of it speaks any more."""

    dies_at = math.inf
    ends_at = math.inf

    def write(self, data: bytes) -> None:
        if self.now() >= self.dies_at:
            raise KilledError
        if self.now() >= self.ends_at:
            raise RuntimeError(f"no end of the run after {_LONGEST_S:g} s")
        super().write(data)


class _Watcher:
    """Sees a run, and does something once, so long after its begin [s]; a Listener."""

    def __init__(self, port: VirtualPort, at_s: float, act: object) -> None:
        self._port, self._at, self._act = port, port.now() + at_s, act
        self._done = False

    def on_sample(self, _sample: object) -> None:
        if not self._done and self._port.now() >= self._at:
            self._done = True
            assert callable(self._act)
            self._act()

    def on_event(self, event: object) -> None:
        pass


def plan_of(mode: TendonMode, text: str = PLAN) -> Plan:
    """Return a plan, of the second run and of a first that is cut short, in a tendon mode."""
    plan = parse_plan(text)
    return plan.model_copy(update={"pretension": plan.pretension.model_copy(update={"mode": mode})})


def draw_pair(seed: int, number: int) -> Pair:
    """Return pair `number` of the campaign with that seed; every end meets every mode in turn."""
    rng = np.random.default_rng([seed, number])
    ends, modes = get_args(End), get_args(TendonMode)
    end: End = ends[number % len(ends)]
    mode: TendonMode = modes[number % len(modes)]  # seven and three have no common factor
    way: Way = "resume" if end != "other software" and rng.random() < 1 / 3 else "fresh"
    writes: tuple[Write, ...] = ()
    meddle = math.inf
    if end == "other software":
        writes = draw_writes(rng, _MOST)
    elif rng.random() < _DISTURBED:
        writes = draw_writes(rng, int(rng.integers(1, _MOST + 1)))
    if writes and end != "other software" and rng.random() < _MEDDLED / _DISTURBED:
        meddle = round(float(rng.uniform(0.0, 18.0)), 3)
    return Pair(
        number=number,
        mode=mode,
        end=end,
        way=way,
        end_s=round(float(rng.uniform(_EARLIEST_S, _LATEST_S)), 3),
        writes=writes,
        meddle_s=meddle,
        seed=int(rng.integers(1 << 31)),
    )


def draw_writes(rng: np.random.Generator, count: int) -> tuple[Write, ...]:
    """Return what other software writes: so many registers of random motors, each to anything that it can hold."""
    spec = load_rig("paper")
    devices = (*spec.wiring.tendon_ids, spec.wiring.drive_id)
    left = () if rng.random() < _GENTLE else _REFUSED  # of what a run refuses: in half of the pairs none
    rows = [
        row
        for row in XH430_W350
        if row.writable and not row.name.startswith("indirect") and row.name not in (*_LETHAL_ONES, *left)
    ]
    drawn = [(int(rng.choice(devices)), rows[int(rng.integers(len(rows)))]) for _ in range(count)]
    writes = [Write(device, row.name, _any_count(rng, row)) for device, row in drawn]
    if rng.random() < _LETHAL:
        row = XH430_W350[_LETHAL_ONES[int(rng.integers(len(_LETHAL_ONES)))]]
        writes.append(Write(int(rng.choice(devices)), row.name, _any_count(rng, row)))
    return tuple(writes)


def _any_count(rng: np.random.Generator, row: Register) -> int:
    count = int(rng.integers(row.lowest, row.highest, endpoint=True))
    # With torque by goal another program would swing the joint at once; that is no run's fault.
    return count & ~0x08 if row.name == "drive_mode" else count


@cache
def truth(mode: TendonMode) -> tuple[xr.Dataset, dict[float, float]]:
    """Return what the twin itself gives for the plan, and the tension of each tendon at rest [N]."""
    from sinew.twin.parameters import Effects
    from sinew.twin.simulate import rest_tension, simulate

    rig, plan = load_rig("paper"), plan_of(mode)
    asked = sorted({*plan.pretension.pretension_mm, *parse_plan(BEFORE).pretension.pretension_mm})
    tension = dict(zip(asked, rest_tension(asked, rig).tolist(), strict=True))
    return analyse_recording(simulate(plan, rig, effects=Effects().without("repeatability")), rig), tension


class Bench:
    """An emulated bench that stays, and the programs that come and go on it."""

    def __init__(self, spec: RigSpec, seed: int) -> None:
        self.spec = spec
        self.emulated = EmulatedRig(spec, JointPlant(spec, slack_m=_SLACK_M, rest_tilt=(0.012, -0.012)), seed=seed)

    def program(self) -> tuple[Rig, _MortalPort]:
        """Return the bench as a new program sees it: it knows nothing of the one before."""
        port = _MortalPort(self.emulated)
        port.ends_at = port.now() + _LONGEST_S
        timing = BusTiming(self.spec.wiring.baud, latency=1e-3 * self.spec.wiring.latency_ms)
        return Rig(Bus(port, port, timing, retries=2), port, self.spec), port

    def run(
        self, plan: Plan, folder: Path, *, resume: bool = False, at_s: float = math.inf, act: str | object = ""
    ) -> RunReport:
        """Run a plan as a new program would. act: at `at_s`, an `End`, or what else is to be called.

        Raises StartError, and KilledError where the program was killed.
        """
        rig, port = self.program()
        texts = (dump_plan(plan), dump_rig(self.spec))
        path = folder / "journal.sqlite"
        _, tension = truth(plan.pretension.mode)
        with Journal.open(path, *texts) if resume else Journal.create(path, *texts) as journal:
            acts = {
                "hold": lambda: runner.steering.request_stop("asked to hold", "hold"),
                "release": lambda: runner.steering.request_stop("asked to release", "release"),
                "emergency": lambda: runner.steering.request_emergency("emergency"),
                "killed": lambda: setattr(port, "dies_at", port.now()),
                "lost line": lambda: setattr(self.emulated, "unplugged", True),
            }
            watcher = _Watcher(port, at_s, acts.get(act, act) if isinstance(act, str) else act)
            runner: Runner = Runner(rig, port, plan, journal, tension, listener=watcher)
            return runner.run(resume=resume)

    def write(self, writes: Sequence[Write]) -> None:
        """Write to the motors as other software does; what a motor refuses it refuses."""
        rig, port = self.program()
        tables = {motor.id: motor.table for motor in rig.motors}
        for one in writes:
            row = tables[one.device][one.register]
            data = one.counts.to_bytes(row.size, "little", signed=row.signed)
            rig.bus.write(one.device, row.address, data, retries=0)
        port.wait_until(port.now() + 0.05)

    def meddle(self, writes: Sequence[Write]) -> None:
        """Write to the motors while a run is at work, as by another master on the same line."""
        for one in writes:
            motor = self.emulated.motors[one.device]
            row = motor.registers.rows[one.register]
            motor.write(row.address, one.counts.to_bytes(row.size, "little", signed=row.signed), self.emulated.time)

    def leave_alone(self, seconds: float = _ALONE_S) -> None:
        """Let time pass in which nobody speaks."""
        self.emulated.advance(self.emulated.time + seconds)


def try_pair(pair: Pair) -> Result:
    """Run a pair and return what became of it."""
    began = time.perf_counter()
    result = Result(
        pair.number, pair.mode, pair.end, pair.way, pair.end_s,
        [f"{one.device}:{one.register}={one.counts}" for one in pair.writes],
    )  # fmt: skip
    if math.isfinite(pair.meddle_s):
        result.writes.insert(0, f"during the second run, {pair.meddle_s:g} s")
    bench, plan = Bench(load_rig("paper"), pair.seed), plan_of(pair.mode)
    gc.disable()
    try:
        with TemporaryDirectory() as first, TemporaryDirectory() as second:
            _first_run(bench, pair, Path(first), result)
            folder = Path(first) if pair.way == "resume" and result.first != "complete" else Path(second)
            _second_run(bench, plan, pair, folder, result)
    finally:
        gc.enable()
        gc.collect(1)
    result.wall_s = round(time.perf_counter() - began, 2)
    return result


def _first_run(bench: Bench, pair: Pair, folder: Path, result: Result) -> None:
    early = pair.end not in ("normal", "other software")
    plan = plan_of(pair.mode, PLAN if early else BEFORE)
    try:
        report = bench.run(plan, folder, at_s=pair.end_s if early else math.inf, act=pair.end)
        result.first = "complete" if report.is_complete else report.sentence
    except KilledError:
        result.first = "killed"
    bench.leave_alone()
    bench.emulated.unplugged = False
    if not math.isfinite(pair.meddle_s):
        bench.write(pair.writes)


def _second_run(bench: Bench, plan: Plan, pair: Pair, folder: Path, result: Result) -> None:
    resume = (folder / "journal.sqlite").exists()
    act = partial(bench.meddle, pair.writes)
    try:
        if not resume:
            rig, port = bench.program()
            if any(state.torque for state in bench.emulated.states().values()):
                _refuses_torque(bench, plan, folder, result)
                stop(rig, port, "release")
        report = bench.run(plan, folder, resume=resume, at_s=pair.meddle_s, act=act)
    except StartError as refusal:
        result.sentence = str(refusal)
        result.outcome = "refused" if _is_named(result.sentence, pair) else "unnamed"
        result.after_doctor = _after_doctor(bench, plan, folder)
        if result.after_doctor.startswith("silently wrong"):
            result.outcome = "silently wrong"
        return
    result.sentence = report.sentence
    if report.groups_done:
        result.off, result.doubts = compare(folder / "journal.sqlite", pair.mode)
    if worst := [name for name, share in result.off.items() if not share <= 1.0]:
        result.outcome = "flagged" if result.doubts else "silently wrong"
        result.sentence += f" (off: {', '.join(worst)})"
    elif report.is_complete:
        result.outcome = "right"
    else:
        # Beside a run other software may do anything to it; what it did before must be named.
        meddled = math.isfinite(pair.meddle_s) and bool(report.sentence)
        result.outcome = "stopped" if meddled or _is_named(report.sentence, pair) else "unnamed"


def _refuses_torque(bench: Bench, plan: Plan, folder: Path, result: Result) -> None:
    """Try a run on motors under torque, which must be refused and leave nothing behind."""
    with TemporaryDirectory(dir=folder) as apart:
        try:
            report = bench.run(plan, Path(apart))
        except StartError as refusal:
            result.first += f"; then refused: {refusal}"
        else:
            raise AssertionError(f"a run on motors under torque was not refused but ended: {report.sentence}")


def _after_doctor(bench: Bench, plan: Plan, folder: Path) -> str:
    """Have the doctor put right what he can, run again, and say what became of that."""
    rig, port = bench.program()
    try:
        stop(rig, port, "release")
        apply_fixes(rig, port, list_fixes(examine_motors(rig, call_roll(rig))))
        with TemporaryDirectory(dir=folder) as apart:
            report = bench.run(plan, Path(apart))
            if not report.is_complete:
                return f"stopped: {report.sentence}"
            off, _ = compare(Path(apart) / "journal.sqlite", plan.pretension.mode)
    except StartError as refusal:
        return f"refused: {refusal}"
    return "right" if all(share <= 1.0 for share in off.values()) else f"silently wrong: {off}"


def compare(journal: Path, mode: TendonMode) -> tuple[dict[str, float], list[str]]:
    """Return how far what a journal measured is from the twin, in parts of what is allowed, and its doubts.

    Groups that are not in the recording are not compared; NaN where one has no value.
    """
    try:
        found = analyse_recording(recording_from_journal(journal), load_rig("paper"))
    except SinewError:
        return {}, []  # no whole group: nothing was measured
    twin, _ = truth(mode)
    off = {
        "gain": np.abs(found["gain"].values / twin["gain"].values - 1) / GAIN if "gain" in found else None,
        "phase": np.abs(np.degrees(found["phase_lag_rad"].values - twin["phase_lag_rad"].values)) / PHASE_DEG
        if "phase_lag_rad" in found
        else None,
        "D": np.abs(found["damping_ratio"].values / twin["damping_ratio"].values - 1) / DAMPING
        if "damping_ratio" in found
        else None,
    }
    worst = {name: round(float(np.max(share)), 3) for name, share in off.items() if share is not None and share.size}
    return worst, [str(doubt["sentence"]) for doubt in doubts_of(found)]


def _is_named(sentence: str, pair: Pair) -> bool:
    """Return whether a sentence names a register that other software wrote, as the table does or as people do."""
    names = {one.register for one in pair.writes}
    said = {name for name in names if name in sentence or name.replace("_", " ") in sentence}
    return bool(said) or ("torque_enable" in names and "torque is on" in sentence)


def results(seed: int, numbers: Sequence[int], spread: Spread = HERE) -> Iterator[Result]:
    """Yield what becomes of each pair, in order."""
    yield from spread_trials(partial(_try_number, seed), numbers, spread=spread)


def _try_number(seed: int, number: int) -> Result:
    return try_pair(draw_pair(seed, number))


def text(done: Sequence[Result]) -> str:
    """Return the table: how the pairs of each end came out."""
    outcomes = get_args(Outcome)
    rows = [("end of the first run", "pairs", *outcomes)]
    for end in (*get_args(End), "all"):
        of_end = [one for one in done if end in ("all", one.end)]
        counts = Counter(one.outcome for one in of_end)
        rows.append((end, str(len(of_end)), *(str(counts[outcome]) for outcome in outcomes)))
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = []
    for name, *cells in rows:
        numbers = (cell.rjust(width) for cell, width in zip(cells, widths[1:], strict=True))
        lines.append("  ".join((name.ljust(widths[0]), *numbers)))
    by_mode = Counter((one.mode, one.outcome) for one in done)
    for mode in get_args(TendonMode):
        counted = [f"{number} {outcome}" for (of, outcome), number in sorted(by_mode.items()) if of == mode]
        lines.append(f"{mode}: {', '.join(counted) or 'none'}")
    right = [one for one in done if one.outcome == "right"]
    if right:
        worst = {name: max(one.off.get(name, 0.0) for one in right) for name in ("gain", "phase", "D")}
        doubted = sum(bool(one.doubts) for one in right)
        lines.append(
            f"the right ones are off by at most {100 * GAIN * worst['gain']:.2f} % in gain, "
            f"{PHASE_DEG * worst['phase']:.2f}° in phase, {100 * DAMPING * worst['D']:.2f} % in D; "
            f"{doubted} are doubted"
        )
    doctored = Counter(one.after_doctor.split(":")[0] for one in done if one.after_doctor)
    counted = [f"{number} {outcome}" for outcome, number in doctored.items()]
    lines.append(f"the refused, after `sinew doctor --fix`: {', '.join(counted) or 'none'}")
    for one in done:
        if one.outcome in BAD:
            lines.append(f"!! {one.number} {one.mode}, {one.end}: {one.outcome}: {one.sentence} {one.off}")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the campaign, print its table, and return the exit status."""
    parser = campaign_parser("second_runs", __doc__, count=200, of="pairs", numbered=True, workers=1, verbose=True)
    given = parser.parse_args(arguments)
    done: list[Result] = []
    for one in results(given.seed, range(given.first, given.first + given.pairs), spread_of(given)):
        done.append(one)
        if given.verbose:
            print(f"{one.number} {one.mode}, {one.end} at {one.end_s} s, {one.way}, {len(one.writes)} writes -> "
                  f"{one.outcome} {one.off} {one.sentence} | first: {one.first} | doctor: {one.after_doctor} "
                  f"[{one.wall_s} s]", file=sys.stderr, flush=True)  # fmt: skip
    if given.out is not None:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        document = {"seed": given.seed, "table": text(done), "pairs": [asdict(one) for one in done]}
        given.out.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    print(text(done))
    return 1 if any(one.outcome in BAD for one in done) else 0


if __name__ == "__main__":
    sys.exit(main())
