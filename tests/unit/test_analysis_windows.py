"""D by where the decay begins, and resonance by what is meant: held against the motion that the twin really made."""

import numpy as np
import pytest
import xarray as xr
from scipy.signal import find_peaks

from sinew.analysis.analysed import analyse_recording
from sinew.analysis.decay.paper_method import decay_windows, describe_windows, fit_envelope, windows_agree
from sinew.analysis.decay.ring_down import DECAY_FROM_PERIODS, DECAY_WINDOWS, analyse_ring_downs
from sinew.analysis.sweep.resonance import MEANINGS, resonance_table
from sinew.measure.recording import Segment, build_recording
from sinew.plan.plan import Group, Plan, Pretension, RingDown, Sweep
from sinew.plan.toml import load_rig
from sinew.twin.parameters import Effects
from sinew.twin.simulate import lane_parameters, simulate, simulate_tracks

RIG = load_rig("paper")
PRETENSION = (0.0, 12.0)
RING_DOWN_HZ = (3.0, 4.3)
STEADY = Effects().without("repeatability")


def plan() -> Plan:
    return Plan(
        name="short",
        pretension=Pretension(pretension_mm=PRETENSION),
        sweep=Sweep(frequency_hz=tuple(np.round(np.arange(2.4, 5.05, 0.1), 2)), repeats=1),
        ring_down=RingDown(frequency_hz=RING_DOWN_HZ, repeats=1),
    )


@pytest.fixture(scope="module")
def results() -> xr.Dataset:
    return analyse_recording(simulate(plan(), RIG, seed=3, effects=STEADY), RIG)


def decay(
    rate: float = 1.2,
    omega: float = 20.0,
    gap_s: tuple[float, float] = (9.0, 9.0),
    limit: float = 9.0,
    shift: float = 0.0,
) -> xr.Dataset:
    """Return a recording of a planned ring-down that is an exponential from its stop on, with noise.

    gap_s: between which times after its stop samples are missing; limit: of the sensor, which wraps at half a turn;
    shift: of its zero.
    """
    t = np.arange(0.0, 7.0, 0.005)
    free = t >= 3.0
    response = np.where(free, np.exp(-rate * np.maximum(t - 3.0, 0.0)), 1.0) * np.cos(omega * (t - 3.0))
    response = response + 1e-4 * np.random.default_rng(5).standard_normal(t.size)
    response = (np.clip(response, -limit, limit) + shift + np.pi) % (2 * np.pi) - np.pi
    kept = ~((t > 3.0 + gap_s[0]) & (t < 3.0 + gap_s[1]))
    t, free, response = t[kept], free[kept], response[kept]
    frequency = omega / (2 * np.pi)
    segments = [Segment(kind, p, frequency, 20.0, 0) for p in PRETENSION for kind in ("settle", "ring-down")]
    time = np.concatenate([t, t + 8.0])
    sizes = [int((~free).sum()), int(free.sum())] * 2
    samples = {"time_s": time, "response": np.tile(response, 2)}
    return build_recording(samples, segments, sizes, {"source": "twin"}, {"response": "rad"})


def test_an_exponential_decay_has_the_same_d_from_every_start_on() -> None:
    found = analyse_ring_downs(decay())
    assert found["window_lehr_damping"].values == pytest.approx(1.2 / 20.0, rel=0.01)
    table = decay_windows(found)
    assert windows_agree(table)
    assert "D says the same" in describe_windows(table)


def test_a_sensor_that_wraps_changes_no_window() -> None:
    wrapped, plain = (analyse_ring_downs(decay(shift=shift))["window_lehr_damping"].values for shift in (3.0, 0.0))
    assert wrapped == pytest.approx(plain, rel=1e-9)


@pytest.mark.parametrize("spoilt", [{"gap_s": (0.16, 0.2)}, {"limit": 0.65}])
def test_a_window_is_read_across_no_missing_samples_but_those_of_the_fit(spoilt: dict[str, object]) -> None:
    found = analyse_ring_downs(decay(**spoilt))["window_lehr_damping"].values
    known = np.isfinite(found[0, 0])
    assert known.tolist() == [start >= DECAY_FROM_PERIODS for start in DECAY_WINDOWS]
    assert found[:, :, known] == pytest.approx(1.2 / 20.0, rel=0.01)


def test_the_window_of_the_ring_downs_own_numbers_is_one_of_the_table(results: xr.Dataset) -> None:
    own = DECAY_WINDOWS.index(DECAY_FROM_PERIODS)
    assert (results["window_lehr_damping"].values[:, :, own] == results["paper_lehr_damping"].values).all()


