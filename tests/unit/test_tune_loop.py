"""The parts of the tracking law, one by one."""

import cmath
import math

import numpy as np
import pytest

from sinew.tune.track import (
    FASTEST_MM_S,
    Follow,
    Fundamental,
    Lock,
    Mode,
    Oscillator,
    PhaseLoop,
    Ramp,
    SwingControl,
    design_loop,
)

MODE = Mode(3.5, 0.07)


def test_a_change_of_frequency_leaves_the_command_without_a_jump() -> None:
    sine = Oscillator(1.0, math.tau * 3.0)
    sine.amplitude = 1.0
    sine.command(1.8)
    before = [sine.phase(time) for time in np.linspace(1.0, 1.8, 9)]
    sine.change(math.tau * 4.0)
    assert [sine.phase(time) for time in np.linspace(1.0, 1.8, 9)] == before
    assert sine.command(1.8 + 1e-9) == pytest.approx(sine.command(1.8), abs=1e-7)
    assert sine.phase(2.8) - sine.phase(1.8) == pytest.approx(math.tau * 4.0)


def test_the_fundamental_is_found_beside_offset_and_third_harmonic_with_samples_missing() -> None:
    rng = np.random.default_rng(1000)
    found = Fundamental()
    wave = 0.3 - 0.4j
    for phase in np.sort(rng.uniform(0, 3 * math.tau, 150)):
        value = 2.0 + (wave * cmath.exp(1j * phase)).real + 0.1 * math.cos(3 * phase + 1)
        found.add(float(phase), value)
    assert found.phasor(3 * math.tau) == pytest.approx(wave, abs=1e-12)


def test_a_turn_with_a_hole_has_no_phasor() -> None:
    found = Fundamental()
    for phase in np.arange(0, math.tau, 0.1):
        if not 2.0 < phase < 3.2:
            found.add(float(phase), math.sin(phase))
    assert found.phasor(math.tau) is None


def test_a_sample_that_comes_twice_counts_once() -> None:
    once, twice = Fundamental(), Fundamental()
    for phase in np.arange(0, math.tau, 0.1):
        once.add(float(phase), math.sin(phase) ** 3 + phase)
        twice.add(float(phase), math.sin(phase) ** 3 + phase)
        twice.add(float(phase), 17.0)
    assert once.phasor(math.tau) == twice.phasor(math.tau)


@pytest.mark.parametrize("damping", [0.02, 0.05, 0.1])
def test_the_gains_leave_at_least_40_degrees_of_phase(damping: float) -> None:
    gains = design_loop(Mode(3.5, damping))
    s = 1j * gains.crossover
    rate = damping * math.tau * 3.5
    loop = (gains.proportional * s + gains.integral) / (s * (s + rate)) * cmath.exp(-s * gains.delay)
    assert abs(loop) == pytest.approx(1.0)
    assert math.degrees(math.pi + cmath.phase(loop)) > 40


def test_the_decay_rate_is_what_turns_a_phase_into_a_frequency() -> None:
    # Lag of a linear oscillator: tan δ = 2 D r / (1 - r²); its slope dδ/dΩ at r = 1 is 1/(D ω₀).
    omega, step = math.tau * 3.5, 1e-4

    def lag(ratio: float) -> float:
        return math.atan2(2 * 0.07 * ratio, 1 - ratio**2)

    slope = (lag(1 + step) - lag(1 - step)) / (2 * step * omega)
    assert slope == pytest.approx(1 / MODE.decay_rate, rel=1e-3)


def test_a_mode_without_damping_has_no_gains() -> None:
    with pytest.raises(ValueError, match="damping 0"):
        design_loop(Mode(3.5, 0.0))


def test_a_loop_at_its_bound_does_not_wind_up() -> None:
    loop = PhaseLoop(design_loop(MODE), 20.0, 15.0, 25.0, 1e6)
    for _ in range(4000):
        loop.update(-1.0, 0.005)
    assert loop.omega == 25.0
    assert loop.is_limited
    cycles = 0
    while loop.update(0.3, 0.005) > 24.0:
        cycles += 1
    assert cycles < 40


def test_the_frequency_moves_no_faster_than_it_may() -> None:
    loop = PhaseLoop(design_loop(MODE), 20.0, 10.0, 40.0, 5.0)
    omegas = [loop.update(-1.5, 0.005) for _ in range(200)]
    assert np.diff([20.0, *omegas]).max() <= 5.0 * 0.005 * (1 + 1e-9)


def test_a_lock_takes_a_whole_turn_below_and_ends_with_a_whole_turn_above() -> None:
    lock = Lock()  # 6° and 30°: 0.105 and 0.524 rad
    assert not lock.update(0.05, 3.0)
    assert not lock.update(0.2, 3.5)
    assert not lock.update(0.05, 3.6)
    assert lock.update(0.05, 4.7)
    assert lock.update(0.4, 6.0)
    assert lock.update(0.6, 7.0)
    assert not lock.update(0.6, 8.1)
    assert (lock.cycles, lock.losses) == (4.7, 1)


def test_the_command_rises_gently_and_to_what_was_asked() -> None:
    control = SwingControl("command", 0.3, 0.8, rise=1.0, rate=0.5)
    sizes = [control.update(None, 0.005) for _ in range(200)]
    assert np.diff([0.0, *sizes]).max() <= 0.8 * 0.005 * (1 + 1e-9)
    assert sizes[-1] == 0.3


def test_a_ramp_waits_for_its_lead_and_for_the_lock() -> None:
    ramp = Ramp(2.0, 8.0, 12.0, lead=1.0)
    assert ramp.update(0.5, 3.0, 0.1) == 2.0
    assert ramp.update(1.5, None, 0.1) == 2.0
    assert ramp.update(2.0, 3.0, 0.1) == pytest.approx(2.05)


def test_following_stays_within_its_range_and_its_speed() -> None:
    path = Follow(lambda _: 9.0, [0.0, 12.0], [3.0, 4.2], rate=1.0)
    reached = [path.update(0.01 * k, 3.1, 0.01) for k in range(2000)]
    assert max(reached) == 12.0
    path = Follow(lambda _: 3.6, [0.0, 12.0], [3.0, 4.2], rate=1.0)
    moved = np.diff([path.update(0.01 * k, 3.0, 0.01) for k in range(50)])
    assert moved.max() <= FASTEST_MM_S * 0.01 * (1 + 1e-9)


def test_following_needs_a_resonance_that_rises_with_pretension() -> None:
    with pytest.raises(ValueError, match="rises"):
        Follow(lambda _: 3.0, [0.0, 12.0], [3.0, 3.0], rate=1.0)
