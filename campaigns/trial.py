"""One run of the campaign in virtual time, and the verdict on it.

What may not happen, whatever the fault (`Verdict.violations`): a reading in the recording, or in the journal, that was
not true; an end outside the safe state, as the motors are and not as their registers say; an end that the report calls
safe and that is not the declared one; an end without a sentence; an error that has no name; a run without end; a
recording that lacks a group that was reported as done; an early end where nothing was wrong.
"""

import math
import time
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import xarray as xr
from scipy.interpolate import CubicHermiteSpline

from campaigns.scenario import FALSE_KINDS, HostileLine, Scenario, Timeline, plan_of, rig_of
from sinew.bench.record.conversion import recording_from_journal
from sinew.bench.record.journal import Journal, JournalReader
from sinew.bench.record.sample import Sample
from sinew.bench.run import Runner, RunReport
from sinew.emulator.bench import EmulatedRig, MotorState, VirtualPort
from sinew.emulator.device import SAMPLE_PERIOD
from sinew.emulator.faults import Faults
from sinew.emulator.plant import HornMotion, JointPlant, Motion
from sinew.hardware.bus import Bus, BusTiming
from sinew.hardware.rig import Rig
from sinew.measure.arrays import Array
from sinew.measure.errors import SinewError, StartError
from sinew.measure.events import Event
from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec
from sinew.plan.servo import SERVOS
from sinew.plan.toml import dump_plan, dump_rig
from sinew.tune.track import ExpectedBackbone, Tracker, planned_tracker

# How the joint really moved, and what a reading may have been.
#
# A reading is right if the truth had that value at the time it is filed under, give or take what the bench cannot know:
#
# * **When.** A motor's clock ticks in milliseconds, and an answer counts as fresh if it is within 3 ms of where that
#   clock should be (`sinew.hardware.imu`); a cycle's answers follow the drive's by at most the time of their bytes. The
#   sensor's samples lie, in a recording, on a line through the host's times, which is good to half a millisecond, and 1
#   ms is allowed; in the journal they have the 3 ms of the answer that brought them.
# * **How much.** An encoder tells whole counts, half a count either way, and the emulated mechanics, which tell an
#   angle between two ticks of 1.25 ms at the speed of the first, are off by ½ a t², 0.1 count at the strongest swing. A
#   current and a duty are half a unit of their registers off. The gyroscope has bias, noise behind its average of
#   three, and a dead band.
#
# So with `Truth.range` every reading gets a window in time and the lowest and highest true value in it. An answer that
# is a cycle of 5 ms old at more than 0.6 rad/s of the lever lies outside.

MOTOR_S = 3.1e-3
"""How far off the time of a motor's fresh reading may be [s]."""

SENSOR_S = 1.0e-3
"""How far off the time of a sensor's reading in a recording may be [s]."""

TENDON_COUNTS = 2048
"""What the encoders of the tendon motors read in the beginning."""

_ENCODER = 0.75  # counts
_REGISTER = 0.6  # counts
_SIGMAS = 6.0
_BIASES = 4.5
_STEP_S = 5.1e-3  # between two looks at the joint, at most; the sensor alone looks every 5 ms
_SWING = 8e-3  # rad/s: ½ φ''' t² of the gyro between two ticks, at the strongest swing
_FORCE = 0.05  # m/s²: the same of the accelerometer


class Witness(JointPlant):
    """A joint whose every motion is written down. Nothing about it changes, except that it is looked at more often."""

    def __init__(self, spec: RigSpec, slack_m: Sequence[float], rest_tilt: tuple[float, float]) -> None:
        self._witnessed = array("d")
        self._newest, self._is_looking = 0.0, False
        super().__init__(spec, slack_m=slack_m, rest_tilt=rest_tilt)

    def advance(self, until: float) -> None:
        while until - self._newest > _STEP_S:
            super().advance(self._newest + _STEP_S)
            self.motion()
        super().advance(until)

    def motion(self) -> Motion:
        self._is_looking = True
        motion = super().motion()
        self._is_looking = False
        drive = motion.drive
        self._witnessed.extend((motion.time, drive.angle, drive.speed, drive.current, drive.duty))
        self._witnessed.extend([tendon.angle for tendon in motion.tendons])
        self._witnessed.extend([tendon.current for tendon in motion.tendons])
        self._witnessed.append(motion.gyro[0])
        self._witnessed.extend(motion.acceleration)
        self._newest = motion.time
        return motion

    def horn(self, motor: int) -> HornMotion:
        if motor not in self._horns and not self._is_looking:
            self.motion()  # every horn that a device looks at is written down with all
        return super().horn(motor)

    def truth(self, spec: RigSpec) -> "Truth":
        """Return what was seen."""
        rows = np.frombuffer(self._witnessed.tobytes()).reshape(-1, 9 + 2 * self.count)
        return Truth(rows, spec)


