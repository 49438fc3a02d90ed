"""This is where a model is fitted to the points of a stepped sine: least squares in the frequency domain.

Linear laws in closed form, the others by harmonic balance at each point's own drive amplitude
(`sinew.identify.response_balance`); residuals are weighted by the points' scatter. Where a joint has several steady
oscillations at one frequency, the measured one says which is meant.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sinew.identify.certainty import Covariance, estimates, find_unidentifiable
from sinew.identify.grid import Frame, Scales, frames_of
from sinew.identify.least_squares import Problem, Solution, solve
from sinew.identify.mechanics import mechanical_parameters, oscillation
from sinew.identify.model import NATURAL, WORDS, Model, get_model
from sinew.identify.response_fitted import ResponseFit, ResponseTests
from sinew.identify.response_layout import CHAIN, Predicted, ResponseLayout, make_response_layout
from sinew.identify.response_points import ResponsePoints
from sinew.identify.response_scatter import squeeze_scatter
from sinew.identify.response_start import regress_response, scales_of_points
from sinew.identify.response_tests import ask_points, long_run, whiten
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import Estimate

__all__ = ["fit_response"]

Array = NDArray[np.float64]

_TOLERANCE = 1e-10
_TOLD = 0.01  # significance from which on the residuals are no mere scatter
_CHAIN_NATURAL = {"phase": 0.3, "background_real": 0.3, "background_imag": 0.3}
_CHAIN_WORDS = {"phase": "phase", "background_real": "background (real)", "background_imag": "background (imaginary)"}


def fit_response(
    points: ResponsePoints | Sequence[ResponsePoints],
    model: Model | str,
    *,
    varying: Sequence[str] = (),
    chain: Sequence[str] = (),
) -> ResponseFit:
    """Return the fit of a model to one stepped sine, or to several with the same mechanics.

    varying: of several groups, the mechanical numbers (names of `LOCAL`: stiffness, damping, ...) that differ from
        group to group; all others are shared.
    chain: what else the measuring chain may add, of `CHAIN`: a constant turn of the phase (a lock-in's reference, a
        velocity taken for a position) and a response that does not depend on frequency.

    The covariance is scaled by the residual, with Student's degrees of freedom; where the residuals are more than the
    points' scatter, or go together at neighbouring frequencies, no standard deviation is less than that of the scores
    summed over neighbours (Newey and West), which holds for a model that is not quite right.
    Raises RecordingError for points that cannot be fitted, SpecError for a model that does not go with them.
    """
    given = (points,) if isinstance(points, ResponsePoints) else tuple(points)
    groups = tuple(squeeze_scatter(one) for one in given)
    model = get_model(model) if isinstance(model, str) else model
    _check(groups, model, chain)
    found = [_fit_in_frame(groups, model, frame, varying, chain) for frame in frames_of(groups[0].signals)]
    return min(found, key=lambda one: one.solution.sum_of_squares)


def _check(points: Sequence[ResponsePoints], model: Model, chain: Sequence[str]) -> None:
    if not points or not sum(one.size for one in points):
        raise SpecError("no point of a response to fit")
    if len({(one.excitation, one.output_unit, one.input_unit) for one in points}) > 1:
        raise SpecError("points of one fit need the same excitation and units")
    if model.pendulum and points[0].signals.motion_unit not in ("rad", "1"):
        raise SpecError(f"model {model.name} needs an angle, the output is in {points[0].output_unit}")
    if unknown := [name for name in chain if name not in CHAIN]:
        raise SpecError(f"the chain adds {unknown[0]!r}, expected some of {', '.join(CHAIN)}")
    if model.rest != "offset":
        raise SpecError("a steady response says nothing of drift or creep; leave the rest position as it is")


def _fit_in_frame(
    points: tuple[ResponsePoints, ...], model: Model, frame: Frame, varying: Sequence[str], chain: Sequence[str]
) -> ResponseFit:
    scales, values = _begin(points, model, frame, varying, "phase" in chain)
    layout = make_response_layout(model, points, scales, frame, varying, chain)
    problem = _problem(layout)
    solution = solve(problem, *_starts(layout, values), tolerance=_TOLERANCE, max_evaluations=100)
    return _tell(layout, solution)


def _begin(
    points: Sequence[ResponsePoints], model: Model, frame: Frame, varying: Sequence[str], turned: bool
) -> tuple[list[Scales], list[dict[str, float]]]:
    names = [one.group if varying else "" for one in points]
    found: dict[str, dict[str, float]] = {}
    for name in dict.fromkeys(names):
        mine = [one for one, its in zip(points, names, strict=True) if its == name]
        found[name] = regress_response(mine, model, frame, turned)
    values = [found[name] for name in names]
    return [scales_of_points(one, v, frame) for one, v in zip(points, values, strict=True)], values


def _starts(layout: ResponseLayout, values: Sequence[dict[str, float]]) -> list[Array]:
    """Return where the search begins: by the regression, and for a stiffness with more terms also without them."""
    parts, entries = layout.layout.parts, layout.layout.entries
    x = np.zeros(layout.width)
    for k, entry in enumerate(entries):
        which = [i for i, part in enumerate(parts) if entry.group in ("", part.record.group)]
        normal = []
        for i in which:
            ratio = layout.layout.ratio[i][np.flatnonzero(layout.layout.index[i] == k)[0]]
            normal.append(values[i].get(entry.local, 0.0) / parts[i].scales.physical(entry.local) / ratio)
        x[k] = float(np.clip(np.median(normal), -1e3, 1e3))
        if entry.local in ("damping", "loss_factor"):
            x[k] = float(np.clip(x[k], 1e-5, 0.9 if entry.local == "loss_factor" else 10.0))
        if entry.local == "coulomb":
            x[k] = float(np.clip(x[k], 1e-6, 0.5))
        if entry.local == "quadratic":
            x[k] = 0.1  # at zero the sum of squares is flat: only its square is seen at the fundamental
    for k, name in enumerate(layout.chain, start=layout.mechanics):
        x[k] = values[0].get(name, 0.0)
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
        name: one if name == "phase" else _times(one, layout.size)
        for name, one in zip(layout.chain, every, strict=True)
    }
    lost = int(sum((~f.balance.found).sum() for f in found))
    message = solution.message + (f"; at {lost} points no steady oscillation was found" if lost else "")
    units = (points[0].output_unit, points[0].input_unit)
    return ResponseFit(
        mechanical.model,
        layout.frame,
        points,
        mechanical_parameters(mechanical, moved, of_moved),
        {name.replace("phase", "phase_rad"): one for name, one in nuisance.items()},
        frequency,
        damping,
        tuple(f.response for f in found),
        float(np.sqrt(0.5 * np.mean(np.abs(np.concatenate(off)) ** 2))),
        units[0] if units[1] == "1" else "1" if units[0] == units[1] else f"{units[0]}/{units[1]}",
        solution.converged and not lost,
        message,
        _unidentifiable(layout, solution),
        tests,
        certainty,
        solution,
        layout,
    )


def _times(one: Estimate, factor: float) -> Estimate:
    return Estimate(one.value * factor, one.std * factor, one.low * factor, one.high * factor)


def _certainty(layout: ResponseLayout, solution: Solution, tests: ResponseTests) -> Covariance:
    jacobian, residual = solution.jacobian, solution.residual
    n, m = jacobian.shape
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    scaled = jacobian / scale
    gram = np.linalg.pinv(scaled.T @ scaled, hermitian=True)
    freedom = max(n - m, 1)
    matrix = solution.sum_of_squares / freedom * gram
    if tests.chi_square_p < _TOLD or tests.neighbours_p < _TOLD:
        scores = (scaled * residual[:, None]).reshape(-1, 2, m).sum(axis=1)
        robust = gram @ long_run(scores, [one.size for one in layout.points]) * (n / freedom) @ gram
        ratio = np.sqrt(np.maximum(np.diag(robust), 0.0) / np.maximum(np.diag(matrix), 1e-300))
        larger = np.maximum(ratio, 1.0)
        matrix = matrix * np.outer(larger, larger)
    matrix = matrix / np.outer(scale, scale)
    unseen = np.linalg.norm(jacobian, axis=0) == 0
    matrix[unseen, unseen] = np.inf
    return Covariance(np.asarray(matrix), float(freedom))


def _unidentifiable(layout: ResponseLayout, solution: Solution) -> tuple[str, ...]:
    entries = layout.layout.entries
    natural = [NATURAL[entry.local] for entry in entries] + [_CHAIN_NATURAL[name] for name in layout.chain]
    for k, entry in enumerate(entries):
        if entry.local == "gain":
            natural[k] = 0.5 * max(abs(float(solution.values[k])), 1e-6)
    names = [WORDS[entry.local] + (f" of {entry.group}" if entry.group else "") for entry in entries]
    names += [_CHAIN_WORDS[name] for name in layout.chain]
    n, m = solution.jacobian.shape
    if n <= m:
        raise RecordingError(f"found {n // 2} points for {m} numbers; measure more frequencies or fit a smaller model")
    noise = float(np.sqrt(solution.sum_of_squares / (n - m)))
    return find_unidentifiable(names, np.array(natural), solution.jacobian, noise)
