"""Stepped sines with known mechanics, in closed form or integrated by scipy to the steady state, are fitted back."""

from functools import cache

import numpy as np
import pytest
from campaigns.coverage import response_points
from tests.unit.analysis_sweep import Joint, Sensing, rig_with, sweep
from tests.unit.identify_signals import OMEGA, motion, noisy, viscous

from sinew.analysis.sweep.response import estimate_response
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.record import Record, make_record
from sinew.identify.points import ResponsePoints, make_points, points_of_response, points_of_table
from sinew.identify.steady_fit import fit_response, squeeze_scatter
from sinew.measure.errors import RecordingError, SpecError

INERTIA = 12.74e-3
FREQUENCIES_HZ = np.linspace(2.0, 4.5, 14)
SCATTER = 1e-4


def mechanical_response(frequency_hz: np.ndarray, damping_ratio: float = 0.08) -> np.ndarray:
    """Return motion over acceleration for 3 Hz."""
    omega = 2 * np.pi * frequency_hz
    return 1.0 / (OMEGA**2 - omega**2 + 2j * damping_ratio * OMEGA * omega)


def scattered(response: np.ndarray, seed: int, share: float = SCATTER) -> tuple[np.ndarray, np.ndarray]:
    """Return the response with noise of a share of its largest size, and the standard deviations."""
    std = share * np.abs(response).max()
    rng = np.random.default_rng(seed)
    noise = rng.normal(0, std, (2, response.size))
    return response + noise[0] + 1j * noise[1], np.full(response.size, std)


def points_of(excitation: str, seed: int = 0) -> ResponsePoints:
    """Return noisy points of one linear joint, I_l/I = 0.65 for a lever, I for a torque."""
    omega, bare = 2 * np.pi * FREQUENCIES_HZ, mechanical_response(FREQUENCIES_HZ)
    response = {
        "torque": bare / INERTIA,
        "lever": 0.65 * omega**2 * bare,
        "base": 1.0 + omega**2 * bare,
    }[excitation]
    values, std = scattered(response, seed)
    units = {"output_unit": "rad", "input_unit": "N*m" if excitation == "torque" else "rad"}
    return make_points(FREQUENCIES_HZ, values, std, 0.1, excitation=excitation, **units)


@pytest.mark.parametrize("excitation", ["torque", "lever", "base"])
def test_frequency_damping_and_inertias_of_a_linear_joint_come_back_under_any_excitation(excitation: str) -> None:
    found = fit_response(points_of(excitation), "linear")
    told = {"torque": ("inertia_kg_m2", INERTIA), "lever": ("lever_inertia_ratio", 0.65)}
    if excitation in told:
        name, truth = told[excitation]
        assert found.parameters[name].value == pytest.approx(truth, rel=1e-3)
    assert found.frame == ("absolute" if excitation == "base" else "relative")
    assert (found.natural_frequency_hz.value, found.damping_ratio.value) == (
        pytest.approx(3.0, rel=3e-4),
        pytest.approx(0.08, rel=3e-3),
    )


def test_a_rate_is_fitted_as_a_rate() -> None:
    response = 2j * np.pi * FREQUENCIES_HZ * mechanical_response(FREQUENCIES_HZ)
    values, std = scattered(response, 1)
    points = make_points(FREQUENCIES_HZ, values, std, 1.0, excitation="force", output_unit="m/s", input_unit="N")
    assert fit_response(points, "linear").natural_frequency_hz.value == pytest.approx(3.0, rel=3e-4)


def test_a_loss_factor_is_told_by_the_response_of_a_stiffness_with_a_constant_one() -> None:
    # (jω)^α has the loss factor tan(πα/2) at every frequency and is causal, unlike k(1 + jη).
    # The Prony series behind the fit keeps to a constant loss factor within 2 %.
    frequency = np.linspace(2.4, 3.6, 15)
    alpha = 2 / np.pi * np.arctan(0.2)
    stiffness = OMEGA**2 * (1j * frequency / 3.0) ** alpha / np.cos(0.5 * np.pi * alpha)
    response = 1.0 / (stiffness - (2 * np.pi * frequency) ** 2)
    values, std = scattered(response, 2)
    points = make_points(frequency, values, std, 1.0, excitation="force")
    found = fit_response(points, "loss-factor").parameters["loss_factor"]
    assert found.value == pytest.approx(0.2, rel=0.03)