class Truth:
    """How the joint moved. rows: of a `Witness`."""

    def __init__(self, rows: Array, spec: RigSpec) -> None:
        self.time, last = np.unique(rows[::-1, 0], return_index=True)
        rows = rows[::-1][last]
        count = spec.tendons.count
        self.values: dict[str, Array] = {"drive_rad": rows[:, 1], "drive_current_a": rows[:, 3]}
        self.values["drive_pwm"] = rows[:, 4]
        zero = TENDON_COUNTS * math.tau / spec.tendons.counts_per_turn.value
        for i in range(count):
            self.values[f"tendon_{i + 1}_rad"] = rows[:, 5 + i] + zero
            self.values[f"tendon_{i + 1}_current_a"] = rows[:, 5 + count + i]
        gyro, force = rows[:, 5 + 2 * count], rows[:, 6 + 2 * count :]
        # About y and z the low-pass is left out of the mechanics, and a head that tips over is too quick for us.
        samples = SAMPLE_PERIOD * np.arange(spec.imu.average_samples)
        gyro, force, full = rows[:, 5 + 2 * count], rows[:, 6 + 2 * count :], spec.imu.accelerometer_range.value
        self.values["gyro_x_rad_s"] = np.mean(
            [np.interp(self.time - late, self.time, gyro) for late in samples], axis=0
        )
        for axis, letter in enumerate("xyz"):
            self.values[f"acceleration_{letter}_m_s2"] = np.clip(force[:, axis], -full, full)
        self._shown_late = spec.imu.residual_delay.value
        self._drive = CubicHermiteSpline(self.time, rows[:, 1], rows[:, 2]) if self.time.size > 1 else None
        self._tolerance = _tolerances(spec)

    def range(self, name: str, begin: Array, end: Array) -> tuple[Array, Array]:
        """Return the lowest and the highest value between two times [s], by row."""
        values = self.values[name]
        if name.startswith(("gyro", "acceleration")):
            begin, end = begin - self._shown_late, end - self._shown_late
        edges = np.stack([self._at(name, begin), self._at(name, end)])
        low, high = edges.min(axis=0), edges.max(axis=0)
        first, stop = np.searchsorted(self.time, begin), np.searchsorted(self.time, end, side="right")
        some = np.flatnonzero(stop > first)
        if some.size:
            places = np.stack([first[some], stop[some]], axis=1).ravel()
            padded = np.append(values, values[-1])
            low[some] = np.minimum(low[some], np.minimum.reduceat(padded, places)[::2])
            high[some] = np.maximum(high[some], np.maximum.reduceat(padded, places)[::2])
        return low, high

    def tolerance(self, name: str) -> float:
        """Return how far beside the truth a reading may be, in its own unit."""
        return self._tolerance["tendon" + name[8:] if name.startswith("tendon") else name]

    def _at(self, name: str, time: Array) -> Array:
        clipped = np.clip(time, self.time[0], self.time[-1])
        if name == "drive_rad" and self._drive is not None:
            return np.asarray(self._drive(clipped), dtype=float)
        return np.interp(clipped, self.time, self.values[name])


@dataclass(frozen=True, slots=True)
class Wrong:
    """A reading that is not true."""

    name: str
    time_s: float
    found: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.name} at {self.time_s:.4f} s is {self.found:.5g}, was {self.low:.5g} to {self.high:.5g}"


