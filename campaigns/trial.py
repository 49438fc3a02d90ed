"""This is where one run of the campaign happens in virtual time, and is judged.

What may not happen, whatever the fault (`Verdict.violations`): a reading in the recording, or in the journal, that was
not true; an end outside the safe state, as the motors are and not as their registers say; an end that the report calls
safe and that is not the declared one; an end without a sentence; an error that has no name; a run without end; a
recording that lacks a group that was reported as done; an early end where nothing was wrong.
"""

import gc
import math
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from campaigns.scenario import Scenario, Timeline, plan_of, rig_of
from campaigns.witness import MOTOR_S, SENSOR_S, TENDON_COUNTS, Truth, Witness, wrong_readings
from sinew.bench.conversion import recording_from_journal
from sinew.bench.errors import StartError
from sinew.bench.journal import Journal
from sinew.bench.journal_reader import JournalReader
from sinew.bench.run import Runner, RunReport
from sinew.bench.sample import Sample
from sinew.emulator.faults import Faults
from sinew.emulator.joint_plant import JointPlant
from sinew.emulator.rig import EmulatedRig, MotorState
from sinew.emulator.virtual import VirtualPort
from sinew.hardware.bus import Bus, BusTiming
from sinew.hardware.rig import Rig
from sinew.measure.errors import RecordingError, SinewError
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_plan, dump_rig

__all__ = ["LONGEST_S", "EndlessError", "Verdict", "judge", "timeline_of"]

Floats = NDArray[np.float64]

LONGEST_S = 90.0
"""A run that has not ended after so long has no end [s, virtual time]."""

_WATCHDOG_S = 0.3  # without a host, so that the bus watchdogs can act
_REST_MOST_S = 4.0  # until a joint that swings in held tendons is at rest
_BUS_RETRIES = 2
_SHOWN = 5


