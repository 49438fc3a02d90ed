"""This is where a fitted response gives its resonance, and how that moves with amplitude, with intervals."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sinew.identify.grid import Scales, input_derivative
from sinew.identify.record import derivative_order
from sinew.identify.response_branch import Drive, free_frequency, lagging, top_of_sweep
from sinew.identify.response_fitted import ResponseFit
from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate

__all__ = ["ResponseBackbone", "ResponsePeak", "backbone_of_response", "peak_of_response"]

Array = NDArray[np.float64]

_REACH, _LAGS, _DEGREE = 0.25, 11, 5  # of the lag around the top [rad], points there, polynomial through them
_FINE = 2001
_BEYOND = 0.05  # of the swept range: how far outside it a peak is sought
_UNKNOWN = Estimate(np.nan, np.nan, np.nan, np.nan)


@dataclass(frozen=True)
class ResponsePeak:
    """Where the fitted response is largest, at one drive amplitude.

    input_amplitude: in the unit of the input. frequency_hz, gain: of the largest |output/input| of the joint itself,
    without turn and background of the measuring chain, gain in output unit per input unit. amplitude: of the output
    there. phase_90_hz: where the motion lags by 90°. reason: one sentence where there is no peak, else empty.
    """

    input_amplitude: float
    frequency_hz: Estimate
    gain: Estimate
    amplitude: Estimate
    phase_90_hz: Estimate
    reason: str = ""


@dataclass(frozen=True)
class ResponseBackbone:
    """Frequency of the free, lossless swing against amplitude, shape (a,) each: the curve on which 90° lags lie.

    amplitude: of the fundamental of the motion. frequency_low_hz, frequency_high_hz: the pointwise 90 % band.
    measured_to: largest amplitude of a fitted point; beyond it the curve is the model's alone.
    """

    amplitude: Array
    frequency_hz: Array
    frequency_std_hz: Array
    frequency_low_hz: Array
    frequency_high_hz: Array
    measured_to: float


@dataclass(frozen=True)
class _Spread:
    """Numbers of one group at the fit and one standard deviation to both sides along the columns of the covariance."""

    numbers: Array
    freedom: float

    def estimate(self, values: Array) -> Estimate:
        """Return the estimate of what was read in each lane, shape (2k + 1,), to first order."""
        count = (values.size - 1) // 2
        share = 0.5 * (values[1 : count + 1] - values[count + 1 :])
        if not np.isfinite(values).all():
            return Estimate(float(values[0]), np.nan, np.nan, np.nan)
        return Estimate.student(float(values[0]), float(np.sqrt(share @ share)), self.freedom)


def _spread(fit: ResponseFit, part: int) -> _Spread:
    count = fit.layout.mechanics
    matrix = fit.covariance.matrix[:count, :count]
    if not np.isfinite(matrix).all():
        raise SpecError("a number of this fit is not determined at all; its peak has no interval, fit a smaller model")
    size, turned = np.linalg.eigh(0.5 * (matrix + matrix.T))
    root = (turned * np.sqrt(np.maximum(size, 0.0))).T
    x = fit.solution.values[:count]
    lanes = np.concatenate([x[None], x + root, x - root])
    rest = fit.solution.values[count:]
    numbers = np.stack([fit.layout.numbers(np.concatenate([lane, rest]), part) for lane in lanes])
    return _Spread(numbers, fit.covariance.degrees_of_freedom)


def peak_of_response(fit: ResponseFit, input_amplitude: float | None = None, *, part: int = 0) -> ResponsePeak:
    """Return resonance frequency and gain of a fitted response to a drive of one amplitude at all frequencies.

    input_amplitude: in the unit of the input; None for the median of the group's points; a linear joint does not feel
    it. part: index of the group. The peak is sought within the swept range and a twentieth of it beyond; the response
    is read along its lag, against which even a folded peak is single. Standard deviations to first order (delta method)
    from the fit's covariance.
    """
    points, scales = fit.points[part], fit.layout.layout.parts[part].scales
    amplitude = float(np.median(points.input_amplitude)) if input_amplitude is None else float(input_amplitude)
    spread, laws = _spread(fit, part), fit.layout.laws(part)
    power = input_derivative(points.signals)
    sign = -1.0 if points.excitation in ("base", "lever") else 1.0
    drive = Drive(sign * amplitude * scales.omega**power / scales.forcing, power)
    hertz = scales.omega / (2 * np.pi)
    margin = _BEYOND * float(np.ptp(points.frequency_hz))
    low = max(float(points.frequency_hz[0]) - margin, 0.02 * hertz)
    high = float(points.frequency_hz[-1]) + margin
    first, harmonics, inside = top_of_sweep(spread.numbers[0], laws, drive, low / hertz, high / hertz)
    if not inside:
        return _none(amplitude, "the response is largest at the edge of the sweep; extend the sweep beyond it")
    push = drive.push(np.array([first]))[0]
    lag = float(-np.angle((harmonics[1] + 1j * harmonics[2]) / push)) % (2 * np.pi)
    lags = np.r_[lag + np.linspace(-_REACH, _REACH, _LAGS), 0.5 * np.pi]
    lanes = spread.numbers.shape[0]
    numbers = np.repeat(spread.numbers, lags.size, axis=0)
    omega, motion, found = lagging(numbers, np.tile(lags, lanes), laws, drive, first, harmonics)
    gain = np.abs(_output(fit, scales, numbers, omega, motion, amplitude)) / amplitude
    shape = (lanes, lags.size)
    omega, gain, found = omega.reshape(shape), gain.reshape(shape), found.reshape(shape)
    if not found[:, :-1].all():
        return _none(amplitude, "the balance was not found around the top of the response")
    frequency, largest = _tops(lags[:-1] - lag, hertz * omega[:, :-1], gain[:, :-1])
    crossing = spread.estimate(hertz * omega[:, -1]) if found[:, -1].all() and fit.frame == "relative" else _UNKNOWN
    return ResponsePeak(
        amplitude, spread.estimate(frequency), spread.estimate(largest), spread.estimate(largest * amplitude), crossing
    )


def _none(amplitude: float, reason: str) -> ResponsePeak:
    return ResponsePeak(amplitude, _UNKNOWN, _UNKNOWN, _UNKNOWN, _UNKNOWN, reason)


def _output(
    fit: ResponseFit, scales: Scales, numbers: Array, omega: Array, motion: Array, amplitude: float
) -> NDArray[np.complex128]:
    """Return the output's fundamental, in its unit."""
    points = fit.points[0]
    moving = (motion[:, 1] + 1j * motion[:, 2]) * scales.amplitude
    turn = 1j * omega * scales.omega
    if fit.frame == "absolute":
        carried = turn ** (-derivative_order(points.input_unit)) * amplitude
        moving = moving + numbers[:, 6] * scales.physical("gain") * carried
    return np.asarray(moving * turn ** derivative_order(points.output_unit))


