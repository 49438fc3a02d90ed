"""Decays as others record them: several modes, blows, clipped and frozen sensors, gaps, few samples, many swings."""

from functools import cache
from typing import Any

import numpy as np
import pytest
import xarray as xr
from campaigns.decays import KINDS, try_one
from scipy.integrate import solve_ivp
from tests.unit.ring_down_signals import FREQUENCY_HZ, Decay, times

from sinew.analysis.analysed import analyse, ring_down_result
from sinew.analysis.decay.ring_down import RingDown, analyse_ring_down
from sinew.measure.errors import RecordingError, TimeError
from sinew.measure.estimate import Estimate
from sinew.measure.read import read

T = times(duration_s=4.0, sample_hz=200.0)


def noise(size: int, std: float = 0.1, seed: int = 1) -> np.ndarray:
    return std * np.random.default_rng(seed).standard_normal(size)


def holds(one: Estimate, value: float) -> bool:
    return one.low <= value <= one.high


def two_modes() -> RingDown:
    other = 6.0 * np.exp(-1.0 * T) * np.cos(2 * np.pi * 11.0 * T + 1.0)
    return analyse_ring_down(T, Decay(0.05, phase=0.7).angle(T) + other + noise(T.size), unit="deg")


def test_of_two_modes_both_are_listed_the_stronger_first() -> None:
    found = two_modes()
    listed = [mode.frequency_hz.value for mode in found.modes]
    assert listed == pytest.approx([FREQUENCY_HZ * np.sqrt(1 - 0.05**2), 11.0], rel=2e-3)
    assert found.damping_ratio.value == pytest.approx(0.05, rel=0.01)


def test_the_stronger_mode_is_answered_though_the_other_has_the_faster_and_larger_peaks() -> None:
    # of 40 at 20 Hz for 0.1 s and 30 at 3 Hz for a second the slow one has the more energy
    blow = 40.0 * np.exp(-10.0 * T) * np.sin(2 * np.pi * 20.0 * T)
    result = analyse_ring_down(T, Decay(0.05, phase=-0.5 * np.pi).angle(T) + blow + noise(T.size), unit="deg")
    assert result.damping_ratio.value == pytest.approx(0.05, rel=0.03)


@pytest.mark.parametrize("share", [0.3, 0.5])
def test_modes_that_beat_for_four_beats_are_both_read_from_the_begin(share: float) -> None:
    t = np.linspace(0.0, 1.82, 1144)
    slow, fast = (
        np.exp(-rate * t) * np.cos(2 * np.pi * hz * t + phase)
        for rate, hz, phase in ((0.62, 7.97, 1), (0.96, 10.459, 2))
    )
    found = analyse_ring_down(t, 5.4 * (fast + share * slow) - 8.0 + noise(t.size, 0.03), unit="mm")
    assert holds(found.decay_rate_per_s, 0.96)
    assert holds(found.frequency_hz, 10.459)
    assert len(found.modes) == 2


def test_clipped_crests_leave_the_damping_and_are_remarked_with_their_limits() -> None:
    clipped = analyse_ring_down(T, np.clip(Decay(0.05).angle(T) + noise(T.size), -12.0, 12.0), unit="deg")
    assert clipped.damping_ratio.value == pytest.approx(0.05, rel=0.01)
    assert "clipped at -12 and 12" in clipped.remarks[0]


def test_a_sensor_that_freezes_for_a_while_leaves_the_damping_and_is_remarked_with_its_time() -> None:
    x = Decay(0.03).angle(T) + noise(T.size)
    x[150:230] = x[150]
    frozen = analyse_ring_down(T, x, unit="deg")
    assert frozen.damping_ratio.value == pytest.approx(0.03, rel=0.01)
    assert "stands still where the body should move, first at 0.755 s" in frozen.remarks[0]


@pytest.mark.parametrize(("unit", "turn"), [("deg", 360.0), ("rad", 2 * np.pi)])
def test_an_angle_that_wraps_is_unwrapped(unit: str, turn: float) -> None:
    x = Decay(0.05, amplitude=turn / 9).angle(T) + turn / 2
    result = analyse_ring_down(T, (x + turn / 2) % turn - turn / 2, unit=unit)
    assert result.damping_ratio.value == pytest.approx(0.05, rel=1e-4)


def test_a_gap_of_a_third_of_a_period_is_bridged() -> None:
    keep = np.abs(T - 0.5) > 0.055
    result = analyse_ring_down(T[keep], (Decay(0.05).angle(T) + noise(T.size))[keep], unit="deg")
    assert holds(result.damping_ratio, 0.05)
    assert "1 gap of up to 0.115 s bridged" in result.remarks[0]


