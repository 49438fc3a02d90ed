"""A tracked swing made up from sines: what its turns and its point of the backbone must be is known."""

import math

import numpy as np
import pytest
import xarray as xr

from sinew.analysis.signal.signals import DelayBudget, drive_chain, torsion_chain
from sinew.analysis.tracked import tracked_point, tracked_turns
from sinew.measure.errors import RecordingError
from sinew.measure.files.netcdf import provenance
from sinew.measure.recording import Segment, build_recording
from sinew.plan.toml import load_rig

RIG = load_rig("paper")
RATE = 200.0
LEVER, TORSION = math.radians(8.0), math.radians(36.0)


def recording(
    hertz: float = 3.5, error_deg: float = 2.0, seconds: float = 8.0, noise: float = 0.0, drift: float = 0.0
) -> xr.Dataset:
    """Return a swing of which the true lag behind the true lever is 90° and an error, seen by the rig's sensors."""
    rng = np.random.default_rng(1000)
    budget = DelayBudget(
        RATE,
        RIG.imu.low_pass.value,
        RIG.imu.residual_delay.value,
        RIG.imu.average_samples,
        RIG.bus.drive_delay.value,
    )
    time = np.arange(round(seconds * RATE)) / RATE
    phase = math.tau * (hertz * time + 0.5 * drift * time**2)
    omega = math.tau * hertz
    lever = LEVER * complex(drive_chain(budget, hertz)) * np.exp(1j * (phase - 2.0 - math.pi / 2))
    lag = math.radians(90.0 + error_deg)
    rate = 1j * omega * TORSION * complex(torsion_chain(budget, hertz)) * np.exp(1j * (phase - 2.0 - math.pi / 2 - lag))
    third = 0.1 * LEVER * np.cos(3 * phase)
    samples = {
        "time_s": time,
        "drive_command_rad": math.radians(20.0) * np.sin(phase),
        "drive_rad": lever.real + third + noise * rng.standard_normal(time.size),
        "gyro_rad_s": np.stack([rate.real + 0.02, 0 * time, 0 * time], axis=1),
    }
    segment = Segment("tracking", 6.0, math.nan, 20.0, 0)
    return build_recording(samples, [segment], [time.size], provenance("twin"))


def test_turns_have_the_frequency_phase_and_amplitudes_that_were_put_in() -> None:
    turns = tracked_turns(recording(), 0, RIG)
    assert turns.sizes["turn"] == 26  # of 28; the record begins and ends on a zero, which is no crossing
    assert turns["frequency_hz"].values == pytest.approx(3.5, rel=1e-4)
    assert np.degrees(turns["phase_error_rad"].values) == pytest.approx(2.0, abs=0.05)
    assert turns["lever_rad"].values == pytest.approx(LEVER, rel=1e-3)
    assert turns["torsion_rad"].values == pytest.approx(TORSION, rel=1e-3)


def test_a_frequency_that_moves_is_followed_turn_by_turn() -> None:
    turns = tracked_turns(recording(drift=0.05), 0, RIG)
    expected = 3.5 + 0.05 * turns["time_s"].values
    assert turns["frequency_hz"].values == pytest.approx(expected, rel=1e-4)


def test_a_turn_with_a_hole_is_left_out() -> None:
    whole = recording()
    kept = (whole["time_s"].values < 3.0) | (whole["time_s"].values > 3.5)
    samples = {name: whole[name].values[kept] for name in ("time_s", "drive_command_rad", "drive_rad", "gyro_rad_s")}
    segment = Segment("tracking", 6.0, math.nan, 20.0, 0)
    torn = build_recording(samples, [segment], [int(kept.sum())], provenance("twin"))
    turns = tracked_turns(torn, 0, RIG)
    assert turns.sizes["turn"] < 26
    assert np.degrees(turns["phase_error_rad"].values) == pytest.approx(2.0, abs=0.1)


def test_the_point_has_lehrs_damping_of_the_equivalent_linear_joint() -> None:
    point = tracked_point(tracked_turns(recording(error_deg=0.0), 0, RIG), RIG)
    inertia = RIG.inertia.head.value + RIG.inertia.lever.value
    # At phase resonance I_l Ω² θ = d Ω φ and k = I Ω², so D = d/(2 I Ω).
    omega = math.tau * 3.5
    damper = RIG.inertia.lever.value * omega * LEVER / TORSION
    assert point.damping_ratio.value == pytest.approx(damper / (2 * inertia * omega), rel=2e-3)
    assert point.frequency_hz.low < 3.5 < point.frequency_hz.high
    assert point.torsion_deg.value == pytest.approx(36.0, rel=1e-3)


def test_what_is_unknown_of_the_delay_is_in_the_interval_of_the_frequency() -> None:
    point = tracked_point(tracked_turns(recording(), 0, RIG), RIG)
    phase = math.tau * 3.5 * RIG.imu.delay_std.value
    assert point.frequency_hz.std == pytest.approx(phase * point.damping_ratio.value * 3.5, rel=0.05)


def test_too_short_a_motion_gives_no_point() -> None:
    with pytest.raises(RecordingError, match="track longer"):
        tracked_point(tracked_turns(recording(seconds=3.0), 0, RIG), RIG)


def test_another_kind_of_segment_is_refused() -> None:
    steady = recording()
    steady["kind"].values[0] = "steady"
    with pytest.raises(RecordingError, match="expected tracking"):
        tracked_turns(steady, 0, RIG)