def wrong_readings(
    truth: Truth, readings: Mapping[str, Array], time_s: Array, early_s: float, late_s: float
) -> list[Wrong]:
    """Return the readings that were not true between time - early and time + late.

    readings: values by name, NaN where there is none.
    """
    wrong: list[Wrong] = []
    for name, column in readings.items():
        came = np.flatnonzero(np.isfinite(column) & np.isfinite(time_s))
        if not came.size:
            continue
        found, at = column[came], time_s[came]
        low, high = truth.range(name, at - early_s, at + late_s)
        if name.startswith("tendon") and name.endswith("rad"):
            # A motor forgets its whole turns when it starts anew or changes its mode.
            found = found - math.tau * np.round((found - 0.5 * (low + high)) / math.tau)
        off = np.maximum(low - found, found - high) / truth.tolerance(name)
        wrong += [
            Wrong(name, *(float(numbers[i]) for numbers in (at, found, low, high))) for i in np.flatnonzero(off > 1.0)
        ]
    return wrong


def _tolerances(spec: RigSpec) -> dict[str, float]:
    imu, drive, tendons = spec.imu, spec.drive, spec.tendons
    noise = _SIGMAS * imu.gyro_noise.value / math.sqrt(imu.average_samples) + _BIASES * abs(imu.gyro_bias.value)
    gyro = noise + (imu.dead_band + 1) * imu.gyro_lsb.value + _SWING
    force = _SIGMAS * imu.accelerometer_noise.value + imu.accelerometer_lsb.value + _FORCE
    found = {
        "drive_rad": _ENCODER * math.tau / drive.counts_per_turn.value,
        "drive_current_a": _REGISTER * drive.current_lsb.value,
        "drive_pwm": _REGISTER * drive.duty_lsb.value,
        "tendon_rad": _ENCODER * math.tau / tendons.counts_per_turn.value,
        "tendon_current_a": _REGISTER * tendons.current_lsb.value,
    }
    return found | {"gyro_x_rad_s": gyro} | {f"acceleration_{axis}_m_s2": force for axis in "xyz"}


# An emulated bench, ready for one run: faults, witness, operator, virtual time.

JOURNAL = "journal.sqlite"
"""Name of a run's journal in its folder."""

LONGEST_S = 90.0
"""A run that has not ended after so long has no end [s, virtual time]."""

_WATCHDOG_S = 0.3  # without a host, so that the bus watchdogs can act
_REST_MOST_S = 4.0  # until a joint that swings in held tendons is at rest
_BUS_RETRIES = 2

_BACKBONE_HZ = {0.0: 3.030, 2.0: 3.176, 4.0: 3.351}
"""Where the paper's joint resonates at a command of 20°, by pretension [mm] (docs/explanation/tracking.md)."""

_AT_20_DEG = (20.0, 9.0, 40.0)  # command, lever and torsion, about

# Straight lines in the place of a prediction, which takes longer than a run: the law needs only about where, and how
# damped.
_EXPECTED = tuple(
    ExpectedBackbone(mm, np.full(2, hz), np.full(2, 0.07), *(np.radians([0.0, deg]) for deg in _AT_20_DEG))
    for mm, hz in _BACKBONE_HZ.items()
)


class EndlessError(Exception):
    """A run that does not end."""


class _BoundedPort(VirtualPort):
    """A port whose time comes to an end."""

    def write(self, data: bytes) -> None:
        if self.now() > LONGEST_S:
            raise EndlessError(f"no end after {LONGEST_S:g} s")
        super().write(data)


class _Operator:
    """Sees the run, notes its phases, and ends it when the scenario says so; a Listener."""

    def __init__(self, port: VirtualPort, interrupt_s: float) -> None:
        self._port, self._interrupt_s = port, interrupt_s
        self.runner: Runner | None = None
        self.said: dict[str, float] = {}
        self.first, self.newest = math.nan, math.nan
        self.after_contact = math.nan

    def on_sample(self, sample: Sample) -> None:
        now = sample.time_s
        if math.isnan(self.first):
            self.first = now
        if "contact" in self.said and math.isnan(self.after_contact):
            self.after_contact = now
        self.newest = now
        if now >= self._interrupt_s and self.runner is not None:
            self.runner.steering.request_stop("interrupted by the operator")

    def on_event(self, event: Event) -> None:
        self.said.setdefault(event.kind, self._port.now())

    def timeline(self) -> Timeline:
        """Return the phases that there were."""
        said, nothing = self.said, math.nan
        phases: Timeline = {
            "set-up": (0.0, self.first),
            "mode change": (said.get("contact", nothing), self.after_contact),
            "levelling": (self.after_contact, said.get("pretension", nothing)),
            "stop": (self.newest, said.get("end", nothing)),
        }
        return {phase: times for phase, times in phases.items() if not any(map(math.isnan, times))}


