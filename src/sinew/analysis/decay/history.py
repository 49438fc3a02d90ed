"""Course of a decay: size and phase as smooth functions of time, beside whatever else swings in the record."""

import math
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache

import numpy as np

from sinew.analysis.decay.decay_fit import (
    DecayFit,
    FreeOscillation,
    polynomials,
    smooth_functions,
    smooth_slopes,
    with_rest,
)
from sinew.analysis.decay.free_decay import block_means
from sinew.analysis.decay.modes import Poles, split_poles
from sinew.analysis.signal.least_squares import (
    Factors,
    covariance_by,
    factorised,
    independent,
    least_squares,
    noise_spectrum,
    orthonormal,
    unit_columns,
)
from sinew.measure.arrays import Array, Complexes

_COUNTS = (3, 4, 5, 6, 8, 11, 15)  # functions of time that size and phase may take
_CYCLES_EACH = 1.5  # half cycles of the record that one more of them needs
_BETTER = 4.0  # fall of n ln(residual²) beyond twice the added parameters that lets them in,
_PLAIN_GAIN = 10.0  # times what is asked, if every sample were independent: then a step is taken at its word
_MODE_BETTER = 20.0  # and a further mode
_PROMISED = 0.8  # of the fall that lets functions in: a fit of which one linear step promises less is not made
_RESOLVED = 1.0  # sums of their decay rates between two modes that are told apart
_NEAR = 0.25  # relative distance of modes whose beat a smooth course might imitate
_MULTIPLES = (2, 3, 4, 5)  # of the first mode's frequency that its own waveform holds,
_HARMONIC = 0.04  # within this relative distance
_SURE = 4.0  # amplitude of a further mode by its standard deviation,
_SMALLEST = 0.02  # and by the first one's,
_OF_SMALLEST = 0.2  # of which the residual holds so much at least
_MOST_MODES = 4
_PENCIL_SAMPLES = 6000
_SPARSER = 2.0  # times fewer samples than a fit's show the poles of two modes near one another
_OUTSTANDING = 20.0  # power of a residual's line over the median
_GRID = 401  # odd, for Simpson's rule
_SEEDS = 100
_GROWS = 3.0  # standard deviations by which the residual's square grows with the amplitude's
_LOUDER, _FEWEST_LINES = 2.5, 4.0
_LARGEST = 50.0


