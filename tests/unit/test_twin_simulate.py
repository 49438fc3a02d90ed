"""The twin's recording: schema, seed, sensors, provenance."""

import numpy as np
import pytest
import xarray as xr

from sinew.measure.files.netcdf import content_hash
from sinew.measure.recording import iterate_segments
from sinew.plan.plan import Plan, Pretension, RingDown, Sweep
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.twin import sensors
from sinew.twin.parameters import Effects
from sinew.twin.simulate import foresee, rest_tension, simulate

PLAN = Plan(
    name="short",
    pretension=Pretension(pretension_mm=(0.0, 8.0)),
    sweep=Sweep(frequency_hz=(2.0, 3.4), settle_s=1.0, repeats=2),
    ring_down=RingDown(frequency_hz=(3.0, 3.8), repeats=1, record_s=1.0),
)


@pytest.fixture(scope="module")
def rig() -> RigSpec:
    return load_rig("paper")


@pytest.fixture(scope="module")
def recording(rig: RigSpec) -> xr.Dataset:
    return simulate(PLAN, rig, seed=5)


def _record(recording: xr.Dataset, kind: str, index: int = 0) -> xr.Dataset:
    rows = [where for _, segment, where in iterate_segments(recording) if segment.kind == kind]
    return recording.isel(sample=rows[index])


def test_recording_holds_the_plans_segments_in_order(recording: xr.Dataset) -> None:
    per_pretension = ["idle", *["settle", "steady"] * 4, "settle", "ring-down"]
    assert list(recording["kind"].values) == per_pretension * 2


def test_same_seed_gives_the_same_recording_and_another_seed_another(rig: RigSpec, recording: xr.Dataset) -> None:
    assert content_hash(simulate(PLAN, rig, seed=5)) == content_hash(recording)
    assert content_hash(simulate(PLAN, rig, seed=6)) != content_hash(recording)


def test_a_resting_gyroscope_reads_no_more_than_bias_and_noise(rig: RigSpec, recording: xr.Dataset) -> None:
    idle = _record(recording, "idle")["gyro_rad_s"].values
    assert np.abs(idle).max() < 6 * (rig.imu.gyro_noise.value + rig.imu.gyro_bias.value)


def test_a_resting_accelerometer_reads_gravity_along_the_continuum(recording: xr.Dataset) -> None:
    idle = _record(recording, "idle")["acceleration_m_s2"].values
    np.testing.assert_allclose(idle.mean(axis=0), [9.80665, 0, 0], atol=0.02)


def test_tendon_motors_take_up_the_pretension_less_what_they_give_way(rig: RigSpec, recording: xr.Dataset) -> None:
    idle = _record(recording, "idle", 1)
    tension = rest_tension([8.0], rig)[0]
    given_way = (tension - rig.tendons.first_contact_tension.value) / rig.tendons.servo_stiffness.value
    expected = (8.0e-3 - given_way) / rig.tendons.pulley_radius.value
    assert float(idle["tendon_rad"].mean()) == pytest.approx(expected, abs=2 * np.pi / 4096)
    # scatter of the set pretension, 0.1 mm, moves the tension by about 0.5 N
    pull = tension * rig.tendons.pulley_radius.value / rig.tendons.torque_constant.value
    assert float(idle["tendon_current_a"].mean()) == pytest.approx(pull, rel=0.05)


def test_drive_stops_at_its_zero_crossing_for_a_ring_down(recording: xr.Dataset) -> None:
    before = _record(recording, "settle", 4)["drive_command_rad"].values
    after = _record(recording, "ring-down")["drive_command_rad"].values
    assert np.abs(after).max() == 0.0
    # the last command before the stop is at most one sample's travel from zero
    assert abs(before[-1]) <= np.radians(20) * 2 * np.pi * 3.0 / 200


def test_readings_do_not_depend_on_how_many_samples_are_read_together(
    rig: RigSpec, recording: xr.Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sensors, "_BLOCK", 97)
    again = simulate(PLAN, rig, seed=recording.attrs["seed"])
    assert again.sizes["sample"] > 10 * 97
    xr.testing.assert_equal(again, recording)


def test_stamps_jitter_and_keep_their_order(rig: RigSpec, recording: xr.Dataset) -> None:
    step = np.diff(recording["time_s"].values)
    assert step.min() > 0
    assert np.std(step) == pytest.approx(np.sqrt(2) * rig.bus.stamp_jitter.value, rel=0.1)


def test_gyroscope_lags_the_true_rate_by_the_rigs_delay_budget(rig: RigSpec) -> None:
    ideal = Effects().without("sensor_noise", "stamp_jitter", "repeatability")
    seen = simulate(PLAN, rig, effects=ideal)
    true = simulate(PLAN, rig, effects=ideal.without("sensor_filter"))

    def phase(recording: xr.Dataset) -> float:
        steady = _record(recording, "steady", 1)
        turn = np.exp(-2j * np.pi * 3.4 * steady["time_s"].values)
        return float(np.angle(np.sum(turn * steady["gyro_rad_s"].values[:, 0])))

    # data sheet 5.9 ms for the low-pass, 5 ms for the mean of three samples at 200 Hz
    lag_s = (phase(true) - phase(seen)) / (2 * np.pi * 3.4)
    assert lag_s == pytest.approx(10.9e-3, abs=0.1e-3)


def test_switched_off_effects_are_named_in_the_recording(rig: RigSpec) -> None:
    recording = simulate(PLAN, rig, effects=Effects().without("guide_friction", "sensor_noise"))
    assert recording.attrs["effects_off"] == "guide_friction sensor_noise"


@pytest.mark.parametrize("mode", ["position", "position-with-current-limit", "current"])
def test_every_tendon_mode_gives_a_recording(rig: RigSpec, mode: str) -> None:
    plan = PLAN.model_copy(update={"pretension": Pretension(pretension_mm=(4.0,), mode=mode)})
    current = _record(simulate(plan, rig), "steady", 1)["tendon_current_a"].values
    swing = float(np.ptp(current)) / rig.tendons.current_lsb.value
    if mode == "current":
        assert swing <= 1  # constant to the register's unit
    else:
        assert swing > 3


def test_previewed_torsion_is_the_largest_that_the_gyroscope_integrates_to(rig: RigSpec, recording: xr.Dataset) -> None:
    rate = recording["gyro_rad_s"].values[:, 0].astype(float)
    largest = dict.fromkeys(PLAN.pretension.pretension_mm, 0.0)
    start = 0.0
    for _, segment, where in iterate_segments(recording):
        torsion = np.cumsum(rate[where]) / PLAN.sample_hz + (start if segment.kind in ("steady", "ring-down") else 0.0)
        start = float(torsion[-1])
        largest[segment.pretension_mm] = max(largest[segment.pretension_mm], float(np.abs(torsion).max()))
    np.testing.assert_allclose(foresee(PLAN, rig)[0], list(largest.values()), rtol=0.05)
