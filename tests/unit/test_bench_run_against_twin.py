"""A plan run on the emulated joint in virtual time, beside the twin's own answer to the same plan."""

import math
from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr
from tests.unit.bench_virtual import virtual_bench

from sinew.analysis.analysed import analyse_recording
from sinew.analysis.signal.harmonics import fit_harmonics
from sinew.bench.record.conversion import recording_from_journal
from sinew.bench.run import RunReport
from sinew.measure.recording import iterate_segments, read_registers
from sinew.plan.plan import Plan
from sinew.plan.toml import load_rig, parse_plan
from sinew.twin.parameters import Effects
from sinew.twin.simulate import rest_tension, simulate

pytestmark = pytest.mark.slow

RIG = load_rig("paper")
PLAN = """
name = "beside the twin"
[pretension]
pretension_mm = [2, 8]
[sweep]
frequency_hz = [2.5, 3.2, 4.0]
repeats = 1
[ring_down]
frequency_hz = [3.0, 4.0]
repeats = 1
"""


class Pair(NamedTuple):
    plan: Plan
    report: RunReport
    recording: xr.Dataset
    bench: xr.Dataset
    twin: xr.Dataset

    def ratio(self, name: str) -> np.ndarray:
        return np.abs(self.bench[name].values / self.twin[name].values - 1)


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Pair:
    plan, folder = parse_plan(PLAN), tmp_path_factory.mktemp("run")
    pretensions = plan.pretension.pretension_mm
    tension = dict(zip(pretensions, rest_tension(pretensions, RIG).tolist(), strict=True))
    report = virtual_bench(RIG, rest_tilt=(0.012, -0.012)).run(plan, folder, tension)
    recording = recording_from_journal(folder / "journal.sqlite")
    twin = simulate(plan, RIG, effects=Effects().without("repeatability"))
    return Pair(plan, report, recording, analyse_recording(recording, RIG), analyse_recording(twin, RIG))


def test_the_whole_plan_is_recorded(pair: Pair) -> None:
    report, groups = pair.report, pair.plan.groups()
    assert (report.is_complete, report.groups_done, report.loop.incomplete) == (True, len(groups), 0)
    kinds = [kind for group in groups for kind in (["settle"] if group.settle_s else []) + [group.kind]]
    assert pair.recording["kind"].values.tolist() == kinds


def test_the_recording_holds_the_registers_with_which_the_motors_measured(pair: Pair) -> None:
    (run,) = read_registers(pair.recording)
    assert (run["run"], run["tendon_mode"], list(run["motors"])[-1]) == (1, "position", "drive")
    drive, tendon = run["motors"]["drive"]["registers"], run["motors"]["tendon 1"]["registers"]
    assert [tendon[name] for name in ("operating_mode", "torque_enable", "bus_watchdog")] == [4, 1, 4]
    assert 0 < tendon["goal_pwm"] < 885 / 2  # bounded by the pretension asked for
    # Duty per radian of error, as the rig has it: P/128 counts of PWM a pulse, 4096 pulses a turn, 885 the whole.
    gain = drive["position_p_gain"] / 128 * 4096 / math.tau / 885
    assert gain == pytest.approx(RIG.drive.position_gain.value, rel=1e-3)


def test_duty_and_current_of_the_drive_keep_its_voltage_equation(pair: Pair) -> None:
    # u = R i + k_e θ̇, with R and no-load speed of the data sheet: 12 V over 2.3 A; 12 V less the current at no load.
    rows = []
    for _, segment, where in iterate_segments(pair.recording, "steady"):
        volts = pair.recording["drive_pwm"].values[where] * pair.recording["supply_v"].values[where]
        signals = [volts, *(pair.recording[n].values[where] for n in ("drive_current_a", "drive_rad"))]
        time, hertz = pair.recording["time_s"].values[where], segment.frequency_hz
        wave = fit_harmonics(time[None], np.array([signals], dtype=float), np.array([hertz])).coefficient[0, :, 0]
        rows.append((wave[0], wave[1], 2j * np.pi * hertz * wave[2]))
    volts, current, speed = np.concatenate([np.real(rows), np.imag(rows)]).T
    (resistance, constant), *_ = np.linalg.lstsq(np.stack([current, speed], axis=1), volts, rcond=None)
    drive = RIG.drive
    idle = drive.friction.value / (drive.stall_torque.value + drive.friction.value)
    assert resistance == pytest.approx(12.0 / 2.3, rel=0.03)
    assert constant == pytest.approx(12.0 * (1 - idle) / drive.no_load_speed.value, rel=0.03)


def test_duty_and_current_of_a_tendon_at_rest_are_its_resistance(pair: Pair) -> None:
    idle = [where for _, _, where in iterate_segments(pair.recording, "idle")]
    assert idle
    for where in idle:
        rest = {n: pair.recording[n].values[where].mean(axis=0) for n in ("tendon_pwm", "tendon_current_a", "supply_v")}
        assert np.allclose(rest["tendon_pwm"] * rest["supply_v"] / rest["tendon_current_a"], 12.0 / 1.3, rtol=0.03)


# A group follows another's swing here and rest on the twin, which costs up to 0.3 % after so short a settle.


@pytest.mark.parametrize(
    ("name", "within"),
    [
        ("gain", 0.01),
        ("damping_ratio", 0.02),
        ("decay_frequency_hz", 0.002),
        ("drive_amplitude_rad", 0.01),
        ("drive_mechanical_w", 0.04),
        ("holding_power_w", 0.04),
    ],
)
def test_what_the_bench_gives_is_the_twins(pair: Pair, name: str, within: float) -> None:
    assert pair.ratio(name).max() < within
    off = np.degrees(pair.bench["phase_lag_rad"].values - pair.twin["phase_lag_rad"].values)
    assert np.abs(off).max() < 0.5
