"""Broadband recordings through `sn.analyse`: modes of known joints, whatever shook them and however it was sampled."""

import numpy as np
import pandas as pd
import pytest
from tests.unit.broadband_signals import Mode, chirp, multisine, noise, shaken, transfer

import sinew as sn

TWO: list[Mode] = [(3.0, 0.05, 1.0), (5.0, 0.03, 0.4)]
EXCITATIONS = pytest.mark.parametrize("kind", [noise, chirp, multisine])


def analysed(table: pd.DataFrame, **options) -> sn.results.Analysed:
    recording = sn.read(table, time="t", drive="u:N*m", response="phi:deg", kind="broadband", gaps="split")
    return sn.analyse(recording, **options)


def numbers(found: sn.results.Analysed) -> list[dict]:
    keys = ("natural_frequency_hz", "damping_ratio")
    return [mode[key] for mode in found.to_dict()["modes"] for key in keys]


def inside(found: sn.results.Analysed, modes: list[Mode]) -> list[bool]:
    truth = [value for mode in modes for value in mode[:2]]
    pairs = zip(numbers(found), truth, strict=True)
    return [estimate["interval90"][0] <= value <= estimate["interval90"][1] for estimate, value in pairs]


@EXCITATIONS
def test_as_many_modes_are_found_as_the_joint_has(kind) -> None:
    values = [estimate["value"] for estimate in numbers(analysed(shaken(kind, TWO, 1)))]
    assert values == pytest.approx([3.0, 0.05, 5.0, 0.03], rel=0.05)


@pytest.mark.slow
@EXCITATIONS
def test_the_90_percent_intervals_cover_the_modes(kind) -> None:
    covered = [one for seed in range(40) for one in inside(analysed(shaken(kind, TWO, seed), modes=2), TWO)]
    assert np.mean(covered) >= 0.85


@EXCITATIONS
def test_the_response_is_that_of_the_joint_in_gain_and_lag(kind) -> None:
    table = shaken(kind, [(3.0, 0.15, 1.0)], 2)
    document = analysed(table).to_dict()
    rows = [row for row in document["frequency_response"] if 1.5 < row["frequency_hz"] < 6 and row["coherence"] > 0.9]
    truth = np.radians(1) * transfer([(3.0, 0.15, 1.0)], np.array([row["frequency_hz"] for row in rows]))
    assert len(rows) > 15
    assert [row["gain"]["value"] for row in rows] == pytest.approx(np.abs(truth), rel=0.08)
    assert [row["phase_lag_deg"]["value"] for row in rows] == pytest.approx(-np.degrees(np.angle(truth)), abs=5)


def test_a_drive_that_repeats_itself_is_averaged_over_its_periods() -> None:
    document = analysed(shaken(multisine, TWO, 3)).to_dict()
    assert (document["period_s"], document["averages"]) == (8.0, pytest.approx(14))


def test_a_record_with_a_gap_has_the_modes_of_its_pieces() -> None:
    table = shaken(noise, TWO, 5)
    found = analysed(table.drop(index=range(5000, 5700)))
    assert found.recording.sizes["segment"] == 2
    assert [estimate["value"] for estimate in numbers(found)] == pytest.approx([3.0, 0.05, 5.0, 0.03], rel=0.05)


def test_uneven_samples_are_interpolated_and_said_so() -> None:
    table = shaken(chirp, TWO, 6, share=0.0)
    rng = np.random.default_rng(6)
    stamps = np.sort(table["t"] + 0.004 * rng.uniform(-1, 1, table.shape[0]))
    uneven = pd.DataFrame({"t": stamps} | {name: np.interp(stamps, table["t"], table[name]) for name in ("u", "phi")})
    found = analysed(uneven)
    assert any("cubic splines" in note for note in found.notes)
    assert [estimate["value"] for estimate in numbers(found)] == pytest.approx([3.0, 0.05, 5.0, 0.03], rel=0.05)


def test_a_record_read_as_a_sweep_is_taken_whole_where_that_is_asked() -> None:
    table = shaken(noise, TWO, 8)
    sweep = sn.read(table, time="t", drive="u:N*m", response="phi:deg", kind="sweep")
    assert sn.analyse(sweep, kind="broadband").to_dict() == analysed(table).to_dict()
