"""The paper's envelope of a decay: an exponential through the peaks, and their mean spacing."""

from dataclasses import dataclass

import numpy as np
from scipy import optimize

from sinew.analysis.decay.free_decay import Peaks
from sinew.measure.arrays import Array

_NOISE_SHARE = 5.0  # a peak is used while it is this many times its own uncertainty,
_SMALLEST_PEAK = 0.02  # and this share of the largest
_SPACING = (0.6, 1.6)  # of the spacing before; outside it a peak is missing or was made by noise


@dataclass(frozen=True)
class Envelope:
    """The paper's numbers of one ring-down (section 4.2), with the damped frequency as printed.

    amplitude, decay_rate_per_s: A and λ of A·exp(-λ(t - time_s[0])) through the sizes of the peaks.
    omega_rad_s: ⟨ω⟩, π over the mean spacing of the peaks: the damped frequency.
    decay_rate_std_per_s, omega_std_rad_s: their standard deviations from the scatter of the peaks; NaN for 2 peaks.
    time_s, size: the peaks that were used, shape (h,), about the rest position.
    inertia_kg_m2: I, or None where the stiffness and damping are not asked for.
    """

    amplitude: float
    decay_rate_per_s: float
    decay_rate_std_per_s: float
    omega_rad_s: float
    omega_std_rad_s: float
    time_s: Array
    size: Array
    inertia_kg_m2: float | None = None

    @property
    def lehr_damping(self) -> float:
        """Return D = λ/⟨ω⟩ (paper Eq. 7); 1/sqrt(1 - D²) larger than the damping ratio."""
        return self.decay_rate_per_s / self.omega_rad_s

    @property
    def lehr_damping_std(self) -> float:
        """Return the standard deviation of D from those of λ and ⟨ω⟩."""
        relative = np.hypot(self.decay_rate_std_per_s / self.decay_rate_per_s, self.omega_std_rad_s / self.omega_rad_s)
        return self.lehr_damping * float(relative)

    @property
    def quality(self) -> float:
        """Return Q = 1/(2 D) (paper Eq. 8)."""
        return 0.5 / self.lehr_damping

    @property
    def damping_n_m_s_rad(self) -> float:
        """Return d = 2 λ I (paper Eq. 9) [N m s/rad]; NaN without inertia."""
        return 2.0 * self.decay_rate_per_s * self._inertia()

    @property
    def stiffness_n_m_rad(self) -> float:
        """Return k = ⟨ω⟩² I (paper Eq. 10) [N m/rad]; (1 - D²) of the stiffness below; NaN without inertia."""
        return self.omega_rad_s**2 * self._inertia()

    @property
    def stiffness_undamped_n_m_rad(self) -> float:
        """Return k = (⟨ω⟩² + λ²) I [N m/rad], the stiffness of the damped oscillator; NaN without inertia."""
        return (self.omega_rad_s**2 + self.decay_rate_per_s**2) * self._inertia()

    def _inertia(self) -> float:
        return float("nan") if self.inertia_kg_m2 is None else self.inertia_kg_m2


def large_peaks(peaks: Peaks, rest: Array) -> tuple[Array, Array]:
    """Return (times, heights about the rest position) of the regular peaks that stand well out of the noise.

    rest: shape (h,), rest position at the peaks. The row ends at the first peak that is small, on the wrong side or
    out of step.
    """
    height = peaks.value - rest
    size = np.abs(height)
    floor = max(_NOISE_SHARE * peaks.value_std, _SMALLEST_PEAK * float(size.max(initial=0.0)))
    end = 0
    while end < size.size and size[end] > floor:
        if end > 0 and height[end] * height[end - 1] > 0:
            break
        if end > 1:
            ratio = (peaks.time_s[end] - peaks.time_s[end - 1]) / (peaks.time_s[end - 1] - peaks.time_s[end - 2])
            if not _SPACING[0] < ratio < _SPACING[1]:
                break
        end += 1
    return peaks.time_s[:end], height[:end]


def fit_envelope(time_s: Array, size: Array, inertia_kg_m2: float | None = None) -> Envelope:
    """Return the paper's fit through the sizes of at least two peaks.

    time_s, size: shape (h,), both-sided peaks about the rest position, all of one weight (nonlinear least squares).
    """
    t = time_s - time_s[0]
    span, scale = float(t[-1]), float(size[0])
    slope = -float(np.polyfit(t / span, np.log(size), 1, w=size)[0])

    def deviation(p: Array) -> Array:
        return np.asarray(p[0] * np.exp(-p[1] * t / span) - size / scale)

    def jacobian(p: Array) -> Array:
        fading = np.exp(-p[1] * t / span)
        return np.stack([fading, -p[0] * t / span * fading], axis=1)

    found = optimize.least_squares(deviation, np.array([1.0, slope]), jac=jacobian, method="lm")
    n = t.size
    if n > 2:
        variance = 2.0 * float(found.cost) / (n - 2)
        gram = jacobian(found.x).T @ jacobian(found.x)
        rate_std = float(np.sqrt(variance * np.linalg.pinv(gram)[1, 1])) / span
        order = np.arange(n) - 0.5 * (n - 1)
        step = float(order @ t) / float(order @ order)
        scatter = float(np.sum((t - t.mean() - step * order) ** 2)) / (n - 2)
        omega_std = np.sqrt(2.0 * scatter) / span * np.pi * (n - 1) / span
    else:
        rate_std = omega_std = float("nan")
    return Envelope(
        float(found.x[0]) * scale,
        float(found.x[1]) / span,
        rate_std,
        float(np.pi * (n - 1) / span),
        float(omega_std),
        time_s,
        size,
        inertia_kg_m2,
    )
