"""A plan run on the emulated joint in virtual time, beside the twin's own answer to the same plan."""

from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr
from tests.unit.bench_virtual import virtual_bench

from sinew.analysis.analysis import analyse_recording
from sinew.bench.conversion import recording_from_journal
from sinew.bench.run import RunReport
from sinew.plan.plan import Plan
from sinew.plan.toml import load_rig, parse_plan
from sinew.twin.effects import Effects
from sinew.twin.simulate import rest_tension, simulate

RIG = load_rig("paper")
SHORT = """
name = "beside the twin"
[pretension]
pretension_mm = [6]
rest_s = 0.5
[sweep]
frequency_hz = [3.0, 3.7]
settle_s = 2.5
periods = 4
repeats = 1
[ring_down]
frequency_hz = [3.7, 3.7]
drive_s = 2
record_s = 2.5
repeats = 1
"""
LONGER = """
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


@pytest.fixture(
    scope="module", params=[pytest.param(SHORT, id="short"), pytest.param(LONGER, id="longer", marks=pytest.mark.slow)]
)
def pair(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Pair:
    plan, folder = parse_plan(request.param), tmp_path_factory.mktemp("run")
    pretensions = plan.pretension.pretension_mm
    tension = dict(zip(pretensions, rest_tension(pretensions, RIG).tolist(), strict=True))
    report = virtual_bench(RIG, rest_tilt=(0.012, -0.012)).run(plan, folder, tension)
    recording = recording_from_journal(folder / "journal.sqlite")
    twin = simulate(plan, RIG, effects=Effects().without("repeatability"))
    return Pair(plan, report, recording, analyse_recording(recording, RIG), analyse_recording(twin, RIG))


def test_the_whole_plan_is_recorded(pair: Pair) -> None:
    report = pair.report
    assert (report.is_complete, report.groups_done, report.loop.incomplete) == (True, len(pair.plan.groups()), 0)


@pytest.mark.parametrize("name", ["drive_power_w", "drive_copper_w", "drive_mechanical_w", "holding_power_w"])
def test_the_powers_are_the_twins_within_four_percent(pair: Pair, name: str) -> None:
    # The bench sends its goals 200 times a second; the twin's command is smooth.
    assert pair.ratio(name).max() < 0.04


def test_the_voltage_is_the_supplys_within_the_registers_unit(pair: Pair) -> None:
    assert np.abs(pair.recording["supply_v"].values - RIG.drive.supply_voltage.value).max() <= 0.05 + 1e-6


def test_the_recording_has_the_segments_of_the_plan(pair: Pair) -> None:
    kinds = [kind for group in pair.plan.groups() for kind in (["settle"] if group.settle_s else []) + [group.kind]]
    assert pair.recording["kind"].values.tolist() == kinds


# A group follows another's swing here and rest on the twin, which costs up to 0.3 % after so short a settle.


def test_the_gain_is_the_twins_within_one_percent(pair: Pair) -> None:
    assert np.isfinite(pair.twin["gain"].values).all()
    assert pair.ratio("gain").max() < 0.01


def test_the_phase_is_the_twins_within_half_a_degree(pair: Pair) -> None:
    off = np.degrees(pair.bench["phase_lag_rad"].values - pair.twin["phase_lag_rad"].values)
    assert np.abs(off).max() < 0.5


def test_the_damping_is_the_twins_within_two_percent(pair: Pair) -> None:
    assert pair.ratio("damping_ratio").max() < 0.02


def test_the_frequency_of_the_decay_is_the_twins_within_two_per_mille(pair: Pair) -> None:
    assert pair.ratio("decay_frequency_hz").max() < 0.002


def test_the_drive_reached_what_it_reaches_on_the_twin(pair: Pair) -> None:
    assert pair.ratio("drive_amplitude_rad").max() < 0.01