@dataclass(slots=True)
class Verdict:
    """What became of a run.

    kind: of its fault. struck: whether it came before the run had ended. happened: what its faults did, and how often.
    outcome: complete, stopped, refused or raised. sentence: what ended it. stop: how it was left, as the bench says.
    rows, left_out: of the recording. checked: readings held against the truth, in recording and journal. wrong: the
    first of those that were not true. nearest: how near to its tolerance the worst reading came, by name. end: the
    motors' true state. tension_n: of every tendon in the end. virtual_s, wall_s: how long it took. violations: of what
    may not happen.
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
    rows: int = 0
    left_out: int = 0
    checked: int = 0
    wrong: list[str] = field(default_factory=list)
    nearest: dict[str, float] = field(default_factory=dict)
    end: list[str] = field(default_factory=list)
    tension_n: list[float] = field(default_factory=list)
    virtual_s: float = 0.0
    wall_s: float = 0.0
    violations: list[str] = field(default_factory=list)

    def document(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        return asdict(self)


def judge(scenario: Scenario, tension_n: Mapping[float, float]) -> Verdict:
    """Run a scenario and return what became of it; raises nothing that a run may do wrong.

    tension_n: of each tendon at rest, by pretension [mm].
    """
    began = time.perf_counter()
    if scenario.phase is not None:
        scenario = scenario.aimed(timeline_of(scenario, tension_n))
    bench = _Bench(scenario)
    verdict = Verdict(
        scenario.number,
        scenario.kind,
        [str(fault) for fault in scenario.faults],
        scenario.plan,
        scenario.mode,
        scenario.safe_state,
        None if math.isinf(scenario.interrupt_s) else scenario.interrupt_s,
    )
    collecting = gc.isenabled()
    gc.disable()
    try:
        with TemporaryDirectory() as folder:
            report = _run(bench, Path(folder), tension_n, verdict)
            _look_at_end(bench, report, verdict)
            _look_at_readings(bench, report, Path(folder) / "journal.sqlite", verdict)
    finally:
        if collecting:
            gc.enable()
            gc.collect(1)
    for happening in bench.faults.log:
        what = f"{happening.kind} {happening.what}"
        verdict.happened[what] = verdict.happened.get(what, 0) + 1
        verdict.struck = verdict.struck or happening.time <= verdict.virtual_s
    verdict.wall_s = time.perf_counter() - began
    return verdict


def _journal(bench: _Bench, folder: Path) -> Journal:
    return Journal.create(folder / "journal.sqlite", dump_plan(plan_of(bench.scenario)), dump_rig(bench.spec))


def _run(bench: _Bench, folder: Path, tension_n: Mapping[float, float], verdict: Verdict) -> RunReport | None:
    """Run, note how it ended, and return its report; None where it did not start."""
    report = None
    try:
        with _journal(bench, folder) as journal:
            report = bench.run(journal, tension_n)
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
    if verdict.kind == "none" and verdict.outcome != "complete":
        verdict.violations.append(f"{verdict.outcome} without a fault: {verdict.sentence}")
    if not verdict.sentence.strip() or "\n" in verdict.sentence:
        verdict.violations.append("no sentence on what ended it")
    return report


def _look_at_end(bench: _Bench, report: RunReport | None, verdict: Verdict) -> None:
    bench.settle()
    states = bench.emulated.states()
    verdict.end = [_words(device, state) for device, state in states.items()]
    verdict.tension_n = [round(tension, 2) for tension in bench.emulated.motion().tension]
    if not bench.emulated.in_safe_state():
        verdict.violations.append("outside the safe state: " + "; ".join(verdict.end))
    if report is None and any(state.torque for state in states.values()):
        verdict.violations.append("refused, and a torque is on: " + "; ".join(verdict.end))
    if report is not None and report.stop is not None and report.stop.is_safe:
        for motor in bench.rig.motors:
            state = states[motor.id]
            if not _is_as_declared(bench, state):
                declared = report.stop.declared
                verdict.violations.append(f"the report says {declared}, but {motor.name} is {_words(motor.id, state)}")


def _is_as_declared(bench: _Bench, state: MotorState) -> bool:
    """Return whether a motor is as a report without reservations says."""
    if bench.scenario.safe_state == "release":
        return not state.torque
    # The supply, or a motor's own protection, may have taken its torque after it was asked.
    may_be_off = any(fault.kind in ("brown-out", "overload", "overheat") for fault in bench.scenario.faults)
    return state.torque or may_be_off


def _words(device: int, state: MotorState) -> str:
    torque = "torque" if state.torque else "no torque"
    tripped = ", tripped" if state.is_tripped else ""
    law = state.law
    limits = "" if law.kind == "off" else f" {law.goal:.3f} duty<{law.duty_limit:.2f} current<{law.current_limit:.2f}"
    return f"{device}: {torque}{tripped}, {law.kind}{limits}, {state.speed:+.3f} rad/s"


def _look_at_readings(bench: _Bench, report: RunReport | None, path: Path, verdict: Verdict) -> None:
    if not path.exists():
        return
    truth = bench.witness.truth(bench.spec)
    with JournalReader(path) as journal:
        table = journal.samples(0, journal.last_sample() + 1)
        finished = journal.finished()
    if table["id"].size:
        _check_journal(bench, truth, table, verdict)
    if report is None or not report.groups_done:
        return
    try:
        recording = recording_from_journal(path)
    except SinewError as trouble:
        where = "no recording" if isinstance(trouble, RecordingError) else type(trouble).__name__
        verdict.violations.append(f"{report.groups_done} groups done, but {where}: {trouble}")
        return
    if len(finished) != report.groups_done or recording.attrs["left_out_groups"]:
        verdict.violations.append(
            f"{report.groups_done} groups done, {len(finished)} in the journal, left out of the recording: "
            f"{recording.attrs['left_out_groups'] or 'none'}"
        )
    verdict.rows, verdict.left_out = recording.sizes["sample"], int(recording.attrs["left_out_rows"])
    stamp = bench.spec.bus.drive_delay.value
    begin = finished[min(finished)][0].first
    host = _host_times(recording, {name: column[table["id"] >= begin] for name, column in table.items()}, stamp)
    if host is None:
        verdict.violations.append("the recording's times are not those of the journal's rows")
        return
    motors, tendons = _motor_columns(bench, lambda name: recording[name].values.astype(float))
    sensors = {"gyro_x_rad_s": recording["gyro_rad_s"].values[:, 0].astype(float)}
    _note(verdict, "recording", truth, motors, host - stamp, MOTOR_S, MOTOR_S)
    _note(verdict, "recording", truth, tendons, host - stamp, MOTOR_S, MOTOR_S + _answers_s(bench))
    _note(verdict, "recording", truth, sensors, host, SENSOR_S, SENSOR_S)


def _check_journal(bench: _Bench, truth: Truth, table: dict[str, Floats], verdict: Verdict) -> None:
    count = bench.spec.tendons.count
    motors = {name: table[name] for name in ("drive_rad", "drive_current_a", "drive_pwm")}
    tendons = {f"tendon_{i + 1}_{what}": table[f"tendon_{i + 1}_{what}"] for i in range(count) for what in _TENDON}
    sensors = {name: column for name, column in table.items() if name.startswith(("gyro_x", "acceleration"))}
    _note(verdict, "journal", truth, motors, table["time_s"], MOTOR_S, MOTOR_S)
    _note(verdict, "journal", truth, tendons, table["time_s"], MOTOR_S, MOTOR_S + _answers_s(bench))
    _note(verdict, "journal", truth, sensors, table["imu_time_s"], MOTOR_S, MOTOR_S)


_TENDON = ("rad", "current_a")


def _motor_columns(bench: _Bench, column: Any) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return the drive's and the tendons' readings of a recording."""
    motors = {name: column(name) for name in ("drive_rad", "drive_current_a", "drive_pwm")}
    tendons = {
        f"tendon_{i + 1}_{what}": column(f"tendon_{what}")[:, i]
        for i in range(bench.spec.tendons.count)
        for what in _TENDON
    }
    return motors, tendons


def _answers_s(bench: _Bench) -> float:
    """Return by how much the last tendon answers after the drive, at most [s]."""
    return bench.rig.cycle_bytes * 10 / bench.spec.wiring.baud


def _note(
    verdict: Verdict, where: str, truth: Truth, readings: dict[str, Floats], at: Floats, early: float, late: float
) -> None:
    wrong, nearest = wrong_readings(truth, readings, at, early, late)
    verdict.checked += sum(int(np.isfinite(found).sum()) for found in readings.values())
    for name, share in nearest.items():
        key = f"{where} {name}"
        verdict.nearest[key] = round(max(share, verdict.nearest.get(key, 0.0)), 3)
    if wrong:
        verdict.violations.append(f"{len(wrong)} wrong readings in the {where}, the first: {wrong[0]}")
        verdict.wrong += [f"{where}: {one}" for one in wrong[:_SHOWN]]


def _host_times(recording: xr.Dataset, table: Mapping[str, Floats], stamp_s: float) -> Floats | None:
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
            host: Floats = known[place]
            return host
    return None
