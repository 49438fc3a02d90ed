"""Directions that a record does not tell."""

import numpy as np
from tests.unit.identify_signals import motion, viscous

from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.model import Fit, Model
from sinew.identify.oscillator.record import make_record
from sinew.mechanics.laws import Linear, Quadratic, Viscous


def odd_swing(noise: float) -> Fit:
    """Return the fit to four periods of a nearly undamped swing whose noise is as odd from half to half as the swing.

    A quadratic term moves the middle of the swing by κ₂A²/2K, which an offset does as well, and adds a second harmonic
    a third as large, to be seen only where the noise is small.
    """
    t = np.arange(40) / 30
    half = np.random.default_rng(5).normal(0, noise, (4, 5))
    x = motion(viscous(0.003), lambda t: 0.0, t, (0.5, 0.0))[0]
    record = make_record(t, x + np.concatenate([half, -half], axis=1).ravel(), output_unit="rad")
    return fit(record, Model("quadratic", Linear() + Viscous() + Quadratic()))


def test_offset_and_quadratic_term_of_a_noisy_steady_swing_are_said_not_to_be_told_apart() -> None:
    assert odd_swing(0.1).unidentifiable == ("offset and quadratic term cannot be told apart in this record",)


def test_with_a_tenth_of_the_noise_the_second_harmonic_tells_them_apart() -> None:
    assert odd_swing(0.01).unidentifiable == ()