class FaultyBench:
    """An emulated bench with a scenario's joint and faults, and all that a run on it needs.

    witness: of how the joint moved. hostile: the line, if it is. emulated: the devices. rig: the same as the bench sees
    them, through port.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario, self.plan, self.spec = scenario, plan_of(scenario), rig_of(scenario)
        spec = self.spec
        self.witness = Witness(spec, scenario.slack_m, scenario.rest_tilt)
        self.emulated = EmulatedRig(spec, self.witness, seed=scenario.fault_seed, tendon_counts=TENDON_COUNTS)
        Faults(self.emulated, scenario.faults, scenario.fault_seed)
        self.port = _BoundedPort(self.emulated)
        self.hostile = HostileLine(scenario.lies, self.emulated.line) if scenario.lies is not None else None
        timing = BusTiming(spec.wiring.baud, latency=1e-3 * spec.wiring.latency_ms)
        self.rig = Rig(Bus(self.port, self.port, timing, retries=_BUS_RETRIES), self.port, spec)
        self.operator = _Operator(self.port, scenario.interrupt_s)

    def run(self, folder: Path, tension_n: Mapping[float, float]) -> RunReport:
        """Run the plan with a journal in a folder; raises what the run does not catch, StartError among it."""
        with Journal.create(folder / JOURNAL, dump_plan(self.plan), dump_rig(self.spec)) as journal:
            runner = Runner(self.rig, self.port, self.plan, journal, tension_n, listener=self.operator, law=self._law)
            self.operator.runner = runner
            return runner.run()

    def _law(self, group: Group, time: float) -> Tracker:
        return planned_tracker(group, self.plan, self.spec, _EXPECTED, time)

    def settle(self) -> None:
        """Let the bench be without its host until the watchdogs have acted and nothing swings."""
        start = end = self.port.rig.time
        while end < start + _WATCHDOG_S or (end < start + _REST_MOST_S and not self.emulated.in_safe_state()):
            end += 0.1
            self.port.rig.advance(end)


def timeline_of(scenario: Scenario, tension_n: Mapping[float, float]) -> Timeline:
    """Return when the phases of a run without its faults begin and end [s]."""
    bench = FaultyBench(scenario.without_faults())
    with TemporaryDirectory() as folder:
        bench.run(Path(folder), tension_n)
    return bench.operator.timeline()


# What a bench recorded against how the joint moved, reading by reading.

_SHOWN = 5
_DRIVE = ("drive_rad", "drive_current_a", "drive_pwm")
_TENDON = ("rad", "current_a")


@dataclass(slots=True)
class Comparison:
    """What came out.

    rows, left_out: of the recording. checked: readings, in recording and journal. wrong: the first of those that were
    not true. violations: in words.
    """

    rows: int = 0
    left_out: int = 0
    checked: int = 0
    wrong: list[str] = field(default_factory=list)
    violations: list[str] = field(default_factory=list)

    def take(
        self, where: str, truth: Truth, readings: Mapping[str, Array], at: Array, early: float, late: float
    ) -> None:
        """Hold readings against the truth between so long before and after their times [s]."""
        wrong = wrong_readings(truth, readings, at, early, late)
        self.checked += sum(int(np.isfinite(found).sum()) for found in readings.values())
        if wrong:
            self.violations.append(f"{len(wrong)} wrong readings in the {where}, the first: {wrong[0]}")
            self.wrong += [f"{where}: {one}" for one in wrong[:_SHOWN]]

    def take_steps(self, table: Mapping[str, Array], spec: RigSpec) -> None:
        """Look in a journal for what no motor and no head can do, whatever the truth was."""
        for name, (most, fastest) in _reaches(spec).items():
            came = np.isfinite(table[name])
            found, at = table[name][came], table["imu_time_s" if name.startswith("gyro") else "time_s"][came]
            self.checked += found.size
            far = np.flatnonzero(np.abs(found) > most)
            passed = np.diff(at)
            # A mode that changes takes a while, and whole turns off a position.
            leaps = np.flatnonzero(
                (np.abs(np.diff(found)) > fastest[0] + fastest[1] * np.abs(passed)) & (passed < 0.05)
            )
            for index in (*far, *leaps):
                self.wrong.append(f"journal: {name} at {at[index]:.4f} s is {found[index]:.5g}, which cannot be")
        if self.wrong:
            self.violations.append(f"{len(self.wrong)} impossible readings in the journal, the first: {self.wrong[0]}")
            del self.wrong[_SHOWN:]


def _reaches(spec: RigSpec) -> dict[str, tuple[float, tuple[float, float]]]:
    """Return the largest value of a reading, and by how much it may step at once and each second, by column."""
    nothing = (math.inf, math.inf)
    supply = spec.drive.supply_voltage.value
    found: dict[str, tuple[float, tuple[float, float]]] = {"drive_pwm": (1.15, nothing)}
    for name, model in [
        ("drive", spec.wiring.drive_model),
        *((f"tendon_{i + 1}", spec.wiring.tendon_model) for i in range(spec.tendons.count)),
    ]:
        servo = SERVOS[model]
        share = servo.supply_share(supply)
        found[f"{name}_rad"] = math.inf, (0.03, 4.0 * servo.no_load_speed * share)
        found[f"{name}_current_a"] = 3.0 * servo.stall_current * share, nothing
    torque = spec.drive.stall_torque.value * supply / spec.drive.nominal_voltage.value
    for axis in "xyz":
        found[f"gyro_{axis}_rad_s"] = math.inf, (7.0, 2.5 * torque / spec.inertia.head.value)
    return found


def compare(bench: FaultyBench, journal: Path, groups_done: int) -> Comparison:
    """Return how what is in the journal of a bench, and in the recording made from it, compares with the truth.

    groups_done: groups of the plan that were reported as done; the recording must hold them all.
    """
    comparison = Comparison()
    if not journal.exists():
        return comparison
    truth = bench.witness.truth(bench.spec)
    with JournalReader(journal) as reader:
        table = reader.samples(0, reader.last_sample() + 1)
        finished = reader.finished()
    lies = bench.scenario.lies
    if lies is not None and lies.kind in FALSE_KINDS:
        comparison.take_steps(table, bench.spec)
        return comparison
    if table["id"].size:
        _take_journal(bench, truth, table, comparison)
    if not groups_done:
        return comparison
    try:
        recording = recording_from_journal(journal)
    except SinewError as trouble:
        comparison.violations.append(f"{groups_done} groups done, but no recording: {trouble}")
        return comparison
    left_out = recording.attrs["left_out_groups"]
    if len(finished) != groups_done or left_out:
        comparison.violations.append(
            f"{groups_done} groups done, {len(finished)} in the journal, not in the recording: {left_out or 'none'}"
        )
    begin = finished[min(finished)][0].first
    mine = {name: column[table["id"] >= begin] for name, column in table.items()}
    _take_recording(bench, truth, recording, mine, comparison)
    return comparison


def _take_journal(bench: FaultyBench, truth: Truth, table: Mapping[str, Array], comparison: Comparison) -> None:
    _take_motors(bench, "journal", truth, table.__getitem__, table["time_s"], comparison)
    sensors = {name: column for name, column in table.items() if name.startswith(("gyro_x", "acceleration"))}
    comparison.take("journal", truth, sensors, table["imu_time_s"], MOTOR_S, MOTOR_S)


def _take_recording(
    bench: FaultyBench, truth: Truth, recording: xr.Dataset, table: Mapping[str, Array], comparison: Comparison
) -> None:
    """Compare a recording; table: the journal's rows from its first group on.

    The accelerometer is left to the journal: between its samples, which nothing smooths, no cubic is the truth.
    """
    comparison.rows, comparison.left_out = recording.sizes["sample"], int(recording.attrs["left_out_rows"])
    stamp = bench.spec.bus.drive_delay.value
    host = _host_times(recording, table, stamp)
    if host is None:
        comparison.violations.append("the recording's times are not those of the journal's rows")
        return

    def column(name: str) -> Array:
        if name.startswith("tendon"):
            _, tendon, what = name.split("_", 2)
            return np.asarray(recording[f"tendon_{what}"].values[:, int(tendon) - 1], dtype=float)
        return np.asarray(recording[name].values, dtype=float)

    _take_motors(bench, "recording", truth, column, host - stamp, comparison)
    gyro = np.asarray(recording["gyro_rad_s"].values[:, 0], dtype=float)
    comparison.take("recording", truth, {"gyro_x_rad_s": gyro}, host, SENSOR_S, SENSOR_S)


def _take_motors(
    bench: FaultyBench,
    where: str,
    truth: Truth,
    column: Callable[[str], Array],
    at: Array,
    comparison: Comparison,
) -> None:
    """Compare drive and tendons, whose answers follow the drive's."""
    answers_s = bench.rig.cycle_bytes * 10 / bench.spec.wiring.baud
    names = [f"tendon_{i + 1}_{what}" for i in range(bench.spec.tendons.count) for what in _TENDON]
    comparison.take(where, truth, {name: column(name) for name in _DRIVE}, at, MOTOR_S, MOTOR_S)
    comparison.take(where, truth, {name: column(name) for name in names}, at, MOTOR_S, MOTOR_S + answers_s)


