"""A prediction beside a recording: the measured lever's waveform, the joint under it, and the scores."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from tests.unit.prony import complex_stiffness

from sinew.analysis.signal.attitude import LeverMotion, measure_lever
from sinew.measure.arrays import Array
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import Estimate
from sinew.measure.recording import Segment, build_recording
from sinew.mechanics.joint import potential
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.predict.against import PointRow, ReadingRow, measured_of, met, scores_of
from sinew.predict.joint import RESOLUTION, joint_problem, lever_problem
from sinew.solve.balance import Size
from sinew.solve.curves import predict
from sinew.solve.programs import configure
from sinew.twin.parameters import Effects

configure()
SAMPLE_HZ, PERIODS = 400.0, 5


def triangle(phase: Array) -> Array:
    return np.asarray(2 / np.pi * np.arcsin(np.sin(phase)))


def recording(frequencies_hz: list[float], amplitudes: list[float], late_s: float = 0.0, **attrs: str) -> xr.Dataset:
    """Return triangles of the lever with their peaks [rad], stamped late, beside a torsion that does not matter."""
    pieces, sizes, segments = [], [], []
    for f, peak in zip(frequencies_hz, amplitudes, strict=True):
        t = np.arange(round(PERIODS / f * SAMPLE_HZ)) / SAMPLE_HZ
        pieces.append(peak * triangle(2 * np.pi * f * (t - late_s) + 0.4))
        sizes.append(t.size)
        segments.append(Segment("steady", 4.0, f, 20.0, 0))
    drive = np.concatenate(pieces)
    samples = {
        "time_s": np.arange(drive.size) / SAMPLE_HZ,
        "drive_rad": drive,
        "torsion_rad": drive,
    }
    return build_recording(samples, segments, sizes, {"source": "bench", **attrs})


def test_a_triangle_of_the_lever_has_the_harmonics_of_its_series() -> None:
    lever = measure_lever(recording([2.0, 4.0], [0.3, 0.1]))
    # (8/π²) (sin τ - sin(3τ)/9 + sin(5τ)/25), and sin hτ = Re(-j exp(jhτ)).
    assert lever.amplitude[0] == pytest.approx(8 / np.pi**2 * np.array([0.3, 0.1]), rel=1e-3)
    assert lever.orders.tolist() == [3, 5]
    for shares in lever.shares[0]:
        assert shares == pytest.approx([1j / 9, -1j / 25], abs=1e-3)


def test_a_recording_without_a_lever_is_refused() -> None:
    with pytest.raises(RecordingError, match="record drive_rad"):
        measure_lever(recording([2.0], [0.3]).drop_vars("drive_rad"))


def rig() -> RigSpec:
    return load_rig("paper")


COARSE = RESOLUTION._replace(sizes=((Size(7, 64), Size(7, 64)),))
BAND_HZ = (1.5, 2.5)
LINEAR = Effects().without("guide_friction")


def lever_of(amplitude: float, share: complex) -> LeverMotion:
    at = np.array([1.5, 2.0, 2.5])
    shares = np.full((1, 3, 1), share)
    return LeverMotion(np.array([4.0]), at, np.full((1, 3), amplitude), np.array([3]), shares)


@pytest.mark.slow
@pytest.mark.long
def test_a_lever_that_is_a_sine_of_constant_amplitude_is_the_prescribed_lever() -> None:
    amplitude = math.radians(5.0)
    one = predict(lever_problem(rig(), lever_of(amplitude, 0.0), BAND_HZ), BAND_HZ, COARSE).branches[0]
    effects = Effects().without("drive_dynamics")
    other = predict(joint_problem(rig(), [4.0], 5.0, BAND_HZ, effects=effects), BAND_HZ, COARSE).branches[0]
    grid = np.linspace(*BAND_HZ, 9)
    assert np.interp(grid, one.frequency_hz, one.amplitude) == pytest.approx(
        np.interp(grid, other.frequency_hz, other.amplitude), rel=1e-6
    )


@pytest.mark.slow
def test_a_third_harmonic_of_the_lever_moves_a_linear_joint_as_its_transfer_function_says() -> None:
    share, amplitude = 0.1j, math.radians(0.05)
    problem = lever_problem(rig(), lever_of(amplitude, share), BAND_HZ, effects=LINEAR)
    branch = predict(problem, BAND_HZ, COARSE).branches[0]
    p = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), problem.lane.p.p)
    shortening = jnp.asarray(problem.rest[0, 1])
    relaxed = float(jax.grad(jax.grad(potential))(jnp.zeros(()), shortening, p))
    silicone = float(p.torsional_rigidity / (p.length - shortening))
    third = 3 * branch.frequency_hz
    prony = silicone * (complex_stiffness(np.array(p.prony_shares), third) - 1)
    omega = 2 * np.pi * third
    gain = float(p.lever) * omega**2 / (relaxed + prony - float(p.head + p.lever) * omega**2)
    found = branch.harmonics[:, branch.orders == 3][:, 0]
    assert found == pytest.approx(gain * share * amplitude, rel=1e-3)


def test_a_pretension_without_a_measured_lever_is_refused() -> None:
    lever = lever_of(np.nan, 0.0)
    with pytest.raises(RecordingError, match="at 4 mm the recording has no motion of the lever"):
        lever_problem(rig(), lever, BAND_HZ)


def test_what_cannot_be_compared_is_refused() -> None:
    with pytest.raises(SpecError, match="was imported from a table"):
        measured_of(recording([2.0], [0.3], source="import"), rig())
    two = recording([2.0, 2.5], [0.3, 0.3])
    two["amplitude_deg"].values[1] = 10.0
    with pytest.raises(SpecError, match="driven with 10, 20°, expected one amplitude"):
        measured_of(two, rig())
    idle = recording([2.0], [0.3])
    idle["kind"].values[:] = "ring-down"
    with pytest.raises(RecordingError, match="no steady segment"):
        measured_of(idle, rig())


def rows() -> tuple[list[ReadingRow], list[PointRow]]:
    """Return readings of a frequency and a phase at three pretensions, the rig fitted to the first of them."""
    frequency = [met("resonance_hz", estimate(a, 0.02), b) for a, b in ((3.0, 3.03), (4.0, 4.0), (5.0, 4.9))]
    phase = [met("phase_lag_deg", estimate(a, 0.2), b) for a, b in ((1.0, 1.1), (2.0, 1.9), (np.nan, np.nan))]
    places = list(enumerate((0.0, 4.0, 8.0)))
    return (
        [ReadingRow(mm, i == 0, frequency[i], None, None, None, None) for i, mm in places],
        [PointRow(mm, 3.0, i == 0, None, None, None, phase[i]) for i, mm in places],
    )


def estimate(value: float, std: float) -> Estimate:
    return Estimate(value, std, value - 2 * std, value + 2 * std)


def test_scores_are_relative_for_numbers_and_differences_for_angles() -> None:
    scores = scores_of(*rows())
    whole = scores["all"]["resonance_hz"]
    assert whole.count == 3
    assert whole.largest == pytest.approx(0.02)
    assert whole.rms == pytest.approx(math.sqrt((0.01**2 + 0.02**2) / 3))
    assert whole.inside == pytest.approx(2 / 3)
    assert scores["all"]["phase_lag_deg"].rms == pytest.approx(0.1)


def test_scores_tell_what_was_fitted_from_what_was_not_and_the_noise_of_the_measurement() -> None:
    scores = scores_of(*rows())
    assert scores["fitted"]["resonance_hz"].largest == pytest.approx(0.01)
    assert scores["fitted"]["resonance_hz"].noise == pytest.approx(3.03 / 3 * 0.02 / 3)
    assert scores["others"]["resonance_hz"].rms == pytest.approx(0.02 / math.sqrt(2))
    assert scores["others"]["phase_lag_deg"].count == 1


def test_an_error_has_the_interval_of_the_measurement_turned_round() -> None:
    [first, *_], [angle, _, none] = rows()
    assert first.resonance_hz is not None
    error = first.resonance_hz.error
    assert (error.value, error.low, error.high) == pytest.approx((0.01, 3.03 / 3.04 - 1, 3.03 / 2.96 - 1))
    assert none.phase_lag_deg is None
    assert angle.phase_lag_deg is not None
    assert [angle.phase_lag_deg.error.low, angle.phase_lag_deg.error.high] == pytest.approx([-0.3, 0.5])
