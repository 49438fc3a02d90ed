"""Records of hammer blows through `sn.analyse`: known joints, bad hits, and intervals."""

from typing import Any

import numpy as np
import pandas as pd
import pytest
from tests.experiments.impacts import Mode, Pulse, coverage, jobs, run_trial, struck
from tests.unit.broadband_signals import transfer

import sinew as sn

TWO: list[Mode] = [(3.0, 0.03, 1.0), (7.0, 0.02, 0.2)]
HITS = [Pulse(0.5 + 6 * k, force, 0.015) for k, force in enumerate([1.0, 0.6, 0.8])]


def blows(pulses: list[Pulse] = HITS, duration_s: float = 18.5, seed: int = 1, **noises: float) -> pd.DataFrame:
    return struck(TWO, pulses, duration_s, np.random.default_rng(seed), **noises)


def noisy(pulses: list[Pulse] = HITS, duration_s: float = 18.5) -> pd.DataFrame:
    return blows(pulses, duration_s, force_noise=0.003, response_noise=0.01)


def analysed(table: pd.DataFrame, **options: Any) -> sn.results.Analysed:
    recording = sn.read(table, time="t", drive="force:N", response="phi:deg", kind="impact", gaps="split")
    return sn.analyse(recording, **options)


def numbers(found: sn.results.Analysed, key: str = "value") -> list[Any]:
    names = ("natural_frequency_hz", "damping_ratio")
    return [mode[name][key] for mode in found.to_dict()["modes"] for name in names]


TRUTH = [3.0, 0.03, 7.0, 0.02]


def test_as_many_modes_are_found_as_the_joint_has() -> None:
    assert numbers(analysed(noisy())) == pytest.approx(TRUTH, rel=0.05)


@pytest.mark.parametrize("block_s", [1.0, 2.5, 5.0])
def test_the_damping_that_the_exponential_window_adds_is_not_in_the_modes(block_s: float) -> None:
    # behind 1 s the window adds 3 1/s to decays of 0.57 and 0.88 1/s, and four tenths of the swing are cut off
    found = analysed(blows(), segment_s=block_s, modes=2, band_hz=(1.0, 15.0))
    assert found.to_dict()["window"]["decay_per_s"] == pytest.approx(np.log(20) / block_s, rel=0.01)
    assert numbers(found) == pytest.approx(TRUTH, rel=0.01)


def test_the_response_is_that_of_the_joint_on_the_line_of_its_window() -> None:
    found = analysed(blows(HITS[:1], 6.5), modes=2)
    sigma = found.to_dict()["window"]["decay_per_s"]
    rows = [row for row in found.to_dict()["frequency_response"] if 1.5 < row["frequency_hz"] < 9]
    frequency = np.array([row["frequency_hz"] for row in rows]) - 1j * sigma / (2 * np.pi)
    truth = np.radians(1) * transfer(TWO, frequency)
    # what the block cuts off of a mode is exp(-(σ + ζω) 6 s) of it, 0.0017 of the slower
    near = {"rel": 0.005, "abs": 0.0017 * np.abs(truth).max()}
    assert [row["gain"]["value"] for row in rows] == pytest.approx(np.abs(truth), **near)
    assert [row["fitted_gain"] for row in rows] == pytest.approx(np.abs(truth), **near)
    lag = np.radians([row["phase_lag_deg"]["value"] for row in rows])
    assert np.abs(truth) * np.exp(-1j * lag) == pytest.approx(truth, **near)


def test_several_hits_have_a_coherence_and_h2_above_h1() -> None:
    rows = [row for row in analysed(noisy()).to_dict()["frequency_response"] if 2.5 < row["frequency_hz"] < 3.5]
    assert min(row["coherence"] for row in rows) > 0.9
    assert all(row["gain_h2"] >= row["gain"]["value"] for row in rows)


def test_one_hit_has_modes_but_no_coherence_and_says_so() -> None:
    found = analysed(noisy(HITS[:1], 6.0))
    assert numbers(found) == pytest.approx(TRUTH, rel=0.1)
    assert {row["coherence"] for row in found.to_dict()["frequency_response"]} == {None}
    assert any("no coherence" in note for note in found.notes)


def test_hits_of_triggered_captures_are_averaged_over_the_gaps_between_them() -> None:
    table = noisy()
    t = table["t"]
    kept = [(t > hit.at_s - 0.1) & (t < hit.at_s + 5) for hit in HITS]
    found = analysed(table[np.any(kept, axis=0)])
    assert found.recording.sizes["segment"] == 3
    assert found.to_dict()["averages"] == 3
    assert [hit["time_s"] for hit in found.to_dict()["hits"]] == pytest.approx([0.51, 6.51, 12.51], abs=0.01)


def used(found: sn.results.Analysed) -> list[bool]:
    return [hit["used"] for hit in found.to_dict()["hits"]]


BOUNCE = Pulse(6.56, 0.3, 0.015)


def test_a_double_hit_is_left_out_and_said() -> None:
    found = analysed(noisy([*HITS, BOUNCE]))
    assert used(found) == [True, False, True]
    assert any("double hit, 60 ms apart; left out" in note for note in found.notes)


def test_force_and_response_beyond_their_ranges_are_found_and_left_out() -> None:
    table = noisy()
    found = analysed(table.assign(force=table["force"].clip(upper=0.85)))
    assert used(found) == [False, True, True]
    assert "overload, the force is cut off" in found.to_dict()["hits"][0]["remark"]
    top = float(table["phi"].abs().max())
    assert used(analysed(table.assign(phi=table["phi"].clip(-0.9 * top, 0.9 * top)))) == [False, True, True]
    step = top / 100  # digits at the turn of a slow swing are no overload
    assert used(analysed(table.assign(phi=(table["phi"] / step).round() * step))) == [True] * 3


def test_a_hit_with_too_little_behind_it_is_left_out() -> None:
    assert used(analysed(noisy([*HITS, Pulse(18.0, 1.0, 0.015)], 19.0))) == [True, True, True, False]


def test_a_swing_that_is_left_when_the_next_hit_comes_is_said() -> None:
    close = [Pulse(0.5 + 2 * k, 1.0, 0.015) for k in range(4)]
    found = analysed(noisy(close, 8.5))
    assert any("of the swing is left" in note for note in found.notes)
    assert numbers(found)[:2] == pytest.approx(TRUTH[:2], rel=0.1)


def test_a_drive_without_a_hit_and_a_response_that_stands_still_are_refused() -> None:
    with pytest.raises(sn.RecordingError, match="found no hit"):
        analysed(blows().assign(force=lambda table: np.sin(table["t"])))
    with pytest.raises(sn.RecordingError, match="answers the drive at no frequency"):
        analysed(noisy().assign(phi=1.0), band_hz=(1.0, 5.0))


@pytest.mark.slow
def test_the_intervals_of_the_modes_hold_what_they_say() -> None:
    # 36 records, 108 intervals; the campaign counts more
    rows = [run_trial(job) for job in jobs(6)]
    share, count = coverage(rows)
    assert count >= 100
    assert share >= 0.8