def _host_times(recording: xr.Dataset, table: Mapping[str, Array], stamp_s: float) -> Array | None:
    """Return the host's times of a recording's rows [s], whose own time counts from its first row.

    None where the rows are not rows of the journal, with the times they have there.
    """
    order = np.argsort(table["time_s"])
    known = table["time_s"][order] + stamp_s
    drive = table["drive_rad"][order].astype(np.float32)
    since, asked = recording["time_s"].values - recording["time_s"].values[0], recording["drive_rad"].values
    for first in known[drive == asked[0]]:
        place = np.clip(np.searchsorted(known, first + since - 1e-6), 0, known.size - 1)
        if np.abs(known[place] - first - since).max() < 1e-6 and (drive[place] == asked).all():
            host: Array = known[place]
            return host
    return None


# The verdict.


@dataclass(slots=True)
class Verdict:
    """What became of a run.

    kind: of its fault. struck: whether it came before the run had ended. happened: what its faults did, and how often.
    outcome: complete, stopped, refused or raised. sentence: what ended it. stop: how it was left, as the bench says.
    readings: of the recording and the journal, held against the truth. end: the motors' true state. tension_n: of every
    tendon in the end. virtual_s, wall_s: how long it took. violations: of what may not happen, those of the readings
    among them.
    """

    number: int
    kind: str
    faults: list[str]
    plan: str
    mode: str
    safe_state: str
    interrupt_s: float | None
    struck: bool = False
    happened: dict[str, int] = field(default_factory=dict)
    outcome: str = "refused"
    sentence: str = ""
    stop: str = ""
    groups: int = 0
    groups_done: int = 0
    readings: Comparison = field(default_factory=Comparison)
    end: list[str] = field(default_factory=list)
    tension_n: list[float] = field(default_factory=list)
    virtual_s: float = 0.0
    wall_s: float = 0.0
    violations: list[str] = field(default_factory=list)


