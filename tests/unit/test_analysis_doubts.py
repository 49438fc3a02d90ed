"""What a measurement says against itself: silence on a good recording, the right sentence on a spoilt one."""

from typing import Any

import numpy as np
import pytest
import xarray as xr
from tests.experiments.doubted import changed, doubts, expected_of, frozen, scaled_gyro, swapped_axes, the_plan

from sinew.analysis.analysed import analyse_recording, decay_rows
from sinew.analysis.doubts import doubt_decays, group_doubts, possible_damping
from sinew.analysis.signal.signals import read_signals
from sinew.measure.estimate import NORMAL_90
from sinew.measure.recording import iterate_segments
from sinew.plan.toml import dump_rig, load_rig
from sinew.twin.simulate import simulate

RIG = load_rig("paper")
PLAN = the_plan()
BESIDE = ("damping_ratio_std", "damping_ratio_misfit")


@pytest.fixture(scope="module")
def good() -> xr.Dataset:
    return simulate(PLAN, RIG, seed=3)


@pytest.fixture(scope="module")
def expected() -> str:
    return expected_of(PLAN, RIG)


def of_a_bench(**factors: float) -> xr.Dataset:
    """Return the recording of a bench whose parameters are not those of its rig file."""
    return simulate(PLAN, changed(RIG, **factors), seed=3).assign_attrs(rig=dump_rig(RIG))


def by_kind(found: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    return {one["kind"]: one for one in found}


def test_a_good_recording_raises_no_doubt(good: xr.Dataset, expected: str) -> None:
    assert doubts(good, RIG) == []
    assert doubts(good.assign_attrs(expected=expected), RIG) == []


def test_a_lever_that_a_fifth_of_the_duty_moved_is_doubted_by_name_and_place() -> None:
    found = by_kind(doubts(of_a_bench(drive__duty_limit=0.2), RIG))
    assert set(found) == {"lever", "saturation"}
    assert len(found["lever"]["where"]) == 2 * 8
    assert found["lever"]["distance"] > 10
    assert "goal PWM" in found["lever"]["sentence"]
    assert "never touched its limit" in found["saturation"]["sentence"]


@pytest.mark.parametrize("factor", [0.5, 1.6])
def test_a_gyro_of_another_scale_contradicts_the_lever(good: xr.Dataset, factor: float) -> None:
    found = by_kind(doubts(scaled_gyro(good, factor), RIG))
    assert set(found) == {"torsion"}
    assert "gyro's scale" in found["torsion"]["sentence"]


def test_a_gyro_of_another_scale_is_not_on_the_foretold_curve(good: xr.Dataset, expected: str) -> None:
    found = by_kind(doubts(scaled_gyro(good, 1.6).assign_attrs(expected=expected), RIG))
    assert "far from the rig's prediction" in found["response"]["sentence"]
    assert "lever" not in found


def test_a_reversed_gyro_gives_a_lag_that_no_joint_has(good: xr.Dataset) -> None:
    found = by_kind(doubts(scaled_gyro(good, -1.0), RIG))
    assert "lags by 0° to 180°" in found["phase"]["sentence"]


def test_a_gyro_whose_axes_are_swapped_is_told_by_the_axis_that_swings(good: xr.Dataset) -> None:
    assert "imu_axes" in by_kind(doubts(swapped_axes(good), RIG))["axis"]["sentence"]


def test_a_head_that_does_not_answer_is_told(good: xr.Dataset) -> None:
    found = by_kind(doubts(scaled_gyro(good, 0.0), RIG))
    assert found["silence"]["distance"] is None  # no number: it is impossible


@pytest.mark.parametrize(
    ("channel", "seconds", "words"),
    [
        ("gyro_rad_s", 0.3, "the gyro repeats one value"),
        ("acceleration_m_s2", 0.3, "the accelerometer repeats"),
        ("drive_rad", 0.8, "the drive's encoder repeats"),
    ],
)
def test_a_sensor_that_repeats_itself_is_named(good: xr.Dataset, channel: str, seconds: float, words: str) -> None:
    found = [one for one in doubts(frozen(good, channel, seconds), RIG) if one["kind"] == "frozen"]
    assert len(found) == 1
    assert words in found[0]["sentence"]
    assert found[0]["where"][0]["pretension_mm"] == 2.0


def test_half_the_mass_on_the_lever_moves_the_resonance_away_from_the_foretold_one(expected: str) -> None:
    found = by_kind(doubts(of_a_bench(inertia__lever=0.5).assign_attrs(expected=expected), RIG))
    assert "masses on the lever" in found["resonance"]["sentence"]


def test_tendons_that_were_not_pulled_as_the_plan_says_are_told_by_their_motors(good: xr.Dataset) -> None:
    label = good["pretension_mm"]
    found = by_kind(doubts(good.assign(pretension_mm=label.copy(data=np.where(label == 9, 12.0, label))), RIG))
    assert "slipped pulley" in found["pretension"]["sentence"]


def test_a_damping_that_the_rig_cannot_give_is_doubted(good: xr.Dataset) -> None:
    results = analyse_recording(good, RIG)
    low, high = possible_damping(RIG, 3.0)
    assert low < float(results["damping_ratio"].mean()) < high
    for factor in (0.1, 10.0):
        spoilt = results.assign(damping_ratio=factor * results["damping_ratio"])
        assert "silicone and guides" in doubt_decays(spoilt, read_signals(good, RIG))[0].sentence


def test_what_one_damping_leaves_out_of_a_decay_stands_beside_its_noise(good: xr.Dataset) -> None:
    # damping falls with the swing in the guides: what another start reads is beyond the noise, within the misfit
    results = analyse_recording(good, RIG)
    ratio, noise, misfit = (results[name].values[..., None] for name in ("damping_ratio", *BESIDE))
    apart = np.abs(results["window_lehr_damping"].values - ratio)
    assert (apart.max(axis=-1) > 3 * NORMAL_90 * noise[..., 0]).all()
    assert (apart < NORMAL_90 * np.hypot(noise, misfit)).all()
    assert [row.damping_ratio_misfit for row in decay_rows(results)] == pytest.approx(misfit[:, 0, 0])


def of_one_group(recording: xr.Dataset) -> list[str]:
    _, segment, where = next(one for one in iterate_segments(recording, "steady") if one[1].frequency_hz == 3.2)
    channels = (recording["time_s"], recording["drive_rad"], recording["gyro_rad_s"][:, 0])
    return group_doubts(RIG, segment, *(np.asarray(channel.values[where], dtype=float) for channel in channels))


def test_a_run_says_after_the_group_that_the_lever_went_too_short_or_the_gyro_stood_still(good: xr.Dataset) -> None:
    assert of_one_group(good) == []
    assert "goal PWM" in of_one_group(of_a_bench(drive__duty_limit=0.2))[0]
    still = good.assign(gyro_rad_s=good["gyro_rad_s"] * 0.0)
    assert "the gyro repeats one value" in of_one_group(still)[0]