def _tops(lag: Array, frequency: Array, gain: Array) -> tuple[Array, Array]:
    """Return frequency and gain of the top of each lane, shape (l,), through polynomials of the lag."""
    s = lag / _REACH
    fine = np.linspace(-1.0, 1.0, _FINE)
    curves = np.polynomial.polynomial.polyfit(s, np.log(gain).T, _DEGREE)
    tops = np.argmax(np.polynomial.polynomial.polyval(fine, curves), axis=1)
    places = np.polynomial.polynomial.polyfit(s, frequency.T, _DEGREE)
    at, largest = np.empty(tops.size), np.empty(tops.size)
    for row, top in enumerate(tops):
        series = np.polynomial.Polynomial(curves[:, row])
        where = fine[top]
        for _ in range(3):
            bend = float(series.deriv(2)(where))
            where = float(np.clip(where - series.deriv()(where) / bend, -1.0, 1.0)) if bend < 0 else where
        at[row] = np.polynomial.Polynomial(places[:, row])(where)
        largest[row] = np.exp(series(where))
    return at, largest


def backbone_of_response(fit: ResponseFit, amplitude: ArrayLike | None = None, *, part: int = 0) -> ResponseBackbone:
    """Return the backbone of a fit with its 90 % band, by the delta method.

    amplitude: of the motion (unit of the output, or of what it is the rate of); None for 21 from none to the largest
    that was measured.
    """
    points, scales = fit.points[part], fit.layout.layout.parts[part].scales
    turn = 2 * np.pi * points.frequency_hz
    moving = np.abs(points.response) * points.input_amplitude / turn ** derivative_order(points.output_unit)
    largest = float(moving.max())
    sizes = (
        np.linspace(0.0, largest, 22)[1:] if amplitude is None else np.atleast_1d(np.asarray(amplitude, dtype=float))
    )
    spread, laws = _spread(fit, part), fit.layout.laws(part)
    lanes = spread.numbers.shape[0]
    numbers = np.repeat(spread.numbers, sizes.size, axis=0)
    hertz = scales.omega / (2 * np.pi)
    found = hertz * free_frequency(numbers, np.tile(sizes, lanes) / scales.amplitude, laws)
    curves = [spread.estimate(column) for column in found.reshape(lanes, sizes.size).T]
    value, std, low, high = (
        np.array([getattr(one, name) for one in curves]) for name in ("value", "std", "low", "high")
    )
    return ResponseBackbone(sizes, value, std, low, high, largest)