@dataclass(frozen=True)
class AmplitudeHistory:
    """A fit of Σ Re[exp(S_m)] (the first with its harmonics) and a rest position to the samples of one decay.

    model: see `FreeOscillation`; time is counted in units of the window from start_s to stop_s.
    parameters: shape (m,); the samples were divided by scale. jacobian: shape (n, m), at the parameters, of the samples
    as divided. residual: shape (n,), unit of the data.
    """

    model: FreeOscillation
    start_s: float
    stop_s: float
    scale: float
    parameters: Array
    jacobian: Array
    residual: Array

    @property
    def functions(self) -> int:
        """Return how many functions of time describe the first mode's size and phase; two are an exponential."""
        return int(self.model.bases[0].shape[1])

    @property
    def left_over(self) -> float:
        """Return the sum of squares of the residual."""
        return float(self.residual @ self.residual)

    @cached_property
    def spectrum(self) -> Array:
        """Return the power spectrum of the noise, see `noise_spectrum`, of the samples divided by scale."""
        return noise_spectrum(self.residual / self.scale, orthonormal(unit_columns(self.jacobian)[0]))

    @cached_property
    def effective(self) -> float:
        """Return how many independent samples the residual is worth."""
        return self.degrees_of_freedom + self.parameters.size

    @cached_property
    def degrees_of_freedom(self) -> float:
        """Return those of the noise's scale."""
        return max(independent(self.spectrum, self.residual.size) - self.parameters.size, 1.0)

    @cached_property
    def _factors(self) -> Factors:
        return factorised(self.jacobian)

    @cached_property
    def covariance(self) -> Array:
        """Return that of the parameters, shape (m, m), for coloured noise."""
        return covariance_by(self._factors, self.spectrum)

    @cached_property
    def grown(self) -> Array:
        """Return the same where the noise grows with the amplitude as the residual does, else the covariance."""
        residual, size = self.residual / self.scale, np.abs(np.exp(self.model.exponent(self.parameters)))
        loudness = growing_noise(residual, size, self.effective)
        return self.covariance if loudness is None else covariance_by(self._factors, self.spectrum, loudness)

    def at(self, time_s: Array, mode: int = 0) -> Complexes:
        """Return S of a mode at times, shape (n,)."""
        position = self.model.mode(mode)
        c = self.parameters[position]
        functions = smooth_functions((time_s - self.start_s) / (self.stop_s - self.start_s), c.size // 2)
        return np.asarray(functions @ (c[0::2] + 1j * c[1::2]), dtype=complex)

    def energy(self, mode: int) -> float:
        """Return the energy of a mode over the window, in units of the data squared times time over two."""
        return float(np.mean(np.abs(np.exp(self.model.exponent(self.parameters, mode))) ** 2)) * self.scale**2

    def poles(self, low: float = 0.0, high: float = 1.0, mode: int = 0) -> tuple[Array, Array]:
        """Return ((λ, ω) [1/s], their gradient by the parameters (2, m)), as means between two times in windows.

        Means weighted by the amplitude A, half the swing from crest to crest, its own third harmonic included:
        ⟨λ⟩ = -∫ dA / ∫ A dt, ⟨ω⟩ = ∫ ω A dt / ∫ A dt. Of an exponential they are its rate and frequency.
        """
        position, window = self.model.mode(mode), self.stop_s - self.start_s
        c = self.parameters[position]
        functions, slopes = _between(low, high, c.size // 2)
        size = np.exp(np.minimum(functions @ c[0::2], _LARGEST))
        third = self.model.overtones(self.parameters)[1].real if self.model.harmonics and mode == 0 else 0.0
        half_swing, by_log = size * (1.0 + third * size**2), size * (1.0 + 3.0 * third * size**2)
        omega = slopes @ c[1::2]
        weight = np.full(_GRID, 2.0 / 3.0 * (high - low) / (_GRID - 1))
        weight[1::2] *= 2.0
        weight[[0, -1]] *= 0.5
        area = float(weight @ half_swing)
        means = np.array([float(half_swing[0] - half_swing[-1]), float(weight @ (half_swing * omega))]) / area
        gradient = np.zeros((2, self.parameters.size))
        ends = by_log[0] * functions[0] - by_log[-1] * functions[-1]
        real, imaginary = gradient[:, position][:, 0::2], gradient[:, position][:, 1::2]
        real[0] = (ends - means[0] * ((weight * by_log) @ functions)) / area
        real[1] = ((weight * by_log * (omega - means[1])) @ functions) / area
        imaginary[1] = ((weight * half_swing) @ slopes) / area
        if self.model.harmonics and mode == 0:
            cube, first = size**3, self.model.rest_start - 5
            gradient[0, first + 2] = (cube[0] - cube[-1] - means[0] * float(weight @ cube)) / area
            gradient[1, first + 2] = float((weight * cube) @ (omega - means[1])) / area
        return means / window, gradient / window


@lru_cache(maxsize=32)
def _between(low: float, high: float, count: int) -> tuple[Array, Array]:
    """Return `count` smooth functions and their slopes on an even grid between two times, shape (_GRID, count) each."""
    grid = np.linspace(low, high, _GRID)
    return smooth_functions(grid, count), smooth_slopes(grid, count)


@lru_cache(maxsize=32)
def _evenly(count: int) -> Array:
    """Return `count` smooth functions at even steps of time, shape (steps, count), to carry a course to others."""
    return smooth_functions(np.linspace(0.0, 1.0, _SEEDS), count)


def exponential_history(t: Array, x: Array, fit: DecayFit, further: Poles | None = None) -> AmplitudeHistory:
    """Return the course of one exponential, started from a plain or bent fit, with further modes beside it.

    t, x: shape (n,), samples of the window. further: (pole [1/s], amplitude at its begin) each.
    """
    rate, _ = fit.mean_rate_per_s()
    bend = fit.bend_per_s2
    omega = fit.omega_rad_s + (bend[1] * fit.window_s if bend else 0.0)
    amplitude = complex(fit.parameters[2], -fit.parameters[3])
    return _of_modes(t, x, [(complex(-rate, omega), amplitude), *(further or [])], fit.relaxing)


def _of_modes(t: Array, x: Array, poles: Poles, relaxing: bool) -> AmplitudeHistory:
    window = float(t[-1] - t[0])
    s = (t - t[0]) / window
    model = FreeOscillation(s, (polynomials(s, 2),) * len(poles), polynomials(s, 2), relaxing)
    scale = float(np.std(x)) or 1.0
    start = np.zeros(model.width)
    for m, (pole, amplitude) in enumerate(poles):
        c = math.log(max(abs(amplitude) / scale, 1e-12)), np.angle(amplitude), pole.real * window, pole.imag * window
        start[model.mode(m)] = c
    if relaxing:
        start[-1] = math.log(0.3)
    return _solved(model, t, x, scale, with_rest(model, start, x / scale))


def _solved(model: FreeOscillation, t: Array, x: Array, scale: float, start: Array) -> AmplitudeHistory:
    """Return the least-squares fit from a start."""
    found = least_squares(model.linearise, x / scale, start)
    return AmplitudeHistory(
        model, float(t[0]), float(t[-1]), scale, found.parameters, found.jacobian, -found.deviation * scale
    )


def _nearest(model: FreeOscillation, y: Array, starts: list[Array]) -> Array:
    """Return the start that leaves least, its rest position fitted."""
    placed = [with_rest(model, start, y) for start in starts]
    return min(placed, key=lambda p: float(np.sum((model.values(p) - y) ** 2)))


def _bettered(
    plain: AmplitudeHistory, model: FreeOscillation, t: Array, x: Array, start: Array
) -> AmplitudeHistory | None:
    """Return the fit of a richer model from a start where it is clearly better than a course of the same samples, else
    None.

    Where one linear step from the start promises much less than the gain that takes, it is not made.
    """
    y = x / plain.scale
    values, slope = model.linearise(start)
    basis = orthonormal(unit_columns(slope())[0])
    left = (y - values) - basis @ (basis.T @ (y - values))
    gain = math.log(max(plain.left_over, 1e-300) / max(float(left @ left) * plain.scale**2, 1e-300))
    enough = _PROMISED * (_BETTER + 2.0 * (model.width - plain.parameters.size))
    if y.size * gain < enough:
        return None
    if y.size * gain < _PLAIN_GAIN * enough and independent(noise_spectrum(left, basis), y.size) * gain < enough:
        return None
    rich = _solved(model, t, x, plain.scale, start)
    return rich if clearly_better(plain, rich, _BETTER) else None


def growing_noise(residual: Array, amplitude: Array, effective: float) -> Array | None:
    """Return the size of the noise at each sample over its root mean square, or None where it does not grow.

    residual, amplitude: shape (n,); effective: how many independent samples they are worth. The square of the residual
    is fitted by c + g A²; g must stand out by three standard deviations.
    """
    square, power = residual**2, amplitude**2
    mean = float(square.mean())
    if mean <= 0 or not np.ptp(power) > 0:
        return None
    centred = power - power.mean()
    growth = float(centred @ square) / float(centred @ centred)
    spread = float(np.std(square - mean - growth * centred)) / math.sqrt(float(centred @ centred))
    if growth < _GROWS * spread * math.sqrt(max(residual.size / effective, 1.0)):
        return None
    fitted = np.maximum(mean + growth * centred, 0.05 * mean)
    return np.asarray(np.sqrt(fitted / fitted.mean()), dtype=float)


def louder_line(history: AmplitudeHistory, omega: float) -> float:
    """Return how many times more power the residual has around a frequency [rad/s] than its noise explains, 1 or more.

    The noise is a short autoregression, which sees no narrow line; the band is from 0.5 to 2 of the frequency. What is
    within two and a half standard deviations of an average over so many lines is noise.
    """
    residual, n, spectrum = history.residual / history.scale, history.residual.size, history.spectrum
    power = np.abs(np.fft.rfft(residual, 2 * (spectrum.size - 1))) ** 2 / n
    cycles = np.arange(spectrum.size) * (n - 1) / (spectrum.size - 1) / 2.0  # in the window
    middle = omega * (history.stop_s - history.start_s) / (2.0 * math.pi)
    band = (cycles > 0.5 * middle) & (cycles < 2.0 * middle)
    lines = 1.5 * middle - 2.0 * history.functions
    expected = float(spectrum[band].mean()) if band.any() else 0.0
    if lines < _FEWEST_LINES or expected <= 0:
        return 1.0
    ratio = float(power[band].mean()) / expected * 1.5 * middle / lines
    return ratio if ratio > 1.0 + _LOUDER / math.sqrt(lines) else 1.0


def smooth_history(
    t: Array, x: Array, fit: DecayFit, peak_time_s: Array, height: Array, functions: int | None = None
) -> AmplitudeHistory:
    """Return the course whose size and phase change as the samples ask for.

    t, x: shape (n,); fit: a plain or bent fit to them, to start from; peak_time_s, height: shape (h,), alternating
    peaks about the rest position, to start from as well. functions: 3 for a rate and a frequency that change linearly,
    None for as many as the samples ask for.

    Logarithm of size and phase are three to fifteen functions of time, one for one and a half half cycles at most:
    powers up to four, then cubic splines. More of them, and a second and third harmonic, are taken where Akaike's
    criterion falls by more than four, in samples as independent as the richer fit's residual has them.
    """
    window, scale = float(t[-1] - t[0]), float(np.std(x)) or 1.0
    s, places = (t - t[0]) / window, (peak_time_s - t[0]) / window
    log, phase = np.log(np.abs(height) / scale), np.arange(height.size) * math.pi + (0.0 if height[0] > 0 else math.pi)
    most = max(3.0, 1.0 + height.size / _CYCLES_EACH) if functions is None else float(functions)

    basis = cache(lambda count: smooth_functions(s, count))

    def modelled(count: int, harmonics: bool) -> FreeOscillation:
        return FreeOscillation(s, (basis(count),), polynomials(s, 2), fit.relaxing, harmonics)

    def grown(before: AmplitudeHistory, count: int, harmonics: bool) -> AmplitudeHistory | None:
        model = modelled(count, harmonics)
        start = _started(model, _evenly(count), _seed_of(before))
        retained = before.model.rest_start - 5 * (harmonics and before.model.harmonics)
        start[model.rest_start - before.model.rest_start + retained :] = before.parameters[retained:]
        return _bettered(before, model, t, x, start)

    model = modelled(3, False)
    by_peaks = _started(model, smooth_functions(places, 3), log + 1j * phase)
    start = _nearest(model, x / scale, [by_peaks, _started(model, _evenly(3), _seed_of_fit(fit, scale))])
    best = _solved(model, t, x, scale, start)
    waited = 0
    for count in _COUNTS[1:]:
        if count > most or 4 * (2 * count + 9) > t.size or waited > 1:
            break
        more = grown(best, count, best.model.harmonics)
        best, waited = (best, waited + 1) if more is None else (more, 0)
        if not best.model.harmonics and (count == _COUNTS[1] or not waited):
            waved = grown(best, best.functions, True)
            best, waited = (best, waited) if waved is None else (waved, 0)
    return best


def _seed_of(history: AmplitudeHistory) -> Complexes:
    c = history.parameters[history.model.mode(0)]
    return np.asarray(_evenly(c.size // 2) @ (c[0::2] + 1j * c[1::2]))


def _seed_of_fit(fit: DecayFit, scale: float) -> Complexes:
    s, p = np.linspace(0.0, 1.0, _SEEDS), fit.parameters
    exponent = np.log(complex(p[2], -p[3]) / scale) + (1j * p[1] - p[0]) * s
    if fit.bending:
        exponent = exponent + (1j * p[-1] - p[-2]) * s**2
    return np.asarray(exponent)


def _started(model: FreeOscillation, functions: Array, exponent: Complexes) -> Array:
    """Return a start whose first mode goes through exponents, shape (k,), where its functions are known, (k, count)."""
    weight = np.exp(np.clip(exponent.real, -_LARGEST, _LARGEST))
    sides = np.stack([exponent.real, exponent.imag], axis=1) * weight[:, None]
    start = np.zeros(model.width)
    start[model.mode(0)] = np.linalg.lstsq(functions * weight[:, None], sides, rcond=1e-8)[0].ravel()
    if model.relaxing:
        start[-1] = math.log(0.3)
    return start


def clearly_better(plain: AmplitudeHistory, rich: AmplitudeHistory, by: float) -> bool:
    """Return whether Akaike's criterion falls by so much from one fit to a richer one of the same samples."""
    if not rich.left_over > 0 or not np.isfinite(rich.parameters).all():
        return False
    ratio = math.log(max(plain.left_over, 1e-300) / rich.left_over)
    price = by + 2.0 * (rich.parameters.size - plain.parameters.size)
    # Samples are worth no more than their number, and one more than the parameters at least, see `degrees_of_freedom`:
    # most courses are told apart by these before their noise need be known.
    if rich.residual.size * max(ratio, 0.0) <= price:
        return False
    enough = (rich.parameters.size + 1.0) * max(ratio, 0.0) > max(price, 0.0)
    return enough or rich.effective * ratio > price


def close_modes(t: Array, x: Array, single: AmplitudeHistory) -> AmplitudeHistory | None:
    """Return two modes near one another where they explain the samples better than one whose course is smooth.

    t, x: shape (n,), even or nearly; single: of the same samples. They must be further apart than their decay rates
    add up to, and beat once at least in the window: closer ones cannot be told from a bent course.
    """
    window = float(t[-1] - t[0])
    best: AmplitudeHistory | None = None
    even = np.linspace(t[0], t[-1], t.size)
    half = math.pi / max(float(single.poles()[0][1]), 1e-300)
    at, values = block_means(even, np.interp(even, t, x), _SPARSER * half)
    for poles in split_poles(values[:_PENCIL_SAMPLES] - values.mean(), float(at[1] - at[0]), (4, 6, 8)):
        pair = poles[:2]
        if len(pair) < 2 or not _are_apart(pair[0][0], pair[1][0], window):
            continue
        if abs(math.log(pair[0][0].imag / pair[1][0].imag)) > _NEAR or not all(_swings(p, window) for p, _ in pair):
            continue
        two = _of_modes(t, x, [(p, a * np.exp(p * (t[0] - at[0]))) for p, a in pair], single.model.relaxing)
        if (best is None or two.left_over < best.left_over) and _are_sure(two):
            best = two
    return best if best is not None and clearly_better(single, best, _MODE_BETTER) else None


def with_further_modes(t: Array, x: Array, history: AmplitudeHistory) -> AmplitudeHistory:
    """Return the course with the further modes that its residual holds, one at a time.

    A further mode is far from the others and their multiples, decays, and lowers Akaike's criterion by twenty.
    """
    while len(history.model.bases) < _MOST_MODES:
        grown = _with_one_more(t, x, history)
        if grown is None:
            break
        history = grown
    return history


def _with_one_more(t: Array, x: Array, history: AmplitudeHistory) -> AmplitudeHistory | None:
    window, n, largest = float(t[-1] - t[0]), t.size, math.sqrt(history.energy(0))
    if n < 3 * (history.parameters.size + 4) or float(np.std(history.residual)) < _OF_SMALLEST * _SMALLEST * largest:
        return None
    left = _without_overtones(history)
    if float(np.std(left)) < _OF_SMALLEST * _SMALLEST * largest:
        return None
    residual = np.interp(np.linspace(t[0], t[-1], n), t, left)[:_PENCIL_SAMPLES]
    power = np.abs(np.fft.rfft(residual)) ** 2
    if not power.max() > _OUTSTANDING * float(np.median(power)):
        return None
    known = [history.poles(mode=m)[0] for m in range(len(history.model.bases))]
    tried: list[complex] = []
    for poles in split_poles(residual, window / (n - 1), (2, 4, 6)):
        for pole, amplitude in poles[:2]:
            new = all(_is_new(pole, other, window, history.functions > 2) for other in known)
            if not (new and _swings(pole, window) and all(_are_apart(pole, other, window) for other in tried)):
                continue
            added = _extended(history, t, x, pole, amplitude)
            last = len(added.model.bases) - 1
            rate, omega = added.poles(mode=last)[0]
            found = complex(-rate, omega)
            tried += [pole, found] if _swings(found, window) else [pole]
            if not all(_is_new(found, other, window, history.functions > 2) for other in known):
                continue
            large = math.sqrt(max(added.energy(last), 0.0)) > _SMALLEST * largest
            if large and clearly_better(history, added, _MODE_BETTER) and _are_sure(added):
                return added
    return None


def _without_overtones(history: AmplitudeHistory) -> Array:
    """Return what of the residual, shape (n,), is no multiple of the first mode's phase that shrinks as it does."""
    exponent = history.model.exponent(history.parameters)
    waves = [np.exp(exponent.real + 1j * multiple * exponent.imag) for multiple in _MULTIPLES]
    columns = np.stack([part for wave in waves for part in (wave.real, wave.imag)], axis=1)
    basis = orthonormal(unit_columns(np.concatenate([history.jacobian, columns], axis=1))[0])
    return np.asarray(history.residual - basis @ (basis.T @ history.residual))


def _extended(history: AmplitudeHistory, t: Array, x: Array, pole: complex, amplitude: complex) -> AmplitudeHistory:
    window, old = history.stop_s - history.start_s, history.model
    s = (t - t[0]) / window
    model = replace(old, s=s, bases=(*old.bases, polynomials(s, 2)))
    here = old.mode(len(old.bases) - 1).stop
    c = np.array(
        [
            math.log(max(abs(amplitude) / history.scale, 1e-12)),
            float(np.angle(amplitude)),
            pole.real * window,
            pole.imag * window,
        ]
    )
    start = np.concatenate([history.parameters[:here], c, history.parameters[here:]])
    return _solved(model, t, x, history.scale, with_rest(model, start, x / history.scale))


def _swings(pole: complex, window: float) -> bool:
    return pole.real < 0 and pole.imag * window > 3.0 * math.pi and pole.imag > -pole.real


def _are_apart(one: complex, other: complex, window: float) -> bool:
    distance = abs(one.imag - other.imag)
    return distance > _RESOLVED * -(one.real + other.real) and distance * window > 2.0 * math.pi


def _is_new(pole: complex, other: Array, window: float, smooth: bool) -> bool:
    rate, omega = (float(one) for one in other)
    if not (pole.imag > 0 and omega > 0):
        return False
    near = smooth and abs(math.log(pole.imag / omega)) < _NEAR  # what is left of a course may be its own
    own = any(abs(pole.imag / (multiple * omega) - 1.0) < _HARMONIC for multiple in _MULTIPLES)
    return not near and not own and _are_apart(pole, complex(-rate, omega), window)


def _are_sure(history: AmplitudeHistory) -> bool:
    """Return whether every mode but the first decays, swings, and has an amplitude that stands out of its deviation."""
    model, p = history.model, history.parameters
    for m in range(len(model.bases)):
        position = model.mode(m)
        log_std = math.sqrt(max(float(history.covariance[position.start, position.start]), 0.0))
        if m and not (log_std < 1.0 / _SURE and p[position.start + 2] < 0 and p[position.start + 3] > 2.0 * math.pi):
            return False
    return True


def differing_halves(history: AmplitudeHistory, middle_s: float, end_s: float) -> tuple[Array, Array]:
    """Return (late less early means of (λ, ω), their standard deviations), shape (2,) each.

    middle_s: where the early half of the decay ends [s]; end_s: where its late half does.
    """
    window = history.stop_s - history.start_s
    middle, end = ((time - history.start_s) / window for time in (middle_s, end_s))
    early, by_early = history.poles(0.0, middle)
    late, by_late = history.poles(middle, min(end, 1.0))
    gradient = by_late - by_early
    variance = np.einsum("ij,jk,ik->i", gradient, history.grown, gradient)
    return late - early, np.sqrt(np.maximum(variance, 0.0))