def test_a_turned_phase_and_a_background_are_found_where_they_are_asked_for() -> None:
    bare = mechanical_response(FREQUENCIES_HZ)
    added = 0.05 * np.abs(bare).max()
    values, std = scattered(bare * np.exp(0.7j) + added, 3)
    points = make_points(FREQUENCIES_HZ, values, std, 1.0, excitation="force")
    found = fit_response(points, "linear", chain=("phase", "background_real", "background_imag")).nuisance
    assert (found["phase_rad"].value, found["background_real"].value) == (
        pytest.approx(0.7, abs=0.01),
        pytest.approx(added, rel=0.05),
    )


def test_a_stepped_sine_far_below_resonance_cannot_tell_inertia_from_stiffness() -> None:
    frequency = np.linspace(0.02, 0.06, 12)
    values, std = scattered(mechanical_response(frequency) / INERTIA, 5, share=3e-3)
    points = make_points(frequency, values, std, 0.1, excitation="torque", output_unit="rad", input_unit="N*m")
    assert any("cannot be" in sentence for sentence in fit_response(points, "linear").unidentifiable)


@cache
def hardening(seed: int, noise: float = 0.0) -> tuple[Record, ...]:
    """Return steady stretches of a hardening joint, k₃ = 6 N m/rad³ and ζ = 0.15, at two torques, from rest."""
    force = viscous(0.15, cubic=6.0 / INERTIA)
    records = []
    for torque in (0.15, 0.45):
        for k, f in enumerate(np.linspace(2.2, 4.6, 7)):
            time = np.arange(0, 7.0, 0.01)
            angle = motion(force, lambda t, a=torque, f=f: a / INERTIA * np.sin(2 * np.pi * f * t), time)[0]
            steady = time > 4.0  # exp(-0.15·18.8·4) = 1e-5 of the start is left
            records.append(
                make_record(
                    time[steady],
                    noisy(angle, noise, 100 * seed + k)[steady],
                    torque * np.sin(2 * np.pi * f * time[steady]),
                    excitation="torque",
                    output_unit="rad",
                    input_unit="N*m",
                    group=f"{torque} N m",
                )
            )
    return tuple(records)


@cache
def hardening_fit(seed: int = 0, noise: float = np.deg2rad(0.05)):
    return fit_response(response_points(hardening(seed, noise)), "cubic")


def test_the_cubic_stiffness_comes_back_from_steady_states_that_scipy_integrated() -> None:
    assert hardening_fit().parameters["cubic_n_m_per_rad3"].value == pytest.approx(6.0, rel=5e-3)


@pytest.mark.slow
def test_fits_in_time_and_in_frequency_agree_on_the_same_stretches_within_their_intervals() -> None:
    in_time = fit(hardening(0, np.deg2rad(0.05)), "cubic").parameters
    in_frequency = hardening_fit().parameters
    off = {
        name: (in_time[name].value - in_frequency[name].value) / np.hypot(in_time[name].std, in_frequency[name].std)
        for name in in_time
    }
    assert max(map(abs, off.values())) < 3


def test_a_linear_model_of_a_hardening_joint_is_told_by_its_residuals_and_by_the_criterion() -> None:
    found = fit_response(response_points(hardening(0, np.deg2rad(0.05))), "linear")
    assert any("misses the points" in sentence for sentence in found.tests.sentences())
    assert hardening_fit().tests.sentences() == ()
    assert hardening_fit().bic() < found.bic() - 10


