"""Ring-downs inside a recording: which channel, which segments, which table."""

import numpy as np
import pytest
import xarray as xr
from tests.unit.ring_down_signals import FREQUENCY_HZ, Decay, lever, times

from sinew.analysis.decay.ring_down import analyse_ring_downs
from sinew.measure.files.netcdf import provenance
from sinew.measure.recording import Segment, build_recording
from sinew.plan.plan import Plan
from sinew.plan.toml import load_plan
from sinew.twin.parameters import Effects
from sinew.twin.simulate import simulate

T = times(duration_s=3.0, sample_hz=200.0, before_s=2.0)
SETTLE, RECORD = int((T < 0).sum()), int((T >= 0).sum())
PRETENSIONS, DAMPINGS = (0.0, 4.0), (0.06, 0.1)
SAME = Effects().without("repeatability")
ALIKE = {"frequency_hz": [4.0, 4.0], "amplitude_deg": 20, "drive_s": 3, "record_s": 3, "repeats": 12}


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


@pytest.mark.parametrize("channel", ["gyro_rad_s", "torsion_rad"])
def test_each_pretension_gets_its_damping_from_gyroscope_or_torsion(channel: str) -> None:
    found = analyse_ring_downs(recording(channel))["damping_ratio"].mean("repeat").values
    assert found == pytest.approx(DAMPINGS, rel=0.01)


def test_the_stiffness_is_that_of_the_inertia_given() -> None:
    found = analyse_ring_downs(recording(), 0.0127)["paper_stiffness_n_m_rad"].values
    damped = 0.0127 * (2 * np.pi * FREQUENCY_HZ) ** 2 * (1 - np.array(DAMPINGS) ** 2)
    assert found == pytest.approx(np.stack([damped, damped], axis=1), rel=0.005)


def test_a_ring_down_that_cannot_be_analysed_is_nan_and_says_why() -> None:
    found = analyse_ring_downs(recording(spoil=2))
    assert np.isnan(found["damping_ratio"].values).tolist() == [[False, False], [True, False]]
    assert "ring-down 0 at 4 mm" in found.attrs["ring_down_notes"]


def test_a_decay_without_a_drive_needs_no_frequency_of_it() -> None:
    whole = recording("torsion_rad")
    first = whole.isel(segment=[1], sample=slice(SETTLE, SETTLE + RECORD))
    by = [analyse_ring_downs(first.assign(frequency_hz=("segment", [hz]))) for hz in (0.0, np.nan)]
    assert by[0]["damping_ratio"].values == pytest.approx(DAMPINGS[:1], rel=0.01)
    assert by[0]["damping_ratio"].values == by[1]["damping_ratio"].values


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


@pytest.mark.slow
def test_decays_that_begin_alike_are_read_by_one_model_whatever_their_noise() -> None:
    plan = load_plan("quick").model_dump(exclude_none=True, exclude={"sweep"}) | {"ring_down": ALIKE}
    found = analyse_ring_downs(simulate(Plan.model_validate(plan), "paper", seed=1, effects=SAME))
    rates, stds = found["decay_rate_per_s"].values.ravel(), found["decay_rate_std_per_s"].values.ravel()
    assert set(found["exponential"].values.ravel().tolist()) == {0.0}
    assert np.ptp(rates) < 4.0 * float(np.median(stds))  # of twelve normal values the range is 3.3 on average
