"""The fit of a model to the points of a stepped sine: least squares in the frequency domain.

The model's steady oscillations at each point's own drive amplitude are balanced by `sinew.solve`
(`sinew.identify.oscillation`); residuals are weighted by the points' scatter. Where a joint has several steady
oscillations at one frequency, the measured one says which is meant.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from sinew.analysis.signal.least_squares import solve_scaled
from sinew.identify.oscillation import (
    Drive,
    Laws,
    fundamentals,
    lag_of,
    lagging,
    number_names,
    oscillate,
    swept,
    top_of_sweep,
)
from sinew.identify.oscillator.least_squares import (
    Covariance,
    Problem,
    Solution,
    estimates,
    find_unidentifiable,
    solve,
)
from sinew.identify.oscillator.model import (
    SIGNIFICANT,
    Fitted,
    Layout,
    Model,
    Part,
    get_model,
    make_layout,
    mechanical_parameters,
    oscillation,
    words_and_scales,
)
from sinew.identify.oscillator.record import Frame, Scales, derivative_order, frames_of, input_derivative, relaxation_of
from sinew.identify.oscillator.track import LOCAL, Grid
from sinew.identify.points import (
    ResponsePoints,
    ResponseTests,
    ask_points,
    sandwich,
    squeeze_scatter,
    whiten,
)
from sinew.measure.arrays import Array, Complexes, Mask
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import Estimate
from sinew.measure.result import Field, Result
from sinew.mechanics.laws import Cubic, LossFactor, Pendulum, Term
from sinew.mechanics.silicone import relaxation_times
from sinew.solve.programs import configure

# The points of one or several stepped sines, laid out for a search in normal form.

CHAIN = ("phase", "background_real", "background_imag")
"""What the measuring chain may add: a turn of the response [rad], and a response that does not depend on frequency, as
a share of the largest."""


def drive_of(points: ResponsePoints, scales: Scales, amplitude: float | Array) -> Drive:
    """Return what an input of given amplitudes, in its unit, drives in normal form."""
    power = input_derivative(points.signals)
    sign = -1.0 if points.excitation in ("base", "lever") else 1.0
    return Drive(sign * amplitude * scales.omega**power / scales.forcing, power)


@dataclass(frozen=True)
class Predicted:
    """The response of one group of points, shape (n,), its slopes by the vector x, shape (n, m), and at which points
    the balance was reached, shape (n,)."""

    response: Complexes
    slopes: Complexes
    found: Mask


@dataclass(frozen=True)
class ResponseLayout:
    """Which number of the search goes where.

    layout: entries, index, column and ratio as of a fit in time (`sinew.identify.oscillator.model`), for the
    mechanical numbers; those of the chain (`chain`, of `CHAIN`) follow them in x. size: of the largest response, in its
    unit.
    """

    layout: Layout
    points: tuple[ResponsePoints, ...]
    frame: Frame
    chain: tuple[str, ...]
    size: float

    @property
    def mechanics(self) -> int:
        """Return how many of the numbers are mechanical."""
        return len(self.layout.entries)

    @property
    def width(self) -> int:
        """Return how many numbers are sought."""
        return self.mechanics + len(self.chain)

    def laws(self, part: int) -> Laws:
        """Return the laws of one group."""
        model, grid = self.layout.model, self.layout.parts[part].grid
        natural = float(grid.relaxation[0] / relaxation_times()[0])
        return Laws(model.law, natural, float(grid.amplitude))

    def numbers(self, x: Array, part: int) -> Array:
        """Return the numbers of the law and the gain of one group, shape (l,)."""
        return self.layout.local(x[: self.mechanics], part)

    def added(self, x: Array) -> tuple[complex, complex]:
        """Return the turn and the background of the measuring chain."""
        held = dict(zip(self.chain, x[self.mechanics :], strict=True))
        turn = complex(np.exp(1j * held.get("phase", 0.0)))
        return turn, self.size * complex(held.get("background_real", 0.0), held.get("background_imag", 0.0))

    def predict(self, x: Array, part: int) -> Predicted:
        """Return the response of one group; of several oscillations at a frequency the one nearest to the measured."""
        points, layout = self.points[part], self.layout
        scales, order = layout.parts[part].scales, layout.parts[part].order
        numbers, (turn, background) = self.numbers(x, part), self.added(x)
        amplitude, fast = points.input_amplitude, 2j * np.pi * points.frequency_hz
        to_output = (fast / scales.omega) ** order * scales.amplitude * scales.omega**order / amplitude * turn
        carried = np.zeros(points.size, dtype=complex)
        if self.frame == "absolute":  # the base's own motion, in the normal form of the relative motion
            carried = fast ** (-derivative_order(points.input_unit)) * amplitude * scales.omega**2 / scales.forcing
        begin = (points.response - background) / to_output - numbers[-1] * carried
        omega = 2 * np.pi * points.frequency_hz / scales.omega
        steady = oscillate(numbers, omega, drive_of(points, scales, amplitude), self.laws(part), begin)
        bare = (steady.fundamental + numbers[-1] * carried) * to_output
        by_number = steady.slopes.copy()
        by_number[:, -1] += carried
        by_number = by_number * to_output[:, None]
        slopes = np.zeros((points.size, self.width), dtype=complex)
        slopes[:, layout.index[part]] = by_number[:, layout.column[part]] * layout.ratio[part]
        for k, name in enumerate(self.chain, start=self.mechanics):
            slopes[:, k] = {"phase": 1j * bare, "background_real": self.size, "background_imag": 1j * self.size}[name]
        return Predicted(np.asarray(bare + background), slopes, steady.found)


def make_response_layout(
    model: Model,
    points: Sequence[ResponsePoints],
    scales: Sequence[Scales],
    frame: Frame,
    chain: Sequence[str] = (),
) -> ResponseLayout:
    """Return the layout. chain: of `CHAIN`."""
    names, none = number_names(model.law), np.empty(0)
    parts = []
    for one, own in zip(points, scales, strict=True):
        fixed = np.zeros(len(names))
        if one.excitation == "base":
            fixed[-1] = 1.0 / own.physical("gain")
        grid = Grid(none, np.empty((0, 3)), none, none, relaxation_of(own.omega) * own.omega, np.asarray(own.amplitude))
        order = derivative_order(one.output_unit)
        unit_size = own.amplitude * own.omega**order
        parts.append(Part(one.signals, own, grid, none.astype(np.intp), none.astype(bool), order, unit_size, fixed))
    layout = make_layout(model, parts, names)
    size = max(float(np.abs(one.response).max()) for one in points)
    return ResponseLayout(layout, tuple(points), frame, tuple(chain), size)


# The search through a stepped sine begins: the balance of the fundamental is linear in its numbers.
#
# Of the motion y that was measured, [K - ω² + jωD + jc 4/(π|y|) + ¾κ₃|y|²] y = g a at every frequency. Weighted with
# the scatter of the points through that dynamic stiffness (Sanathanan and Koerner's iteration), one linear regression
# after the other tells K, D or the loss factor, c, κ₃, g, and a turn of the phase where one is sought.

_ROUNDS = 6
_PHASES = 256  # of a motion, at which a force is read whose fundamental has no closed form here
_SEEN = 1e-9  # of the force


def scales_of_points(points: ResponsePoints, values: dict[str, float], frame: Frame) -> Scales:
    """Return what makes the numbers of one group near one. values: of `regress_response`."""
    motion, push = motion_and_push(points, frame)
    return Scales(float(np.sqrt(values["stiffness"])), float(np.abs(motion).max()), float(np.abs(push).max()))


def motion_and_push(points: ResponsePoints, frame: Frame) -> tuple[Complexes, Complexes]:
    """Return motion relative to the base and drive a of the points, in SI units."""
    turn = 2j * np.pi * points.frequency_hz
    motion = points.response * points.input_amplitude / turn ** derivative_order(points.output_unit)
    if frame == "absolute":
        motion = motion - points.input_amplitude / turn ** derivative_order(points.input_unit)
    sign = -1.0 if points.excitation in ("base", "lever") else 1.0
    push = sign * turn ** input_derivative(points.signals) * points.input_amplitude
    return np.asarray(motion, dtype=complex), np.asarray(push, dtype=complex)


def regress_response(points: Sequence[ResponsePoints], model: Model, frame: Frame, turned: bool) -> dict[str, float]:
    """Return coefficients of the model in SI units, by name of `LOCAL`, and `phase` [rad]; all points share them.

    turned: whether the measuring chain may turn the phase. A moving base of the output's own unit has a gain of one.
    """
    pairs = [motion_and_push(one, frame) for one in points]
    y, a = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    omega = 2 * np.pi * np.concatenate([one.frequency_hz for one in points])
    size = [one.input_amplitude / (2 * np.pi * one.frequency_hz) ** derivative_order(one.output_unit) for one in points]
    std = np.concatenate(
        [np.sqrt(0.5 * np.trace(one.covariance, axis1=1, axis2=2)) * s for one, s in zip(points, size, strict=True)]
    )
    columns: dict[str, Complexes] = {"stiffness": y, "damping": 1j * omega * y}
    if model.law.has(LossFactor):
        columns["damping"] = 1j * y
    if model.law.sticks:
        columns["coulomb"] = 4j / np.pi * y / np.abs(y)
    if model.law.has(Cubic):
        columns["cubic"] = 0.75 * np.abs(y) ** 2 * y
    for term in model.law.terms:
        name = term.numbers[0].name
        if name not in (*columns, "loss_factor") and (wave := _fundamental(term, y, omega)) is not None:
            columns[name] = wave
    target = omega**2 * y
    signals = points[0].signals
    if points[0].excitation == "base" and signals.input_motion_unit == signals.motion_unit:
        target = target + a
    else:
        columns |= {"gain": -a} | ({"gain_imag": -1j * a} if turned else {})
    found = _weighted(columns, target, std, y)
    if not found["stiffness"] > 0:
        found["stiffness"] = float(omega[np.argmax(np.abs(y))] ** 2)
    if model.law.has(LossFactor):
        found["loss_factor"] = found.pop("damping") / found["stiffness"]
    if "gain_imag" in found:
        turned_gain = complex(found["gain"], found.pop("gain_imag"))
        found |= {"gain": abs(turned_gain), "phase": float(np.angle(turned_gain))}
    return found


def _fundamental(term: Term, y: Complexes, omega: Array) -> Complexes | None:
    """Return the fundamental of a term's force over its first number, shape (n,), of motions Re y exp(jωt); None where
    it has none, as an even force."""
    phase = 2 * np.pi * (np.arange(_PHASES) + 0.5) / _PHASES
    size = np.abs(y)[:, None]
    signal, order = term.regressor(size * np.cos(phase), -omega[:, None] * size * np.sin(phase))
    wave = 2 * np.mean(signal * np.exp(-1j * phase), axis=1)
    if np.abs(wave).max() < _SEEN * np.abs(signal).max():
        return None
    return np.asarray(wave * (1j * omega) ** order * y / np.abs(y))


def _weighted(columns: dict[str, Complexes], target: Complexes, std: Array, y: Complexes) -> dict[str, float]:
    """Return the coefficients whose equation error, seen as an error of the motion, is least."""
    names = list(columns)
    table = np.stack(list(columns.values()), axis=1)
    mechanical = np.array([not name.startswith("gain") for name in names])
    weight = 1.0 / (np.abs(target) + 1e-300)
    x = np.zeros(len(names))
    for _ in range(_ROUNDS):
        rows, goal = table * weight[:, None], target * weight
        real, wanted = np.concatenate([rows.real, rows.imag]), np.concatenate([goal.real, goal.imag])
        x = solve_scaled(real, wanted, 1e-12)
        dynamic = np.abs((table[:, mechanical] @ x[mechanical] - target) / y)
        weight = 1.0 / (std * np.maximum(dynamic, 1e-3 * float(dynamic.max())))
    return dict(zip(names, map(float, x), strict=True))


@dataclass(frozen=True, kw_only=True)
class ResponseFit(Fitted):
    """What the points of a stepped sine say about a model.

    nuisance: turn and background of the measuring chain. predicted: the fitted response of each group, shape (n,).
    rmse: of measured less predicted response, over real and imaginary parts, output unit per input unit (`unit`).
    tests: of the residuals.
    """

    points: tuple[ResponsePoints, ...]
    predicted: tuple[Complexes, ...]
    tests: ResponseTests
    layout: ResponseLayout

    def bic(self) -> float:
        """Return the information criterion n ln(mean squared weighted residual) + m ln n, n = 2 for each point."""
        n = self.solution.residual.size
        return float(n * np.log(max(self.solution.sum_of_squares / n, 1e-300)) + self.solution.values.size * np.log(n))


_TOLERANCE = 1e-10
_START = {"damping": (1e-5, 10.0), "loss_factor": (1e-5, 0.9), "coulomb": (1e-6, 0.5), "quadratic": (0.1, 0.1)}
"""Bounds of where the search begins, where a steady response asks for others than a record. At no quadratic term the
sum of squares is flat: only its square is seen at the fundamental."""
_CHAIN_NATURAL = 0.3
_CHAIN_WORDS = {"phase": "phase", "background_real": "background (real)", "background_imag": "background (imaginary)"}


def fit_response(
    points: ResponsePoints | Sequence[ResponsePoints],
    model: Model | str,
    *,
    chain: Sequence[str] = (),
) -> ResponseFit:
    """Return the fit of a model to one stepped sine, or to several with the same mechanics.

    chain: what else the measuring chain may add, of `CHAIN`: a constant turn of the phase (a lock-in's reference, a
        velocity taken for a position) and a response that does not depend on frequency.

    The covariance is scaled by the residual, with Student's degrees of freedom; where the residuals are more than the
    points' scatter, or go together at neighbouring frequencies, no standard deviation is less than that of the scores
    summed over neighbours (Newey and West), which holds for a model that is not quite right.
    Raises RecordingError for points that cannot be fitted, SpecError for a model that does not go with them.
    """
    configure()
    given = (points,) if isinstance(points, ResponsePoints) else tuple(points)
    groups = tuple(squeeze_scatter(one) for one in given)
    model = get_model(model) if isinstance(model, str) else model
    _check(groups, model, chain)
    found = [_fit_in_frame(groups, model, frame, chain) for frame in frames_of(groups[0].signals)]
    return min(found, key=lambda one: one.solution.sum_of_squares)


def _check(points: Sequence[ResponsePoints], model: Model, chain: Sequence[str]) -> None:
    if not points or not sum(one.size for one in points):
        raise SpecError("no point of a response to fit")
    if len({(one.excitation, one.output_unit, one.input_unit) for one in points}) > 1:
        raise SpecError("points of one fit need the same excitation and units")
    if model.law.has(Pendulum) and points[0].signals.motion_unit not in ("rad", "1"):
        raise SpecError(f"model {model.name} needs an angle, the output is in {points[0].output_unit}")
    if unknown := [name for name in chain if name not in CHAIN]:
        raise SpecError(f"the chain adds {unknown[0]!r}, expected some of {', '.join(CHAIN)}")
    if held := [one.lost for one in model.law.terms if one.history is not None and not isinstance(one, LossFactor)]:
        raise SpecError(
            f"{held[0]} has an inner state, which the harmonic balance of a steady response does not follow; "
            "choose drag or coulomb, or fit a record in time"
        )
    if model.rest != "offset":
        raise SpecError("a steady response says nothing of drift or creep; leave the rest position as it is")


def _fit_in_frame(points: tuple[ResponsePoints, ...], model: Model, frame: Frame, chain: Sequence[str]) -> ResponseFit:
    values = regress_response(points, model, frame, "phase" in chain)
    scales = [scales_of_points(one, values, frame) for one in points]
    layout = make_response_layout(model, points, scales, frame, chain)
    problem = _problem(layout)
    solution = solve(problem, *_starts(layout, values), tolerance=_TOLERANCE, max_evaluations=100)
    return _tell(layout, solution)


def _starts(layout: ResponseLayout, values: dict[str, float]) -> list[Array]:
    """Return where the search begins: by the regression, and for a stiffness with more terms also without them."""
    parts, entries = layout.layout.parts, layout.layout.entries
    x = np.zeros(layout.width)
    for k, entry in enumerate(entries):
        normal = []
        for part, ratio in zip(parts, layout.layout.ratio, strict=True):
            normal.append(values.get(entry.local, 0.0) / part.scales.physical(entry.local) / ratio[k])
        x[k] = float(np.clip(np.median(normal), *_START.get(entry.local, LOCAL[entry.local].start)))
    for k, name in enumerate(layout.chain, start=layout.mechanics):
        x[k] = values.get(name, 0.0)
    bent = np.array([entry.local in ("quadratic", "cubic") for entry in entries] + [False] * len(layout.chain))
    if not bent.any():
        return [x]
    small = np.array([0.03 * (entry.local == "quadratic") for entry in entries] + [0.0] * len(layout.chain))
    return [x, np.where(bent, small, x)]


def _problem(layout: ResponseLayout) -> Problem:
    held: dict[bytes, list[Predicted]] = {}

    def predicted(x: Array) -> list[Predicted]:
        key = x.tobytes()
        if key not in held:
            held.clear()
            held[key] = [layout.predict(x, i) for i in range(len(layout.points))]
        return held[key]

    def residual(x: Array) -> Array:
        rows = [
            whiten(one, found.response - one.response) for one, found in zip(layout.points, predicted(x), strict=True)
        ]
        return np.concatenate(rows).ravel()

    def jacobian(x: Array) -> Array:
        blocks = []
        for one, found in zip(layout.points, predicted(x), strict=True):
            pair = np.stack([found.slopes.real, found.slopes.imag], axis=1)
            blocks.append(np.linalg.solve(np.linalg.cholesky(one.covariance), pair).reshape(-1, x.size))
        return np.concatenate(blocks)

    return Problem(residual, jacobian)


def _tell(layout: ResponseLayout, solution: Solution) -> ResponseFit:
    points = layout.points
    found = [layout.predict(solution.values, i) for i in range(len(points))]
    off = [one.response - f.response for one, f in zip(points, found, strict=True)]
    motion = [np.abs(one.response) * one.input_amplitude for one in points]
    tests = ask_points(points, off, motion, layout.width)
    certainty = _certainty(layout, solution, tests)
    mechanical, count = layout.layout, layout.mechanics
    moved = replace(solution, values=solution.values[:count])
    of_moved = Covariance(certainty.matrix[:count, :count], certainty.degrees_of_freedom)
    frequency, damping = oscillation(mechanical, moved, of_moved)
    every = estimates(solution.values, certainty)[layout.mechanics :]
    nuisance = {
        name: one if name == "phase" else one.times(layout.size) for name, one in zip(layout.chain, every, strict=True)
    }
    lost = int(sum((~f.found).sum() for f in found))
    message = solution.message + (f"; at {lost} points no steady oscillation was found" if lost else "")
    units = (points[0].output_unit, points[0].input_unit)
    return ResponseFit(
        model=mechanical.model,
        frame=layout.frame,
        points=points,
        parameters=mechanical_parameters(mechanical, moved, of_moved),
        nuisance={name.replace("phase", "phase_rad"): one for name, one in nuisance.items()},
        natural_frequency_hz=frequency,
        damping_ratio=damping,
        predicted=tuple(f.response for f in found),
        rmse=float(np.sqrt(0.5 * np.mean(np.abs(np.concatenate(off)) ** 2))),
        unit=units[0] if units[1] == "1" else "1" if units[0] == units[1] else f"{units[0]}/{units[1]}",
        converged=solution.converged and not lost,
        message=message,
        unidentifiable=_unidentifiable(layout, solution),
        tests=tests,
        covariance=certainty,
        solution=solution,
        layout=layout,
    )


def _certainty(layout: ResponseLayout, solution: Solution, tests: ResponseTests) -> Covariance:
    n, m = solution.jacobian.shape
    sizes = [one.size for one in layout.points]
    matrix, robust, scale = sandwich(solution.jacobian, solution.residual, sizes)
    if tests.chi_square_p < SIGNIFICANT or tests.neighbours_p < SIGNIFICANT:
        ratio = np.sqrt(np.maximum(np.diag(robust), 0.0) / np.maximum(np.diag(matrix), 1e-300))
        larger = np.maximum(ratio, 1.0)
        matrix = matrix * np.outer(larger, larger)
    matrix = matrix / np.outer(scale, scale)
    unseen = np.linalg.norm(solution.jacobian, axis=0) == 0
    matrix[unseen, unseen] = np.inf
    return Covariance(np.asarray(matrix), float(max(n - m, 1)))


def _unidentifiable(layout: ResponseLayout, solution: Solution) -> tuple[str, ...]:
    names, natural = words_and_scales(layout.layout, solution.values)
    names += [_CHAIN_WORDS[name] for name in layout.chain]
    n, m = solution.jacobian.shape
    if n <= m:
        raise RecordingError(f"found {n // 2} points for {m} numbers; measure more frequencies or fit a smaller model")
    noise = float(np.sqrt(solution.sum_of_squares / (n - m)))
    natural = np.append(natural, np.full(len(layout.chain), _CHAIN_NATURAL))
    return find_unidentifiable(names, natural, solution.jacobian, noise)


# A fitted response gives its peak and its curve.

_UNKNOWN = Estimate(np.nan, np.nan, np.nan, np.nan)


@dataclass(frozen=True, repr=False)
class LevelPeak(Result):
    """Where a fitted response to a drive of one amplitude resonates.

    input_amplitude: in the unit of the input. frequency_hz: of the peak; gain: of the output there over the drive, of
    the joint itself, without turn and background of the measuring chain. phase_90_hz: where the motion lags by 90°.
    reason: one sentence where there is no peak in reach of the points, else empty.
    """

    input_amplitude: Annotated[float, Field("drive")]
    frequency_hz: Annotated[Estimate, Field("peak")] = _UNKNOWN
    gain: Annotated[Estimate, Field("gain")] = _UNKNOWN
    phase_90_hz: Annotated[Estimate, Field("90° of lag")] = _UNKNOWN
    reason: str = ""


def _around(x: Array, covariance: Array) -> Array:
    """Return x and one standard deviation to both sides of it along the columns of the covariance, (2m + 1, m)."""
    size, turned = np.linalg.eigh(0.5 * (covariance + covariance.T))
    root = (turned * np.sqrt(np.maximum(size, 0.0))).T
    return np.concatenate([x[None], x + root, x - root])


def _spread_of(values: Array, freedom: float) -> Estimate:
    """Return the estimate of what was read at each row of `_around`, shape (2m + 1,), to first order."""
    count = (values.size - 1) // 2
    share = 0.5 * (values[1 : count + 1] - values[count + 1 :])
    std = float(np.sqrt(share @ share)) if np.isfinite(values).all() else np.nan
    return Estimate.student(float(values[0]), std, freedom)


_REACH, _LAGS, _DEGREE = 0.25, 11, 5  # of the lag around the top [rad], points there, polynomial through them
_FINE = 2001
_BEYOND = 0.05  # of the swept range: how far outside it a peak is sought


def _numbers_around(fit: ResponseFit, part: int) -> Array:
    """Return numbers of one group at the fit and around it, as `_around` has them, shape (2m + 1, l)."""
    count = fit.layout.mechanics
    matrix = fit.covariance.matrix[:count, :count]
    if not np.isfinite(matrix).all():
        raise SpecError("a number of this fit is not determined at all; its peak has no interval, fit a smaller model")
    lanes, rest = _around(fit.solution.values[:count], matrix), fit.solution.values[count:]
    return np.stack([fit.layout.numbers(np.concatenate([lane, rest]), part) for lane in lanes])


def peak_of_response(fit: ResponseFit, input_amplitude: float | None = None, *, part: int = 0) -> LevelPeak:
    """Return resonance frequency and gain of a fitted response to a drive of one amplitude at all frequencies.

    input_amplitude: in the unit of the input; None for the median of the group's points; a linear joint does not feel
    it. part: index of the group. The peak is sought within the swept range and a twentieth of it beyond; the response
    is read along its lag, against which even a folded peak is single. Standard deviations to first order (delta method)
    from the fit's covariance.
    """
    points, scales = fit.points[part], fit.layout.layout.parts[part].scales
    amplitude = float(np.median(points.input_amplitude)) if input_amplitude is None else float(input_amplitude)
    around, laws = _numbers_around(fit, part), fit.layout.laws(part)
    drive = drive_of(points, scales, amplitude)
    hertz = scales.omega / (2 * np.pi)
    margin = _BEYOND * float(np.ptp(points.frequency_hz))
    low = max(float(points.frequency_hz[0]) - margin, 0.02 * hertz)
    high = float(points.frequency_hz[-1]) + margin
    top, inside = top_of_sweep(around[0], laws, drive, low / hertz, high / hertz)
    if not inside:
        reason = "the response is largest at the edge of the sweep; extend the sweep beyond it"
        return LevelPeak(amplitude, reason=reason)
    lag = lag_of(top, laws, drive)
    lags = np.r_[lag + np.linspace(-_REACH, _REACH, _LAGS), 0.5 * np.pi]
    lanes = around.shape[0]
    numbers = np.repeat(around, lags.size, axis=0)
    omega, motion, found = lagging(numbers, np.tile(lags, lanes), laws, drive, top)
    first = motion[:, laws.orders == 1][:, 0]
    gain = np.abs(_output(fit, scales, numbers, omega, first, amplitude)) / amplitude
    shape = (lanes, lags.size)
    omega, gain, found = omega.reshape(shape), gain.reshape(shape), found.reshape(shape)
    if not found[:, :-1].all():
        return LevelPeak(amplitude, reason="the balance was not found around the top of the response")
    frequency, largest = _tops(lags[:-1] - lag, hertz * omega[:, :-1], gain[:, :-1])
    freedom = fit.covariance.degrees_of_freedom
    crossed = found[:, -1].all() and fit.frame == "relative"
    return LevelPeak(
        amplitude,
        _spread_of(frequency, freedom),
        _spread_of(largest, freedom),
        _spread_of(hertz * omega[:, -1], freedom) if crossed else _UNKNOWN,
    )


def response_curve(fit: ResponseFit, part: int = 0) -> tuple[Array, Complexes]:
    """Return frequencies [Hz] and fitted response of one group along its curve, through its folds, shape (n,) each.

    What turn and background the measuring chain adds is in it, as in the points.
    """
    points, scales = fit.points[part], fit.layout.layout.parts[part].scales
    amplitude, laws = float(np.median(points.input_amplitude)), fit.layout.laws(part)
    numbers, (turn, background) = fit.layout.numbers(fit.solution.values, part), fit.layout.added(fit.solution.values)
    hertz = scales.omega / (2 * np.pi)
    low, high = points.frequency_hz[[0, -1]] / hertz
    found = swept(numbers, laws, drive_of(points, scales, amplitude), float(low), float(high))
    lanes = np.broadcast_to(numbers, (len(found), numbers.size))
    moving = _output(fit, scales, lanes, found[:, -1], fundamentals(found, laws), amplitude)
    return hertz * found[:, -1], np.asarray(moving / amplitude * turn + background)


def _output(
    fit: ResponseFit,
    scales: Scales,
    numbers: Array,
    omega: Array,
    fundamental: Complexes,
    amplitude: float,
) -> Complexes:
    """Return the output's fundamental, in its unit."""
    points = fit.points[0]
    moving = fundamental * scales.amplitude
    turn = 1j * omega * scales.omega
    if fit.frame == "absolute":
        carried = turn ** (-derivative_order(points.input_unit)) * amplitude
        moving = moving + numbers[:, -1] * scales.physical("gain") * carried
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