@pytest.mark.slow
def test_of_two_steady_states_at_one_frequency_the_measured_one_is_meant() -> None:
    # Between its folds the joint has a large and a small motion: the drive comes to 3.7 Hz from below, or starts there.
    force, torque, f, values = viscous(0.05, cubic=6.0 / INERTIA), 0.45, 3.7, []
    time = np.arange(0, 30.0, 0.01)
    for first in (3.0, f):

        def phase(t, first=first):
            ramp = np.minimum(t, 20.0)
            return 2 * np.pi * (f * t - (f - first) * (ramp - ramp**2 / 40.0))

        angle = motion(force, lambda t, phase=phase: torque / INERTIA * np.sin(phase(t)), time)[0]
        steady = time > 24.0
        record = make_record(
            time[steady],
            angle[steady],
            torque * np.sin(phase(time[steady])),
            excitation="torque",
            output_unit="rad",
            input_unit="N*m",
        )
        values.append(response_points([record])[0].response[0])
    sides = np.array([1.5, 2.0, 2.4, 5.0, 5.5])
    linear = 1 / INERTIA / (OMEGA**2 - (2 * np.pi * sides) ** 2 + 0.1j * OMEGA * 2 * np.pi * sides)
    everything = np.r_[values, linear]
    std = np.r_[2 * [1e-3 * abs(values[1])], 0.03 * np.abs(linear)]  # the sides steady the search, no more
    frequency = np.r_[f, f, sides]
    small = np.r_[torque, torque, 5 * [1e-4]]
    points = make_points(frequency, everything, std, small, excitation="torque", output_unit="rad", input_unit="N*m")
    found = fit_response(points, "cubic")
    assert abs(values[0]) > 2 * abs(values[1])
    assert found.parameters["cubic_n_m_per_rad3"].value == pytest.approx(6.0, rel=0.02)


def dry_points() -> tuple[ResponsePoints, ...]:
    """Return points of a joint with viscous and dry friction, 4 rad/s² of it, at two levels that keep it moving.

    All of them are integrated at once, in steps of 0.25 ms, within which a reversal is not located: Runge-Kutta's
    order is lost there, for a thousandth of a period.
    """
    levels, frequencies = np.repeat([30.0, 80.0], 7), np.tile([2.4, 2.7, 2.9, 3.0, 3.1, 3.3, 3.6], 2)
    step, every = 2.5e-4, 40

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        push = levels * np.sin(2 * np.pi * frequencies * t)
        return np.stack([y[1], push - viscous(0.04)(y[0], y[1]) - 4.0 * np.sign(y[1])])

    y, seen = np.zeros((2, 14)), []
    for n in range(36_000):
        if n % every == 0:
            seen.append(y[0].copy())
        t = n * step
        k1 = rate(t, y)
        k2 = rate(t + step / 2, y + step / 2 * k1)
        k3 = rate(t + step / 2, y + step / 2 * k2)
        y = y + step / 6 * (k1 + 2 * k2 + 2 * k3 + rate(t + step, y + step * k3))
    time = step * every * np.arange(len(seen))
    steady, angle = time > 6.0, np.array(seen)
    records = [
        make_record(
            time[steady],
            angle[steady, k],
            level * np.sin(2 * np.pi * f * time[steady]),
            excitation="force",
            output_unit="rad",
            group=f"{level:g}",
        )
        for k, (level, f) in enumerate(zip(levels, frequencies, strict=True))
    ]
    return response_points(records)


@pytest.mark.slow
def test_dry_friction_comes_back_from_two_levels_of_the_drive() -> None:
    found = fit_response(dry_points(), "coulomb")
    assert (found.parameters["coulomb_rad_per_s2"].value, found.damping_ratio.value) == (
        pytest.approx(4.0, rel=0.02),
        pytest.approx(0.04, rel=0.03),
    )


def test_scatter_that_differs_by_chance_alone_becomes_one_scatter() -> None:
    rng = np.random.default_rng(6)
    std = 1e-3 * np.sqrt(rng.chisquare(12, 40) / 12)
    points = make_points(np.linspace(2, 4, 40), np.ones(40), std, 1.0, excitation="force", scatter_freedom=12.0)
    squeezed = np.sqrt(squeeze_scatter(points).covariance[:, 0, 0])
    assert np.ptp(np.log(squeezed)) < 0.35 * np.ptp(np.log(std))


def test_scatter_that_differs_beyond_chance_stays_apart() -> None:
    std = np.where(np.arange(40) < 20, 1e-3, 1e-2)
    points = make_points(np.linspace(2, 4, 40), np.ones(40), std, 1.0, excitation="force", scatter_freedom=24.0)
    squeezed = np.sqrt(squeeze_scatter(points).covariance[:, 0, 0])
    assert squeezed[-1] / squeezed[0] > 8