@pytest.mark.slow
def test_each_window_reads_the_d_of_the_true_motion(results: xr.Dataset) -> None:
    """The true torsion has no sensor, no bias and no integration; its peaks from a start on give D directly."""
    groups = [
        Group("ring-down", p, f, 20.0, 0, np.ceil(3 * f) / f, 3.0)
        for p, f in zip(PRETENSION, RING_DOWN_HZ, strict=True)
    ]
    tracks = simulate_tracks(lane_parameters(groups, RIG), groups, 1000.0)
    for p, (group, track) in enumerate(zip(groups, tracks, strict=True)):
        stop, _ = group.sample_counts(1000.0)
        for k, start in enumerate(DECAY_WINDOWS):
            torsion = np.abs(track.torsion[stop + round(1000.0 * start / group.frequency_hz) :])
            at, _ = find_peaks(torsion, height=0.02 * float(torsion.max()))
            true = fit_envelope(at / 1000.0, torsion[at]).lehr_damping
            assert results["window_lehr_damping"].values[p, 0, k] == pytest.approx(true, rel=0.03), start


def test_on_the_papers_rig_d_rises_from_the_stop_on_and_falls_from_two_periods_on(results: xr.Dataset) -> None:
    table = decay_windows(results)
    assert table[0].change.value > 0.2
    assert table[-1].change.value < -0.15
    assert abs(table[DECAY_WINDOWS.index(1.0)].change.value) < 0.05


def test_a_recording_without_a_planned_stop_has_no_windows() -> None:
    alone = decay().isel(segment=[1], sample=np.arange(600, 1400))
    found = analyse_ring_downs(alone)
    assert decay_windows(found) == []
    assert describe_windows([]) == ""


def true_peaks(pretension: float, near: float) -> tuple[float, float, float]:
    """Return (frequency of the largest half of peak to peak, of the largest fundamental, lever there [rad])."""
    frequency = np.round(np.arange(near - 0.12, near + 0.125, 0.01), 3)
    groups = [Group("steady", pretension, float(f), 20.0, 0, 3.0, 5 / float(f)) for f in frequency]
    rows = []
    tracks = simulate_tracks(lane_parameters(groups, RIG), groups, 200.0)
    for group, track in zip(groups, tracks, strict=True):
        start, count = group.sample_counts(200.0)
        angle = 2 * np.pi * group.frequency_hz * np.arange(start, start + count) / 200.0
        design = np.stack([np.sin(angle), np.cos(angle), np.ones(count)], axis=1)
        fits = np.linalg.lstsq(design, np.stack([track.torsion[start:], track.lever[start:]], axis=1))[0]
        swing, lever = np.hypot(*fits[:2])
        rows.append((0.5 * np.ptp(track.torsion[start:]), swing, lever))
    half, swing, lever = np.array(rows).T
    return float(frequency[np.argmax(half)]), float(frequency[np.argmax(swing)]), float(lever[np.argmax(swing)])


@pytest.mark.slow
@pytest.mark.parametrize(("index", "near"), [(0, 3.05), (1, 4.28)])
def test_eq_6_the_fundamental_and_the_lever_at_resonance_are_the_true_ones(
    results: xr.Dataset, index: int, near: float
) -> None:
    """Between the points of a grid of 0.1 Hz, one of which would give a lever 0.3° too large."""
    peaks, fundamental, lever = true_peaks(PRETENSION[index], near)
    one = results.isel(pretension_mm=index)
    assert float(one["paper_resonance_low_hz"]) - 0.01 < peaks < float(one["paper_resonance_high_hz"]) + 0.01
    assert float(one["resonance_low_hz"]) - 0.01 < fundamental < float(one["resonance_high_hz"]) + 0.01
    low, high = (float(one[f"drive_amplitude_at_resonance_{end}_rad"]) for end in ("low", "high"))
    assert low < lever < high
    assert np.degrees(high - low) < 0.5
    assert float(one["drive_amplitude_at_resonance_rad"]) == pytest.approx(lever, abs=np.radians(0.06))


def test_the_table_of_resonances_names_and_holds_all_of_them(results: xr.Dataset) -> None:
    rows = resonance_table(results)
    assert [row["pretension_mm"] for row in rows] == list(PRETENSION)
    assert all(set(row) == {"pretension_mm", *MEANINGS} for row in rows)
    assert rows[1]["paper_resonance_hz"]["value"] < rows[1]["resonance_hz"]["value"]
