"""Ring-downs that others measured: cast silicone, a pendulum with dry friction, a rod that swings to 157 degrees.

Their numbers are those of the SOURCE.txt beside each recording. The recordings are no part of this repository.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.signal import find_peaks
from scipy.special import ellipk
from tests.experiments.halves import Halves, halves_of

from sinew.analysis.decay.modes import fit_modes
from sinew.analysis.decay.ring_down import RingDown, analyse_ring_down

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="real recordings are not beside this repository")

# name: frequency [Hz], damping ratio by peaks of the first six half cycles, by an exponential fit over 1.5 s
SILICONE = {
    "beam_gravity_V2_a": (7.70, 0.067, 0.051),
    "beam_gravity_V2_b": (7.71, 0.069, 0.053),
    "beam_load52_V2_a": (4.32, 0.068, 0.063),
    "beam_load52_V2_b": (4.29, 0.060, 0.056),
    "beam_load101_V2_a": (3.35, 0.070, 0.066),
    "beam_load101_V2_b": (3.35, 0.084, 0.079),
}
PENDULUM_HZ = {
    "60": 4.71,
    "70": 3.98,
    "80P": 3.46,
    "90p": 3.08,
    "100": 2.745,
    "110Pnedulum-120-14-1.6-2": 2.73,
    "120Pnedulum-120-14-1.6-2": 2.50,
    "120Pnedulum-120-14-1.6": 2.29,
}
each_beam = pytest.mark.parametrize("name", SILICONE)
each_pendulum = pytest.mark.parametrize("name", PENDULUM_HZ)
each_swing = pytest.mark.parametrize("name", ["01", "02", "03"])


def beam_record(name: str):
    table = pd.read_csv(DATA / "silicone_beam_dragonskin10" / f"{name}.csv")
    return table["t_s"].to_numpy(), table[[f"Tip-{i}_x_m" for i in (1, 2, 3)]].mean(axis=1).to_numpy()


@cache
def beam(name: str) -> RingDown:
    return analyse_ring_down(*beam_record(name), unit="m")


def pendulum_record(name: str):
    table = pd.read_csv(DATA / "torsion_spring_pendulum" / f"{name}.csv")
    index = np.arange(len(table))
    step = np.polyfit(index, table["host_time_s"], 1)[0]
    return step * index, table["angle_deg"].to_numpy()


@cache
def pendulum(name: str) -> RingDown:
    return analyse_ring_down(*pendulum_record(name), unit="deg")


def swing_record(name: str):
    angle = np.loadtxt(DATA / "rotary_pendulum_swing" / f"pendulum_free_swing_data_{name}.txt", skiprows=2)
    return np.arange(angle.size) / 1000, np.deg2rad(angle)


@cache
def swing(name: str) -> RingDown:
    return analyse_ring_down(*swing_record(name))


@each_beam
def test_the_frequency_of_the_silicone_beam_is_within_one_percent_of_its_source(name: str) -> None:
    assert beam(name).frequency_hz.value == pytest.approx(SILICONE[name][0], rel=0.01)


@each_beam
def test_the_damping_of_the_silicone_beam_is_between_its_two_methods_within_ten_percent(name: str) -> None:
    high, low = SILICONE[name][1:]
    assert 0.9 * low <= beam(name).damping_ratio.value <= 1.1 * high


@each_beam
def test_the_free_decay_of_the_silicone_beam_starts_after_its_release(name: str) -> None:
    t, x = beam_record(name)
    released = t[np.argmax(np.abs(x - x[:20].mean()) > 3e-4)]
    assert 0 < beam(name).start_s - released < 1 / SILICONE[name][0]


def test_the_two_beams_with_the_larger_load_differ_in_damping_by_about_a_fifth() -> None:
    a, b = (beam(f"beam_load101_V2_{side}").damping_ratio.value for side in "ab")
    assert b / a == pytest.approx(1.2, abs=0.05)


@each_pendulum
def test_dry_friction_makes_the_spring_pendulum_no_exponential_but_damping_that_rises_at_small_amplitude(
    name: str,
) -> None:
    shape, table = pendulum(name).shape, pendulum(name).dependence
    large, small = table.amplitude > 15, (table.amplitude > 1) & (table.amplitude < 3)
    assert not shape.exponential
    assert shape.reason.startswith("damping rises")
    assert table.damping_ratio[small].mean() > 1.2 * table.damping_ratio[large].mean()


@each_pendulum
def test_the_mean_frequency_of_the_spring_pendulum_is_within_one_percent_of_its_source(name: str) -> None:
    assert pendulum(name).paper.omega_rad_s / (2 * np.pi) == pytest.approx(PENDULUM_HZ[name], rel=0.01)


@pytest.mark.parametrize(
    ("low", "high", "damping"), [(15, 30, 0.0065), (7, 15, 0.0068), (3, 7, 0.0079), (1, 3, 0.0120)]
)
def test_the_damping_of_the_80_mm_pendulum_in_bins_of_amplitude(low: float, high: float, damping: float) -> None:
    table = pendulum("80P").dependence
    inside = (table.amplitude > low) & (table.amplitude < high)
    assert table.damping_ratio[inside].mean() == pytest.approx(damping, rel=0.1)


@each_swing
def test_the_rod_softens_and_keeps_the_exact_frequency_of_a_pendulum_within_two_percent(name: str) -> None:
    # Small-swing frequency of a thin rod about its end, from its length of 124 mm alone; nothing is fitted.
    small_hz = np.sqrt(1.5 * 9.81 / 0.124) / (2 * np.pi)
    table = swing(name).dependence
    exact = small_hz * np.pi / (2 * ellipk(np.sin(table.amplitude / 2) ** 2))
    assert table.frequency_hz == pytest.approx(exact, rel=0.02)
    assert "softening" in swing(name).shape.reason
    assert name != "02" or np.rad2deg(table.amplitude.max()) > 100  # of the largest swing that is compared


@each_swing
def test_the_damping_of_the_rod_is_the_fall_of_its_crests_over_the_area_under_them_within_four_percent(
    name: str,
) -> None:
    t, x = swing_record(name)
    result = swing(name)
    inside = (t > result.start_s - 0.08) & (t < result.stop_s)
    index = np.sort(np.r_[find_peaks(x[inside], 0.1, distance=150)[0], find_peaks(-x[inside], 0.1, distance=150)[0]])
    size = np.abs(x[inside][index])
    # <λ> = fall/area and <ω> = π Σ (mean size of a half cycle)/area
    turned = np.pi * np.sum(0.5 * (size[1:] + size[:-1]))
    assert result.damping_ratio.value == pytest.approx((size[0] - size[-1]) / turned, rel=0.04)


@pytest.mark.slow
def test_the_intervals_of_large_and_of_small_swings_meet_in_85_of_100_pairs() -> None:
    pairs: list[Halves] = []
    for name in SILICONE:
        pairs += halves_of(*beam_record(name), beam(name), unit="m")
    for name in PENDULUM_HZ:
        pairs += halves_of(*pendulum_record(name), pendulum(name), unit="deg")
    for name in ("01", "02", "03"):
        pairs += halves_of(*swing_record(name), swing(name), unit="rad")
    assert np.mean([pair.meet for pair in pairs]) >= 0.85


def test_two_close_modes_of_the_beam_with_52_g_have_one_frequency_in_both_repeats() -> None:
    # So it is not another mode in which its repeats differ (`tests.paper.test_identify_recordings`).
    a, b = (
        sorted(
            mode.natural_frequency_hz.value
            for mode in fit_modes(*beam_record(name), free_from_s=beam(name).start_s, modes=2, creeps=True).modes
        )
        for name in ("beam_load52_V2_a", "beam_load52_V2_b")
    )
    assert (a[0], a[1]) == (pytest.approx(b[0], abs=0.03), pytest.approx(b[1], abs=0.08))
