"""Fits of models to oscillations whose mechanics are known."""

import numpy as np
import pytest
from benchmarks.sweep_fit import sweep_record
from tests.unit.identify_signals import OMEGA, chirp, dry_decay, motion, noisy, viscous

from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.least_squares import solve
from sinew.identify.oscillator.record import make_record
from sinew.identify.oscillator.track import LOCAL, track, track_slopes
from sinew.measure.errors import RecordingError, SpecError

TIME = np.arange(0, 3, 0.01)
SWEEP = np.arange(0, 16, 0.01)
PHASE = chirp(1, 6, 16)


def off(estimate, truth: float) -> float:
    """Return the error in standard deviations."""
    return abs(estimate.value - truth) / estimate.std


def decay_record(damping_ratio: float, seed: int = 0, **kind: float):
    x = motion(viscous(damping_ratio, **kind), lambda t: 0.0, TIME, (0.5, 0.0))[0]
    return make_record(TIME, noisy(x + 0.02, 0.005, seed), output_unit="rad")


def lever(t):
    return 0.3 * np.sin(PHASE(t))


def lever_acceleration(t, h: float = 1e-4):
    return (lever(t + h) - 2 * lever(t) + lever(t - h)) / h**2


@pytest.mark.parametrize("damping_ratio", [0.05, 0.1, 0.17, 0.25])
def test_a_free_decay_gives_its_damping_within_four_standard_deviations(damping_ratio: float) -> None:
    assert off(fit(decay_record(damping_ratio), "linear").damping_ratio, damping_ratio) < 4


def test_the_rest_position_of_a_decay_is_not_taken_for_motion_nor_for_frequency() -> None:
    found = fit(decay_record(0.1), "linear")
    assert off(found.nuisance["offset"], 0.02) < 4
    assert found.natural_frequency_hz.value == pytest.approx(3.0, rel=2e-3)


def test_the_sweep_gives_its_cubic_stiffness_within_twice_the_interval_and_its_inertia_within_3_per_mille() -> None:
    found = fit(sweep_record(0), "cubic").parameters
    assert off(found["cubic_n_m_per_rad3"], 6.0) < 3.3
    assert found["inertia_kg_m2"].value == pytest.approx(12.74e-3, rel=3e-3)


def test_the_cubic_stiffness_without_noise_is_exact_to_one_in_ten_thousand() -> None:
    cubic = fit(sweep_record(0, noise=1e-9), "cubic").parameters["cubic_n_m_per_rad3"]
    assert cubic.value == pytest.approx(6.0, rel=1e-4)


def test_an_asymmetric_spring_gives_its_quadratic_term() -> None:
    force = viscous(0.05, quadratic=300.0, cubic=400.0)
    r = motion(force, lambda t: 20.0 * np.sin(PHASE(t)), SWEEP)[0]
    record = make_record(SWEEP, noisy(r, 0.002, 1), 20 * np.sin(PHASE(SWEEP)), excitation="force", output_unit="rad")
    assert off(fit(record, "cubic-quadratic").parameters["quadratic_per_s2_rad"], 300.0) < 4


@pytest.mark.parametrize("seen", ["rad", "rad/s"])
def test_a_lever_gives_the_share_of_its_inertia(seen: str) -> None:
    r = motion(viscous(0.1), lambda t: -0.6 * lever_acceleration(t), SWEEP)
    output = noisy(r[0], 0.005, 2) if seen == "rad" else noisy(r[1], 0.05, 2)
    record = make_record(
        SWEEP, output, noisy(lever(SWEEP), 4e-4, 3), excitation="lever", output_unit=seen, input_unit="rad"
    )
    assert off(fit(record, "linear").parameters["lever_inertia_ratio"], 0.6) < 4


@pytest.mark.slow
@pytest.mark.parametrize("frame", ["relative", "absolute"])
def test_a_moving_base_gives_the_damping_and_whether_the_motion_over_it_is_absolute(frame: str) -> None:
    r = motion(viscous(0.1), lambda t: -lever_acceleration(t), SWEEP)[0]
    output = noisy(r + (frame == "absolute") * lever(SWEEP), 0.005, 4)
    record = make_record(SWEEP, output, lever(SWEEP), excitation="base", output_unit="rad", input_unit="rad")
    found = fit(record, "linear")
    assert found.frame == frame
    assert off(found.damping_ratio, 0.1) < 4


def test_a_late_output_is_put_right_by_its_stated_delay() -> None:
    r = motion(viscous(0.1), lambda t: 20 * np.sin(PHASE(t)), SWEEP)[0]
    late = np.interp(SWEEP - 0.012, SWEEP, r)
    record = make_record(
        SWEEP, noisy(late, 0.003, 5), 20 * np.sin(PHASE(SWEEP)), excitation="force", output_delay_s=0.012
    )
    assert fit(record, "linear").natural_frequency_hz.value == pytest.approx(3.0, rel=1e-3)


def test_dry_friction_is_told_apart_from_viscous_damping() -> None:
    t = np.arange(0, 8, 0.005)
    record = make_record(t, noisy(dry_decay(t, 0.5, 0.0, 0.8, 0.02), 0.001, 6), output_unit="rad")
    found = fit(record, "coulomb").parameters
    assert max(off(found["coulomb_rad_per_s2"], 0.8), off(found["damping_per_s"], 0.04 * OMEGA)) < 4