def test_a_gap_longer_than_half_a_period_names_the_period() -> None:
    keep = np.abs(T - 0.5) > 0.1
    with pytest.raises(TimeError, match=r"longer than the half period of 0\.16. s"):
        analyse_ring_down(T[keep], Decay(0.05).angle(T)[keep])


def test_an_oscillation_that_is_largest_at_its_last_sample_is_refused_and_breaks_nothing() -> None:
    for phase in np.linspace(0, np.pi, 9):
        t = times(duration_s=2.0)
        with pytest.raises(RecordingError, match=r"grows|too short|no decay"):
            analyse_ring_down(t, np.exp(2.0 * t) * np.sin(20 * t + phase))


def test_a_decay_that_dies_within_a_swing_is_not_called_too_short() -> None:
    t = times(duration_s=5.0, sample_hz=200.0)
    with pytest.raises(RecordingError) as refusal:
        analyse_ring_down(t, Decay(0.9).angle(t) + noise(t.size, 0.5))
    assert "too short" not in str(refusal.value)


@pytest.mark.slow
def test_five_thousand_swings_give_a_damping_of_two_ten_thousandths() -> None:
    t = np.arange(55_000) / 33.0
    result = analyse_ring_down(t, Decay(2e-4).angle(t) + noise(t.size, 0.3), unit="deg")
    assert result.damping_ratio.value == pytest.approx(2e-4, rel=5e-3)


def test_two_and_a_half_swings_hold_the_truth() -> None:
    t = times(duration_s=2.5 / FREQUENCY_HZ, sample_hz=200.0)
    result = analyse_ring_down(t, Decay(0.05, phase=0.5).angle(t) + noise(t.size), unit="deg")
    assert holds(result.damping_ratio, 0.05)


@cache
def swing_from(degrees: float) -> RingDown:
    t = times(duration_s=30.0)
    found = solve_ivp(
        lambda _, y: [y[1], -((2 * np.pi) ** 2) * np.sin(y[0]) - 0.15 * y[1]],
        (0, 30),
        [np.deg2rad(degrees), 0],
        t_eval=t,
        rtol=1e-9,
        atol=1e-11,
    )
    return analyse_ring_down(t, found.y[0] + noise(t.size, 2e-3))


def test_the_frequency_of_a_large_swing_carries_its_change_with_amplitude_as_misfit_and_says_so() -> None:
    # a pendulum of 1 Hz swings at 0.85 Hz from 90 degrees, and at 1 Hz when it has died out
    one = swing_from(90.0).parts["frequency_hz"]
    assert one.misfit_std > 10 * one.noise.std
    assert "by misfit: its early half, of large swings, and its late one" in swing_from(90.0).misfit


def document_of(result: RingDown) -> dict[str, Any]:
    return ring_down_result(xr.Dataset(), result, result.modes, ()).to_dict()


def test_the_interval_by_noise_alone_stays_in_the_document() -> None:
    document = document_of(swing_from(90.0))
    inner, outer = document["interval_parts"]["frequency_hz"]["noise"], document["frequency_hz"]
    assert outer["interval90"][0] < inner["interval90"][0] < inner["interval90"][1] < outer["interval90"][1]


@pytest.mark.parametrize(
    ("decay", "withheld"),
    [
        (Decay(0.05).angle(T) + noise(T.size), ""),
        (
            Decay(0.12).angle(T) + 15.0 * np.exp(-2.9 * T) * np.cos(2 * np.pi * 5.2 * T + 3.5) + noise(T.size, 0.05),
            "angular frequency",
        ),
        (Decay(0.03).angle(T[::7]) + noise(T[::7].size), "samples in a period are too few"),
    ],
    ids=["one mode", "peaks of two modes", "ten samples a period"],
)
def test_the_papers_method_is_given_where_it_agrees_and_else_withheld_with_the_reason(
    decay: np.ndarray, withheld: str
) -> None:
    paper = document_of(analyse_ring_down(T if decay.size == T.size else T[::7], decay))["paper_method"]
    assert withheld in paper["withheld"]
    assert (paper["lehr_damping"] is None, bool(paper["withheld"])) == (bool(withheld), bool(withheld))


def test_a_frequency_shows_the_digits_that_its_interval_has() -> None:
    pd = pytest.importorskip("pandas")
    t = np.arange(20_000) / 2000.0
    angle = 30 * np.exp(-0.5 * t) * np.cos(2 * np.pi * 212.0951 * t) + noise(t.size, 0.5)
    shown = str(analyse(read(pd.DataFrame({"t": t, "x": angle}), time="t", response="x:mm")))
    assert "212.095" in shown


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_two_decays_of_every_nasty_kind_break_nothing_and_name_no_false_reason(kind: str) -> None:
    outcomes = [try_one((kind, seed)) for seed in (1000, 1001)]
    assert [one.fault for one in outcomes] == ["", ""]
    assert [reason for one in outcomes for reason in one.false] == []
