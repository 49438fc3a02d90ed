"""This is where a ring-down is fitted by maximum likelihood: oscillation, drifting rest position and coloured noise."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sinew.analysis.coloured_noise import orthonormal
from sinew.analysis.decay_fit import DecayFit, fit_decay
from sinew.analysis.free_decay import block_means, checked_record, evenly, free_decay
from sinew.identify.autoregressive import LikelihoodFit, fit_likelihood
from sinew.identify.oscillation import FreeOscillation, polynomials
from sinew.measure.estimate import Estimate

__all__ = ["RESTS", "FreeDecay", "first_coefficients", "fit_free_decay", "fit_oscillation", "pole_estimates"]

Array = NDArray[np.float64]

RESTS = ("constant", "linear", "creep")
_TAIL = 3.0  # windows of the least-squares fit: behind it only the rest position moves, and tells how it does
_STRONG = 6.0  # fall of Bayes' criterion that lets two more parameters in
_CREEP_SCAN = (0.04, 0.08, 0.15, 0.3, 0.6, 1.2)  # of the window, to start from
_CREEP_RANGE = (0.03, 5.0)  # of the window: time constants that it can tell from a jump and from a line
_STEPS = 400
_FAR = 8.0
_TURN = 2.0 * math.pi


@dataclass(frozen=True)
class FreeDecay:
    """What a free decay says, every number with its 90 % interval.

    frequency_hz: damped; natural_frequency_hz: sqrt(ω_d² + λ²)/2π; damping_ratio: λ/sqrt(ω_d² + λ²);
    decay_rate_per_s: λ. Where rate and frequency change (`amplitude_dependent`), means over the window weighted by the
    amplitude, ∫ λ A dt/∫ A dt.
    amplitude: at the first time, unit of the response. rest_drift: change of the rest position over the window.
    creep_time_s: time constant of the rest position's relaxation, None unless `rest` is "creep".
    noise_std: of one sample; noise_coefficients: of its autoregression, empty where white.
    whiteness_p: of Ljung and Box's test that its innovations are white. bic: smaller is better.
    time_s, values, curve, rest_position: of the window that was fitted, shape (n,).
    message: a sentence on what to beware of, or empty.
    """

    frequency_hz: Estimate
    natural_frequency_hz: Estimate
    damping_ratio: Estimate
    decay_rate_per_s: Estimate
    amplitude: Estimate
    rest: str
    rest_drift: Estimate
    creep_time_s: Estimate | None
    amplitude_dependent: bool
    noise_std: float
    noise_coefficients: Array
    whiteness_p: float
    bic: float
    time_s: Array
    values: Array
    curve: Array
    rest_position: Array
    message: str


def fit_free_decay(
    time_s: ArrayLike,
    response: ArrayLike,
    *,
    drive: ArrayLike | None = None,
    free_from_s: float | None = None,
    rest: str = "auto",
    amplitude_dependent: bool | None = None,
) -> FreeDecay:
    """Return the maximum-likelihood fit of the free decay in a record.

    time_s, response, drive: shape (n,), drive and free_from_s as in `sinew.analysis.ring_down`, which finds the window.
    rest: position about which it swings, one of RESTS, or "auto": a line, with an exponential relaxation beside it
        where Bayes' criterion falls by more than 10. "creep" is that relaxation beside the line.
    amplitude_dependent: whether rate and frequency may change linearly with time; None lets the data decide likewise.

    Exact Gaussian likelihood with autoregressive noise of up to 8 coefficients. Intervals are Student's. For white
    noise the deviations are the Cramér-Rao bound's.
    Raises RecordingError where there is no free decay, ValueError for an unknown rest.
    """
    if rest not in (*RESTS, "auto"):
        raise ValueError(f"rest is {rest!r}; expected one of {', '.join(RESTS)} or auto")
    t, x, lever, clock = evenly(*checked_record(time_s, response, drive))
    first, _, _, peaks = free_decay(t, x, lever, free_from_s)
    t, x = block_means(t, x, peaks.half_period_s)
    stop = first.stop_s + (_TAIL - 1.0) * first.window_s
    inside = (t >= first.start_s - 1e-9) & (t <= stop + 1e-9)
    t, x = t[inside], x[inside]
    first = fit_decay(t, x, (first.decay_rate_per_s, first.omega_rad_s))
    model, fit = _best((t - t[0]) / (t[-1] - t[0]), x, first, rest, amplitude_dependent)
    return _described(model, fit, t, x, clock, peaks.noise)


def fit_oscillation(model: FreeOscillation, starts: list[Array], values: Array) -> LikelihoodFit:
    """Return the likeliest fit of a model to its samples, shape (n,), over the starts.

    starts: shape (model.width,) each, of which the rest position and the size of a relaxation are found here, by
    linear least squares.
    """
    fits = [fit_likelihood(model.values, model.jacobian, _with_rest(model, start, values), values) for start in starts]
    return min(fits, key=lambda fit: fit.bic)


def _with_rest(model: FreeOscillation, start: Array, values: Array) -> Array:
    p = np.array(start, dtype=float)
    linear = np.arange(model.rest_start, model.rest_start + model.rest.shape[1] + model.relaxing)
    p[linear] = 0.0
    p[linear] = np.linalg.lstsq(model.jacobian(p)[:, linear], values - model.values(p), rcond=None)[0]
    return p


@dataclass(frozen=True)
class _Candidate:
    """A model with its fit."""

    model: FreeOscillation
    fit: LikelihoodFit

    def beats(self, other: "_Candidate") -> bool:
        return self.fit.bic < other.fit.bic - _STRONG

    def gain(self, columns: Array) -> float:
        """Return by how much n ln(residual²) could fall in one linear step along added columns, shape (n, k)."""
        residual = self.fit.residual
        basis = orthonormal(self.model.jacobian(self.fit.parameters))
        beside = orthonormal(columns - basis @ (basis.T @ columns))
        power = float(residual @ residual)
        left = power - float(np.sum((beside.T @ residual) ** 2))
        return self.model.s.size * math.log(power / left) if left > 0 else math.inf


def _best(s: Array, x: Array, first: DecayFit, rest: str, bends: bool | None) -> tuple[FreeOscillation, LikelihoodFit]:
    """Return the model that was asked for, or the plainest one that the data do not reject.

    A bend and a creep are fitted only where one linear step along them promises enough: it saves most of the fits.
    """
    columns = polynomials(s, 1 if rest == "constant" else 2)
    plain = FreeOscillation(s, (polynomials(s, 2),), columns)
    best = _Candidate(
        plain, fit_oscillation(plain, [np.append(first_coefficients(first), np.zeros(columns.shape[1]))], x)
    )
    if rest == "creep":
        best = _crept(best, x, max(_CREEP_SCAN, key=lambda time: best.gain(_fading(s, time))))
    for _ in range(2):  # each choice may change the other
        if bends or (bends is None and best.model.bases[0].shape[1] == 2 and best.gain(_bend(best)) > _STRONG):
            bent = _bent(best, x)
            best = bent if bends or bent.beats(best) else best
            bends = None if bends is None else False
        if rest == "auto" and not best.model.relaxing:
            gains = {time: best.gain(_fading(s, time)) for time in _CREEP_SCAN}
            time = max(gains, key=lambda key: gains[key])
            crept = _crept(best, x, time) if gains[time] > _STRONG else best
            telling = crept.model.relaxing and _CREEP_RANGE[0] < math.exp(crept.fit.parameters[-1]) < _CREEP_RANGE[1]
            best = crept if telling and crept.beats(best) else best
    return best.model, best.fit


def _fading(s: Array, time: float) -> Array:
    return np.exp(-s / time)[:, None]


def _bend(candidate: _Candidate) -> Array:
    wave = candidate.model.s**2 * np.exp(candidate.model.exponent(candidate.fit.parameters))
    return np.stack([wave.real, wave.imag], axis=1)


def _bent(candidate: _Candidate, x: Array) -> _Candidate:
    model, p = candidate.model, candidate.fit.parameters
    wider = FreeOscillation(model.s, (polynomials(model.s, 3),), model.rest, model.relaxing)
    return _Candidate(wider, fit_oscillation(wider, [np.concatenate([p[:4], np.zeros(2), p[4:]])], x))


def _crept(candidate: _Candidate, x: Array, time: float) -> _Candidate:
    model, p = candidate.model, candidate.fit.parameters
    wider = FreeOscillation(model.s, model.bases, model.rest, relaxing=True)
    return _Candidate(wider, fit_oscillation(wider, [np.append(p, [0.0, math.log(time)])], x))


def first_coefficients(fit: DecayFit) -> Array:
    """Return Re c_0, Im c_0, Re c_1, Im c_1 of `FreeOscillation` from a least-squares fit of the same window."""
    size = max(fit.amplitude, 1e-300)
    angle = math.atan2(-float(fit.parameters[3]), float(fit.parameters[2]))
    return np.array([math.log(size), angle, -fit.parameters[0], fit.parameters[1]])


def _poles(model: FreeOscillation, p: Array) -> Array:
    """Return (λ, ω) per window, means weighted by the amplitude."""
    c, count = p[model.mode(0)], int(model.bases[0].shape[1])
    s = np.linspace(0.0, 1.0, _STEPS + 1)
    weight = np.exp(np.minimum(polynomials(s, count) @ c[0::2], 50.0))
    weight[[0, -1]] *= 0.5
    slopes = polynomials(s, count - 1) * np.arange(1, count)
    return np.asarray(weight @ np.stack([-(slopes @ c[2::2]), slopes @ c[3::2]], axis=1) / weight.sum())


def _drift(model: FreeOscillation, p: Array) -> Array:
    rest = model.rest_position(p)
    return np.array([rest[-1] - rest[0]])


def _propagated(function: Callable[[Array], Array], fit: LikelihoodFit) -> tuple[Array, Array]:
    """Return a function of the parameters, (k,), and its covariance, (k, k), by central differences."""
    p = fit.parameters
    steps = 0.01 * np.sqrt(np.maximum(np.diag(fit.covariance), 0.0)) + 1e-9 * np.maximum(np.abs(p), 1.0)
    slopes = [
        (function(p + row) - function(p - row)) / (2.0 * step) for row, step in zip(np.diag(steps), steps, strict=True)
    ]
    gradient = np.stack(slopes, axis=1)
    return function(p), np.asarray(gradient @ fit.covariance @ gradient.T, dtype=float)


def pole_estimates(poles: Array, covariance: Array, freedom: float, clock_std: float = 0.0) -> dict[str, Estimate]:
    """Return frequency_hz, natural_frequency_hz, damping_ratio and decay_rate_per_s from (λ, ω) and their covariance.

    poles: [1/s], shape (2,); covariance: shape (2, 2). clock_std: relative, of the time scale, which D does not feel.
    """
    rate, omega = float(poles[0]), float(poles[1])
    covariance = covariance + clock_std**2 * np.outer(poles, poles)
    natural = math.hypot(rate, omega)

    def estimate(value: float, by_rate: float, by_omega: float) -> Estimate:
        gradient = np.array([by_rate, by_omega])
        return Estimate.student(value, math.sqrt(max(float(gradient @ covariance @ gradient), 0.0)), freedom)

    return {
        "frequency_hz": estimate(omega / _TURN, 0.0, 1.0 / _TURN),
        "natural_frequency_hz": estimate(natural / _TURN, rate / natural / _TURN, omega / natural / _TURN),
        "damping_ratio": estimate(rate / natural, omega**2 / natural**3, -rate * omega / natural**3),
        "decay_rate_per_s": estimate(rate, 1.0, 0.0),
    }


def _described(
    model: FreeOscillation, fit: LikelihoodFit, t: Array, x: Array, clock: float, scatter: float
) -> FreeDecay:
    window, p, freedom = float(t[-1] - t[0]), fit.parameters, fit.degrees_of_freedom
    poles, covariance = _propagated(lambda q: _poles(model, q) / window, fit)
    drift, drift_variance = _propagated(lambda q: _drift(model, q), fit)
    std = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    size, bent = math.exp(p[0]), model.bases[0].shape[1] > 2
    creep = None
    if model.relaxing:
        log = Estimate.student(float(p[-1]), float(std[-1]), freedom)
        time = window * math.exp(log.value)
        creep = Estimate(time, time * log.std, window * math.exp(log.low), window * math.exp(min(log.high, 50.0)))
    return FreeDecay(
        **pole_estimates(poles, covariance, freedom, clock),
        amplitude=Estimate.student(size, size * float(std[0]), freedom),
        rest="creep" if model.relaxing else RESTS[model.rest.shape[1] - 1],
        rest_drift=Estimate.student(float(drift[0]), math.sqrt(max(float(drift_variance[0, 0]), 0.0)), freedom),
        creep_time_s=creep,
        amplitude_dependent=bent,
        noise_std=fit.noise_std,
        noise_coefficients=fit.noise,
        whiteness_p=fit.whiteness(),
        bic=fit.bic,
        time_s=t,
        values=x,
        curve=x - fit.residual,
        rest_position=model.rest_position(p),
        message=_warning(fit, bent, scatter),
    )


def _warning(fit: LikelihoodFit, bent: bool, scatter: float) -> str:
    said = []
    if not fit.converged:
        said.append("fit and noise did not settle; take the numbers as a start")
    if bent:
        said.append("rate and frequency change as the amplitude falls: these are means, the backbone says more")
    if fit.noise_std > _FAR * scatter:
        said.append(
            f"what the fit leaves is {fit.noise_std / scatter:.0f} times the scatter of neighbouring samples: the "
            "model misses a part of the record, as another mode or another creep"
        )
    return "; ".join(said)
