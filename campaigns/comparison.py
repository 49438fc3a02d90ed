"""What a bench recorded against how the joint moved, reading by reading."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import xarray as xr

from campaigns.faulty_bench import FaultyBench
from campaigns.lies import FALSE_KINDS
from campaigns.witness import MOTOR_S, SENSOR_S, Truth, wrong_readings
from sinew.bench.record.conversion import recording_from_journal
from sinew.bench.record.journal import JournalReader
from sinew.measure.arrays import Array
from sinew.measure.errors import SinewError
from sinew.plan.rig import RigSpec
from sinew.plan.servo import SERVOS

_SHOWN = 5
_DRIVE = ("drive_rad", "drive_current_a", "drive_pwm")
_TENDON = ("rad", "current_a")


@dataclass(slots=True)
class Comparison:
    """What came out.

    rows, left_out: of the recording. checked: readings, in recording and journal. wrong: the first of those that were
    not true. nearest: how near to its tolerance the worst reading came, by name. violations: in words.
    """

    rows: int = 0
    left_out: int = 0
    checked: int = 0
    wrong: list[str] = field(default_factory=list)
    nearest: dict[str, float] = field(default_factory=dict)
    violations: list[str] = field(default_factory=list)

    def take(
        self, where: str, truth: Truth, readings: Mapping[str, Array], at: Array, early: float, late: float
    ) -> None:
        """Hold readings against the truth between so long before and after their times [s]."""
        wrong, nearest = wrong_readings(truth, readings, at, early, late)
        self.checked += sum(int(np.isfinite(found).sum()) for found in readings.values())
        self.nearest |= {f"{where} {name}": round(share, 3) for name, share in nearest.items()}
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