def judge(scenario: Scenario, tension_n: Mapping[float, float]) -> Verdict:
    """Run a scenario and return what became of it; raises nothing that a run may do wrong.

    tension_n: of each tendon at rest, by pretension [mm].
    """
    began = time.perf_counter()
    if scenario.phase is not None:
        scenario = scenario.aimed(timeline_of(scenario, tension_n))
    bench = FaultyBench(scenario)
    verdict = Verdict(
        scenario.number,
        scenario.kind,
        [str(fault) for fault in (*scenario.faults, *([scenario.lies] if scenario.lies else []))],
        scenario.plan,
        scenario.mode,
        scenario.safe_state,
        None if math.isinf(scenario.interrupt_s) else scenario.interrupt_s,
    )
    with TemporaryDirectory() as folder:
        report = _run(bench, Path(folder), tension_n, verdict)
        _look_at_end(bench, report, verdict)
        verdict.readings = compare(bench, Path(folder) / JOURNAL, report.groups_done if report else 0)
        verdict.violations += verdict.readings.violations
    for happening in bench.emulated.log:
        what = f"{happening.kind} {happening.what}"
        verdict.happened[what] = verdict.happened.get(what, 0) + 1
        verdict.struck = verdict.struck or happening.time <= verdict.virtual_s
    if bench.hostile is not None:
        marked = {"stale": bench.rig.stale.total(), "impossible": bench.rig.impossible.total()}
        verdict.happened = {"struck": bench.hostile.struck} | {f"marked {why}": n for why, n in marked.items()}
        verdict.struck = bench.hostile.struck > 0
    verdict.wall_s = time.perf_counter() - began
    return verdict