def test_a_decay_that_friction_brings_to_rest_is_simulated_to_a_ten_thousandth() -> None:
    t = np.arange(0, 8, 0.01)
    truth = dry_decay(t, 0.5, 0.0, 2.0, 0.01)
    found = fit(make_record(t, truth, output_unit="rad"), "coulomb")
    assert np.abs(found.predicted[0] - truth).max() < 5e-5


@pytest.mark.slow
def test_a_noisy_decay_with_dry_friction_has_no_smaller_sum_of_squares_at_the_truth() -> None:
    # The best minimum is at most what is reached from the truth; a search from one side stops at a step before it.
    time = np.arange(0, 2.5, 1 / 130)
    for seed in range(1000, 1006):
        x = dry_decay(time, 0.5, 0.0, friction=3.0, damping_ratio=0.04)
        found = fit(make_record(time, noisy(x, 0.02, seed), output_unit="rad"), "coulomb")
        scales = found.layout.parts[0].scales
        truth = {"stiffness": OMEGA**2, "damping": 0.08 * OMEGA, "coulomb": 3.0, "start": 0.5}
        begin = [truth.get(one.local, 0.0) for one in found.layout.entries]
        sizes = [
            scales.amplitude if one.local == "offset" else scales.physical(one.local) for one in found.layout.entries
        ]
        from_truth = solve(found.layout.problem(found.selected), np.array(begin) / sizes, tolerance=1e-8)
        assert found.solution.sum_of_squares <= from_truth.sum_of_squares * (1 + 1e-4)


def test_a_pendulum_from_a_hundred_degrees_gives_its_small_swing_frequency() -> None:
    t = np.arange(0, 10, 0.01)
    x = motion(lambda r, v: 0.05 * OMEGA * v + OMEGA**2 * np.sin(r), lambda t: 0.0, t, (np.deg2rad(100), 0.0))[0]
    found = fit(make_record(t, noisy(x, 0.003, 7), output_unit="rad"), "pendulum")
    assert off(found.natural_frequency_hz, 3.0) < 4


def test_several_records_share_their_mechanics_and_keep_their_own_start() -> None:
    alone = fit(decay_record(0.1, seed=8), "linear")
    together = fit([decay_record(0.1, seed=8), decay_record(0.1, seed=9)], "linear")
    assert together.damping_ratio.std == pytest.approx(alone.damping_ratio.std / np.sqrt(2), rel=0.2)


def test_a_loss_factor_is_found_again_from_the_twins_own_series() -> None:
    from tests.unit.prony import complex_stiffness

    from sinew.mechanics.silicone import prony_shares

    shares, hertz = prony_shares(0.2), np.linspace(1.0, 6.0, 11)
    relaxed = OMEGA**2 / complex_stiffness(shares, 3.0).real
    t = np.arange(0, 20, 0.01)
    output, given = np.zeros_like(t), np.zeros_like(t)
    for i, f in enumerate(hertz):  # a steady multisine: the complex stiffness gives its response exactly
        response = 1.0 / (relaxed * complex_stiffness(shares, f) - (2 * np.pi * f) ** 2)
        wave = 20 * np.exp(1j * (2 * np.pi * f * t + i**2))
        output, given = output + (response * wave).real, given + wave.real
    record = make_record(t, noisy(output, 0.002, 2), given, excitation="force")
    assert fit(record, "loss-factor").parameters["loss_factor"].value == pytest.approx(0.2, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["linear", "coulomb", "loss-factor", "drag", "bouc-wen"])
def test_the_derivatives_of_a_track_are_its_differences(model: str) -> None:
    from sinew.identify.oscillator.model import get_model
    from sinew.identify.oscillator.record import Scales, grid_of
    from sinew.solve.programs import configure

    configure()
    law = get_model(model).law
    record = make_record(TIME, np.sin(TIME), 0.3 * np.sin(OMEGA * TIME), excitation="force")
    grid, _ = grid_of(record, Scales(OMEGA, 1.0, 1.0), "relative", law)
    sizes = {"stiffness": 1.0, "loss_factor": 0.1025, "coulomb": 0.02, "quadratic": 0.05, "start": 0.3, "offset": 0.0}
    sizes |= {"creep_time": -1.0, "memory": 0.3, "yield": 0.4}
    p = np.array([sizes.get(name, 0.1) for name in LOCAL])
    free = np.array([i for i, name in enumerate(LOCAL)])
    slopes = track_slopes(p, free, grid, law, 0)
    for i in free:
        step = np.where(np.arange(p.size) == i, 1e-6, 0.0)
        ends = [track(p + sign * step, grid, law, 0) for sign in (-1, 1)]
        assert slopes[:, i] == pytest.approx((ends[1] - ends[0]) / 2e-6, abs=1e-5)


def test_an_input_without_an_excitation_is_refused_with_the_words_there_are() -> None:
    with pytest.raises(SpecError, match="force, torque, base, lever"):
        make_record(TIME, np.sin(TIME), np.sin(TIME))


def test_a_constant_output_is_refused() -> None:
    with pytest.raises(RecordingError, match="the output is constant"):
        fit(make_record(TIME, np.ones_like(TIME)), "linear")


def test_a_sample_that_is_no_number_is_refused_with_its_place() -> None:
    output = np.sin(TIME)
    output[7] = np.nan
    with pytest.raises(RecordingError, match="the output holds NaN or infinity at sample 7"):
        make_record(TIME, output)


def test_a_fit_to_no_record_is_refused() -> None:
    with pytest.raises(SpecError, match="no record to fit"):
        fit([], "linear")


def test_an_unknown_model_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(SpecError, match="loss-factor"):
        fit(decay_record(0.1), "quartic")
