"""Ring-downs inside a recording: which channel, which segments, which table."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.unit.ring_down_signals import FREQUENCY_HZ, Decay, lever, times

from sinew.analysis.decay.ring_down import analyse_ring_downs
from sinew.measure.errors import RecordingError
from sinew.measure.files.netcdf import provenance
from sinew.measure.recording import Segment, build_recording
from sinew.measure.schema import RESULTS_SCHEMA, validate_results

T = times(duration_s=3.0, sample_hz=200.0, before_s=2.0)
SETTLE, RECORD = int((T < 0).sum()), int((T >= 0).sum())
PRETENSIONS, DAMPINGS = (0.0, 4.0), (0.06, 0.1)


def recording(channel: str = "gyro_rad_s", spoil: int | None = None) -> xr.Dataset:
    """Return two pretensions with two repeats each; ring-down `spoil` is constant."""
    columns: dict[str, list[np.ndarray]] = {"time_s": [], "drive_rad": [], channel: []}
    segments, sizes = [], []
    rng = np.random.default_rng(1)
    for number, (p, r) in enumerate((p, r) for p in (0, 1) for r in (0, 1)):
        decay = Decay(DAMPINGS[p], amplitude=0.6, phase=1.1)
        steady = Decay(0.0, amplitude=0.6, phase=1.1)
        signal = np.where(T < 0, steady.rate(T), decay.rate(np.maximum(T, 0)))
        if channel != "gyro_rad_s":
            signal = decay.driven_until_zero(T)
        signal = signal + 1e-3 * rng.standard_normal(T.size)
        if number == spoil:
            signal[SETTLE:] = 0.1
        columns["time_s"].append(T + 10 * number)
        columns["drive_rad"].append(np.deg2rad(lever(T)))
        columns[channel].append(np.stack([signal, 0 * T, 0 * T], axis=1) if channel == "gyro_rad_s" else signal)
        segments += [Segment(kind, PRETENSIONS[p], FREQUENCY_HZ, 20.0, r) for kind in ("settle", "ring-down")]
        sizes += [SETTLE, RECORD]
    samples = {name: np.concatenate(parts) for name, parts in columns.items()}
    return build_recording(samples, segments, sizes, provenance("twin"), {channel: "mm"})


def test_the_table_is_valid_by_the_result_schema() -> None:
    results = analyse_ring_downs(recording(), 0.0127)
    validate_results(results.assign_attrs(schema=RESULTS_SCHEMA))


def test_each_pretension_gets_its_damping_from_the_gyroscope() -> None:
    found = analyse_ring_downs(recording())["damping_ratio"].mean("repeat").values
    assert found == pytest.approx(DAMPINGS, rel=0.01)


def test_each_pretension_gets_its_damping_from_the_torsion() -> None:
    found = analyse_ring_downs(recording("torsion_rad"))["damping_ratio"].mean("repeat").values
    assert found == pytest.approx(DAMPINGS, rel=0.01)


def test_a_foreign_response_keeps_its_unit_in_the_drift() -> None:
    assert analyse_ring_downs(recording("response"))["rest_drift"].attrs["units"] == "mm"


def test_the_stiffness_is_that_of_the_inertia_given() -> None:
    found = analyse_ring_downs(recording(), 0.0127)["paper_stiffness_n_m_rad"].values
    damped = 0.0127 * (2 * np.pi * FREQUENCY_HZ) ** 2 * (1 - np.array(DAMPINGS) ** 2)
    assert found == pytest.approx(np.stack([damped, damped], axis=1), rel=0.005)


def test_a_ring_down_that_cannot_be_analysed_is_nan() -> None:
    values = analyse_ring_downs(recording(spoil=2))["damping_ratio"].values
    assert np.isnan(values).tolist() == [[False, False], [True, False]]


def test_a_ring_down_that_cannot_be_analysed_says_why() -> None:
    assert "ring-down 0 at 4 mm" in analyse_ring_downs(recording(spoil=2)).attrs["ring_down_notes"]


def test_a_decay_without_a_drive_needs_no_frequency_of_it() -> None:
    whole = recording("torsion_rad")
    first = whole.isel(segment=[1], sample=slice(SETTLE, SETTLE + RECORD))
    by = [analyse_ring_downs(first.assign(frequency_hz=("segment", [hz]))) for hz in (0.0, np.nan)]
    assert by[0]["damping_ratio"].values == pytest.approx(DAMPINGS[:1], rel=0.01)
    assert by[0]["damping_ratio"].values == by[1]["damping_ratio"].values


def test_a_recording_without_ring_downs_is_refused() -> None:
    whole = recording("torsion_rad")
    kinds = np.full(whole.sizes["segment"], "steady", dtype=object)
    with pytest.raises(RecordingError, match="no ring-down segment"):
        analyse_ring_downs(whole.assign(kind=("segment", kinds)))


COPIED = """
import os
import xarray as xr
from tests.unit.test_ring_down_recordings import recording
from sinew.analysis.decay import ring_down
from sinew.measure import tasks

assert tasks._can_be_copied()
found = []
for cores in ("1", "2"):
    os.environ[tasks.CORES] = cores
    found.append(ring_down.analyse_ring_downs(recording(spoil=2), 0.0127))
with tasks.beside(1):
    found.append(ring_down.analyse_ring_downs(recording(spoil=2), 0.0127))
xr.testing.assert_identical(found[0], found[1])
xr.testing.assert_identical(found[0], found[2])
"""


def test_ring_downs_read_in_another_process_are_the_same_to_the_bit() -> None:
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(Path.cwd())}
    subprocess.run([sys.executable, "-c", COPIED], check=True, timeout=60, env=environment)


def test_where_a_decay_begins_does_not_hang_on_microseconds_of_its_stamps() -> None:
    # One period of 4 Hz behind the stop is the fiftieth sample of 200 Hz, to the microsecond.
    whole = recording()
    plan = whole.assign(frequency_hz=("segment", np.full(whole.sizes["segment"], 4.0)))
    begins = []
    for seed in range(6):
        late = 5e-5 * np.random.default_rng(seed).exponential(size=T.size * 4)
        found = analyse_ring_downs(plan.assign(time_s=("sample", whole["time_s"].values + late)))
        begins.append(found["decay_start_s"].values)
    assert np.ptp(begins, axis=0).max() < 1e-3
    assert np.array(begins) == pytest.approx(0.25, abs=1e-3)
