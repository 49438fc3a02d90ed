"""Forced responses predicted from decays and one measured point.

Two oscillators with viscous damping and quadratic drag, one whose spring hardens and one whose spring softens, are
made by scipy's integrator. Of each trial three free decays are known, from three amplitudes, with noise, and one
forced motion at the middle of three levels of the drive, on the flank of its resonance, with an error of its
amplitude. The decays are identified, the gain is taken from the point, and the maxima at all three levels are held
against those that a stepped sine by the same integrator has: error of the amplitude, and whether the truth lies in
the 90 % interval. What the drive does to the motion is never told.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from sinew.identify.forced import Forced, Through
from sinew.identify.identified import identify
from sinew.identify.oscillator.record import make_record
from sinew.measure.arrays import Array

ERROR = 0.03
_RATE_HZ, _DECAY_S = 100.0, 4.0
_TURNS, _LAST = 100, 4  # periods that a steady state is waited for, and that are looked at
_SAMPLES = 256


@dataclass(frozen=True)
class Oscillator:
    """r'' + d r' + c |r'| r' + k r + k₃ r³ = push sin Ωt, r in rad.

    starts: of the decays [rad]. pushes: the three levels [rad/s²]; their ratio is all that a trial is told.
    at_hz: frequency of the measured point. band_hz: where the maxima lie, in the direction in which a sweep finds them.
    noise: of a decay's samples [rad]; point_noise: of the measured amplitude, as a share of it.
    """

    name: str
    stiffness: float
    damping: float
    drag: float
    cubic: float
    starts: tuple[float, float, float]
    pushes: tuple[float, float, float]
    at_hz: float
    band_hz: tuple[float, float]
    noise: float = 0.004
    point_noise: float = 0.005

    def rate(self, t: float, y: Array, push: float, omega: float) -> list[float]:
        """Return the rates of motion and speed."""
        lost = (self.damping + self.drag * abs(y[1])) * y[1]
        return [y[1], push * np.sin(omega * t) - lost - (self.stiffness + self.cubic * y[0] ** 2) * y[0]]


_K = (2 * np.pi * 3.0) ** 2
HARDENING = Oscillator("hardening", _K, 0.5, 0.08, 0.9 * _K, (0.6, 0.4, 0.2), (3.0, 6.0, 12.0), 2.9, (2.9, 3.9))
SOFTENING = Oscillator("softening", _K, 0.5, 0.08, -0.5 * _K, (0.6, 0.4, 0.2), (3.0, 6.0, 12.0), 3.1, (3.15, 2.5))
OSCILLATORS = {one.name: one for one in (HARDENING, SOFTENING)}


@cache
def clean_decay(one: Oscillator, start: float) -> tuple[Array, Array]:
    """Return time and motion of a free decay, without noise."""
    time = np.arange(0, _DECAY_S, 1 / _RATE_HZ)
    done = solve_ivp(one.rate, (0, time[-1]), [start, 0.0], "DOP853", time, args=(0.0, 1.0), rtol=1e-9, atol=1e-11)
    return time, done.y[0]


def swing(one: Oscillator, push: float, hertz: float, state: Array) -> tuple[float, Array]:
    """Return half of peak to peak of the steady motion that a state leads to, and its state at the end of a period."""
    omega = 2 * np.pi * hertz
    last = np.linspace(_TURNS - _LAST, _TURNS, _LAST * _SAMPLES + 1) / hertz
    end = last[-1]
    done = solve_ivp(one.rate, (0, end), state, "DOP853", last, args=(push, omega), rtol=1e-8, atol=1e-10)
    return 0.5 * float(np.ptp(CubicSpline(last, done.y[0])(np.linspace(last[0], end, 20 * last.size)))), done.y[:, -1]


@cache
def measured(one: Oscillator) -> float:
    """Return the true amplitude of the forced motion that is measured [rad], from rest at the middle level."""
    return swing(one, one.pushes[1], one.at_hz, np.zeros(2))[0]


def predicted(one: Oscillator, seed: int, draws: int = 100) -> Forced:
    """Return the prediction of a trial. seed: of all noise."""
    rng = np.random.default_rng([seed, list(OSCILLATORS).index(one.name)])
    records = []
    for start in one.starts:
        time, motion = clean_decay(one, start)
        noisy = motion + one.noise * rng.standard_normal(time.size)
        records.append(make_record(time, noisy, output_unit="rad", group="decays"))
    seen = measured(one) * (1 + one.point_noise * float(rng.standard_normal()))
    levels = [push / one.pushes[1] for push in one.pushes]
    point = Through(one.at_hz, seen, one.point_noise * seen, 1.0)
    return identify(records, "drag-cubic").predict(torque=levels, through=point, draws=draws, seed=seed)
