"""Impulse tests with a noisy force sensor.

A joint is struck once or twice and rings; measured are the force, with noise of 0.1 to 1 % of its peak, and the
angle, with noise of 0.05 to 0.5 % of its own. Frequency, damping, length of the strokes and noise are drawn anew for
every seed. Counted is how often a nonlinear law is preferred for a linear joint, where at most five in a hundred are
right, how often the intervals of frequency, damping and inertia hold the truth, apart for strokes that are long
beside the period, and how often the law of a nonlinear joint (dry friction, a hardening spring) is found.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.integrate import solve_ivp

from sinew.identify.oscillator.record import Record, make_record

Joint = Literal["linear", "dry friction", "hardening"]

INERTIA, SWING = 12.74e-3, 0.35  # kg m²; rad
_RATE_HZ, _LASTS_S = 400.0, 4.0
_DRY, _HARDENING = 0.15, 0.3  # friction over the spring at the largest swing; of the spring's torque there


@dataclass(frozen=True)
class Struck:
    """What one record is made with. pulses: begin [s], length [s] and strength of every stroke."""

    joint: Joint
    frequency_hz: float
    damping_ratio: float
    pulses: tuple[tuple[float, float, float], ...]
    input_noise: float
    output_noise: float

    @property
    def omega(self) -> float:
        """Return the natural angular frequency [rad/s]."""
        return 2 * math.pi * self.frequency_hz

    def torque(self, t: float) -> float:
        """Return the torque over the inertia [rad/s²]: squared sines whose areas make the rate of the swing."""
        total = 0.0
        for begin, lasts, strength in self.pulses:
            if begin <= t <= begin + lasts:
                area = strength * SWING * self.omega
                total += area * 2 / lasts * math.sin(math.pi * (t - begin) / lasts) ** 2
        return total


def struck_record(truth: Struck, seed: int) -> Record:
    """Return the record: angle [rad] under a torque [N m], at 400 Hz."""
    time = np.arange(0.0, _LASTS_S, 1.0 / _RATE_HZ)
    omega, swing = truth.omega, SWING
    dry = _DRY * omega**2 * swing if truth.joint == "dry friction" else 0.0
    cubic = _HARDENING / (1 - _HARDENING) * omega**2 / swing**2 if truth.joint == "hardening" else 0.0

    def rate(t: float, y: np.ndarray) -> list[float]:
        spring = omega**2 * y[0] + cubic * y[0] ** 3
        return [y[1], truth.torque(t) - 2 * truth.damping_ratio * omega * y[1] - spring - dry * math.tanh(y[1] / 1e-3)]

    edges = sorted({0.0, _LASTS_S, *(at for begin, lasts, _ in truth.pulses for at in (begin, begin + lasts))})
    angle, state = np.zeros_like(time), np.zeros(2)
    for a, b in pairwise(edges):  # no step of the integrator over the edge of a stroke
        mine = (time >= a) & (time < b)
        at = np.concatenate([time[mine], [b]])
        done = solve_ivp(rate, (a, b), state, "LSODA", at, rtol=1e-8, atol=1e-10, max_step=0.01)
        angle[mine], state = done.y[0, :-1], done.y[:, -1]
    force = INERTIA * np.array([truth.torque(float(t)) for t in time])
    rng = np.random.default_rng([seed, 18])
    force = force + truth.input_noise * np.abs(force).max() * rng.standard_normal(time.size)
    angle = angle + truth.output_noise * np.abs(angle).max() * rng.standard_normal(time.size)
    return make_record(time, angle, force, excitation="torque", output_unit="rad", input_unit="N*m")