def _run(bench: FaultyBench, folder: Path, tension_n: Mapping[float, float], verdict: Verdict) -> RunReport | None:
    """Run, note how it ended, and return its report; None where it did not start."""
    report = None
    try:
        report = bench.run(folder, tension_n)
    except StartError as refusal:
        verdict.sentence = str(refusal)
    except Exception as fault:
        verdict.outcome, verdict.sentence = "raised", str(fault)
        verdict.violations.append(f"raised {type(fault).__name__}: {fault}")
    verdict.virtual_s = round(bench.port.rig.time, 3)
    if report is not None:
        verdict.outcome = "complete" if report.is_complete else "stopped"
        verdict.sentence, verdict.stop = report.sentence, report.stop.sentence() if report.stop else ""
        verdict.groups, verdict.groups_done = report.groups, report.groups_done
        if not verdict.stop.strip():
            verdict.violations.append("no sentence on how the rig was left")
    if verdict.kind == "none" and math.isinf(bench.scenario.interrupt_s) and verdict.outcome != "complete":
        verdict.violations.append(f"{verdict.outcome} without a fault: {verdict.sentence}")
    if not verdict.sentence.strip() or "\n" in verdict.sentence:
        verdict.violations.append("no sentence on what ended it")
    return report


def _look_at_end(bench: FaultyBench, report: RunReport | None, verdict: Verdict) -> None:
    bench.settle()
    states = bench.emulated.states()
    verdict.end = [_words(device, state) for device, state in states.items()]
    verdict.tension_n = [round(tension, 2) for tension in bench.emulated.motion().tension]
    if not bench.emulated.in_safe_state():
        verdict.violations.append("outside the safe state: " + "; ".join(verdict.end))
    if verdict.outcome == "refused" and any(state.torque for state in states.values()):
        verdict.violations.append("refused, and a torque is on: " + "; ".join(verdict.end))
    if report is not None and report.stop is not None and report.stop.is_safe:
        for motor in bench.rig.motors:
            state = states[motor.id]
            if not _is_as_declared(bench.scenario, state):
                declared = report.stop.declared
                verdict.violations.append(f"the report says {declared}, but {motor.name} is {_words(motor.id, state)}")


def _is_as_declared(scenario: Scenario, state: MotorState) -> bool:
    """Return whether a motor is as a report without reservations says."""
    if scenario.safe_state == "release":
        return not state.torque
    # The supply, or a motor's own protection, may have taken its torque after it was asked.
    may_be_off = any(fault.kind in ("brown-out", "overload", "overheat") for fault in scenario.faults)
    return state.torque or may_be_off


def _words(device: int, state: MotorState) -> str:
    torque = "torque" if state.torque else "no torque"
    tripped = ", tripped" if state.is_tripped else ""
    law = state.law
    limits = "" if law.kind == "off" else f" {law.goal:.3f} duty<{law.duty_limit:.2f} current<{law.current_limit:.2f}"
    return f"{device}: {torque}{tripped}, {law.kind}{limits}, {state.speed:+.3f} rad/s"