def test_variances_that_scatter_about_a_common_one_count_with_its_degrees_of_freedom_too() -> None:
    """Smyth (2004): s² = s₀² d₀/χ²(d₀) · χ²(d)/d has d + d₀ degrees of freedom once it is drawn together."""
    random, size, own, common = np.random.default_rng(5), 4000, 16.0, 10.0
    variance = common / random.chisquare(common, size) * random.chisquare(own, size) / own
    points = ResponsePoints(
        np.linspace(1.0, 2.0, size), np.ones(size, complex), variance[:, None, None] * np.eye(2), np.ones(size), "base",
        scatter_freedom=own,
    )  # fmt: skip
    assert squeeze_scatter(points).scatter_freedom == pytest.approx(own + common, rel=0.1)


def test_an_analysed_recording_gives_the_points_of_each_pretension_with_the_sensor_chain_undone() -> None:
    joints = [Joint(natural_hz=3.0), Joint(natural_hz=3.6)]
    recording = sweep(joints, np.linspace(2.2, 4.6, 13), sensing=Sensing(), seed=5)
    points = points_of_response(estimate_response(recording, rig_with(Sensing())))
    assert [one.group for one in points] == ["0 mm", "1 mm"]
    hertz = [fit_response(one, "linear").natural_frequency_hz.value for one in points]
    assert hertz == pytest.approx([3.0, 3.6], rel=2e-3)


def table(phase_sign: int = -1, repeats: int = 1, share: float = 0.0) -> dict[str, np.ndarray]:
    """Return the rows of a linear joint under two torques, each repeated with a scatter.

    It is a share of the size, of a tenth of the largest where that is less.
    """
    frequency = np.tile(FREQUENCIES_HZ, 2 * repeats)
    torque = np.repeat([0.05, 0.2], FREQUENCIES_HZ.size * repeats)
    rng = np.random.default_rng(11)
    noise = share * (rng.standard_normal(frequency.size) + 1j * rng.standard_normal(frequency.size))
    bare = mechanical_response(frequency) / INERTIA
    response = (bare + noise * np.hypot(np.abs(bare), 0.1 * np.abs(bare).max())) * torque
    phase = -phase_sign * np.angle(response)
    return {"frequency_hz": frequency, "amplitude": np.abs(response), "phase_rad": phase, "drive": torque}


def points_in(**rows: np.ndarray) -> tuple[ResponsePoints, ...]:
    return points_of_table(**rows, excitation="torque", output_unit="rad", input_unit="N*m")


def test_rows_of_a_table_are_grouped_by_the_level_of_the_drive() -> None:
    groups = points_in(**table())
    assert [(one.group, one.size) for one in groups] == [("0.05 N*m", 14), ("0.2 N*m", 14)]


@pytest.mark.parametrize("phase_sign", [-1, 1])
def test_a_phase_that_counts_either_way_is_the_same_lag(phase_sign: int) -> None:
    groups = points_in(**table(phase_sign))
    assert groups[0].response == pytest.approx(mechanical_response(FREQUENCIES_HZ) / INERTIA, rel=1e-12)
    assert any("lag" in one for one in groups[0].notes) == (phase_sign == 1)


def test_repeated_rows_tell_the_scatter_of_all() -> None:
    groups = points_in(**table(repeats=20, share=0.02))
    largest = np.argmax(np.abs(groups[1].response))
    share = np.sqrt(groups[1].covariance[largest, 0, 0]) / np.abs(groups[1].response[largest])
    assert share == pytest.approx(0.02, rel=0.08)  # of 1064 degrees of freedom, at a largest drawn high


def test_rows_that_are_no_steady_states_are_refused() -> None:
    with pytest.raises(RecordingError, match="above zero"):
        points_in(**(table() | {"drive": np.zeros(28)}))


def test_the_delay_of_the_output_is_undone() -> None:
    time = np.arange(0, 3, 0.01)
    record = make_record(
        time,
        np.sin(2 * np.pi * 3 * (time - 0.02)),
        np.sin(2 * np.pi * 3 * time),
        excitation="lever",
        output_unit="rad",
        input_unit="rad",
        output_delay_s=0.02,
    )
    assert np.angle(response_points([record])[0].response[0]) == pytest.approx(0.0, abs=1e-6)


def test_fewer_points_than_numbers_are_refused() -> None:
    points = points_of("torque").only(np.arange(1))
    with pytest.raises(RecordingError, match="fit a smaller model"):
        fit_response(points, "cubic")


def test_a_chain_that_nobody_knows_is_refused() -> None:
    with pytest.raises(SpecError, match="expected some of phase"):
        fit_response(points_of("torque"), "linear", chain=("delay",))
