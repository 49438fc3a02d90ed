"""Ring-downs in closed form: viscous, with dry friction, after a hold, a drive or nothing."""

from dataclasses import dataclass

import numpy as np

FREQUENCY_HZ = 3.0


@dataclass(frozen=True)
class Decay:
    """A linear decay φ = A e^{-λt} cos(ω_d t + phase) of an oscillator with natural frequency 3 Hz.

    damping: Lehr's ratio. amplitude: A, in the unit of φ. phase: [rad].
    """

    damping: float = 0.08
    amplitude: float = 30.0
    phase: float = 0.0

    @property
    def decay_rate(self) -> float:
        return self.damping * 2 * np.pi * FREQUENCY_HZ

    @property
    def omega(self) -> float:
        return 2 * np.pi * FREQUENCY_HZ * np.sqrt(1 - self.damping**2)

    def _wave(self, t):
        return self.amplitude * np.exp((1j * self.omega - self.decay_rate) * t + 1j * self.phase)

    def angle(self, t):
        return self._wave(t).real

    def rate(self, t):
        return ((1j * self.omega - self.decay_rate) * self._wave(t)).real

    def driven_until_zero(self, t):
        """Return an oscillation at the natural frequency before t = 0 and the free decay behind it."""
        steady = self.amplitude * np.cos(2 * np.pi * FREQUENCY_HZ * t + self.phase)
        return np.where(t < 0, steady, self.angle(np.maximum(t, 0)))

    def held_until_zero(self, t):
        """Return a hold at the amplitude before t = 0 and the decay from rest behind it."""
        s = np.maximum(t, 0)
        released = np.cos(self.omega * s) + self.decay_rate / self.omega * np.sin(self.omega * s)
        return np.where(t < 0, self.amplitude, self.amplitude * np.exp(-self.decay_rate * s) * released)


def times(duration_s: float = 3.0, sample_hz: float = 100.0, before_s: float = 0.0):
    return np.arange(-round(before_s * sample_hz), round(duration_s * sample_hz)) / sample_hz


def lever(t):
    """Return a drive at the natural frequency that stops at its zero crossing, t = 0, and then rings a little."""
    after = np.maximum(t, 0)
    return np.where(t < 0, 20 * np.sin(2 * np.pi * FREQUENCY_HZ * t), 1.5 * np.exp(-12 * after) * np.sin(60 * after))


def coloured(rng, size):
    """Return unit noise as a gyroscope at 200 Hz gives it: averaged over three samples, low-passed at 41 Hz."""
    noise = np.convolve(rng.standard_normal(size + 42), np.ones(3) / 3, mode="valid")
    pole = np.exp(-2 * np.pi * 41 / 200)
    out = np.empty_like(noise)
    state = 0.0
    for i, value in enumerate(noise):
        state = pole * state + (1 - pole) * value
        out[i] = state
    # variance of a three-sample mean behind a first-order low-pass, from its impulse response
    response = (1 - pole) * np.convolve(np.ones(3) / 3, pole ** np.arange(200))
    return out[40:] / np.sqrt(np.sum(response**2))


def dry_friction(t, amplitude=30.0, step=0.4, damping=0.005):
    """Return a decay with viscous and dry friction in closed form: each half cycle swings about ±step (Coulomb)."""
    omega, rate = 2 * np.pi * FREQUENCY_HZ * np.sqrt(1 - damping**2), damping * 2 * np.pi * FREQUENCY_HZ
    half = np.pi / omega
    out = np.zeros_like(t)
    start = amplitude
    for k in range(int(np.ceil(t[-1] / half)) + 1):
        centre = step * np.sign(start)
        inside = (t >= k * half) & (t < (k + 1) * half)
        s = t[inside] - k * half
        swing = np.exp(-rate * s) * (np.cos(omega * s) + rate / omega * np.sin(omega * s))
        out[inside] = centre + (start - centre) * swing
        following = centre - (start - centre) * np.exp(-rate * half)
        if abs(following) <= step:
            out[t >= (k + 1) * half] = following
            break
        start = following
    return out
