"""The tendon joint's fit to recordings: one set of parameters over all pretensions and repeats.

The model is `sinew.mechanics.joint` under the measured lever (`sinew.identify.joint.motion`). The search has
three legs: the steady segments of one repeat with a fifth of the signal taken for noise, which forgives a start that is
far off; then everything, with the noise that the residuals of the leg before show, twice.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import xarray as xr
from scipy import special

from sinew.identify.joint.motion import (
    Coordinates,
    JointProblem,
    Swing,
    is_enough,
    make_coordinates,
    make_problem,
    stated_repeatability,
    steps_per_sample,
    swings_of,
    whitening_of,
)
from sinew.identify.oscillator.least_squares import Covariance, Solution, find_unidentifiable, solve
from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import NORMAL_90, Estimate
from sinew.plan.rig import RigSpec
from sinew.solve.programs import configure
from sinew.solve.rest import FreeSwing, free_swing

# The physical combinations of a joint fit get their values and intervals.


_STEP = 1e-4  # of a coordinate: third derivatives then count for 1e-8
_SHARED = ("stiffness_n_m_rad", "tendon_moment_n_m")


def derive(swings: Sequence[Swing], coordinates: Coordinates, x: Array, covariance: Array) -> dict[str, Estimate]:
    """Return the derived quantities of `JointFit`.

    x: shared coordinates, shape (m,); covariance: of them, shape (m, m). Intervals are to first order.
    """
    found = dict(zip(_SHARED, _estimates(partial(_of_the_joint, coordinates), x, covariance), strict=True))
    for pretension in sorted({swing.pretension_mm for swing in swings}):
        mine = [swing for swing in swings if swing.pretension_mm == pretension]
        amplitude, end = _amplitude(mine), f"[{pretension:g} mm]"
        found[f"amplitude_rad{end}"] = Estimate(amplitude, 0.0, amplitude, amplitude)
        at = partial(_at, coordinates, pretension, mine[0].mode, amplitude)
        rows = zip(FreeSwing._fields, _estimates(at, x, covariance), strict=True)
        found |= {name + end: one for name, one in rows}
    return found


def _of_the_joint(coordinates: Coordinates, x: Array) -> Array:
    rig = coordinates.rig_at(x)
    moment = rig.tendons.head_radius.value * rig.tendons.first_contact_tension.value
    return np.array([rig.silicone.stiffness(0.0), moment])


def _at(coordinates: Coordinates, pretension_mm: float, mode: float, amplitude: float, x: Array) -> Array:
    numbers = coordinates.numbers(x)
    return np.array(free_swing(numbers.p, numbers.contact, pretension_mm, mode, amplitude), dtype=float)


def _estimates(quantities: Callable[[Array], Array], x: Array, covariance: Array) -> list[Estimate]:
    """Return estimates of what follows from the coordinates, by its slopes (central differences)."""
    values = quantities(x)
    slopes = np.array([(quantities(x + one) - quantities(x - one)) / (2 * _STEP) for one in _STEP * np.eye(x.size)])
    variances = np.maximum(np.einsum("iq,ij,jq->q", slopes, covariance, slopes), 0.0)
    return [Estimate.normal(float(v), float(s)) for v, s in zip(values, np.sqrt(variances), strict=True)]


def _amplitude(swings: Sequence[Swing]) -> float:
    """Return the median torsion amplitude of swings [rad], by the rate's root mean square and the drive's frequency."""
    found = [
        float(np.sqrt(2 * np.mean(swing.gyro[swing.recorded :] ** 2))) / (2 * np.pi * swing.frequency_hz)
        for swing in swings
        if swing.frequency_hz > 0
    ]
    return float(np.median(found)) if found else 0.1


_FEWEST = 4


def settled_covariance(jacobian: Array, residual: Array, settings: Sequence[tuple[Hashable, slice]]) -> Array:
    """Return the covariance of the coordinates, shape (m, m).

    jacobian: whitened, shape (n, m); residual: shape (n,). settings: of each swing its setting and its rows; rows of no
    swing have a known variance of one.

    The settings' part is widened by Student's factor for their number, so that normal intervals go with the result. No
    standard deviation is smaller than that of independent residuals, (JᵀJ)⁻¹; correlations are those of the latter.
    """
    gram = jacobian.T @ jacobian
    plain = np.linalg.pinv(gram, hermitian=True)
    labels = list(dict.fromkeys(label for label, _ in settings))
    groups = [[rows for label, rows in settings if label == one] for one in labels]
    if len(groups) < _FEWEST:
        groups = [[rows] for _, rows in settings]
    if len(groups) < _FEWEST:
        return np.asarray(plain)
    root = _power(np.asarray(plain), 0.5)
    known = gram.copy()
    moved = []
    for group in groups:
        own = sum((jacobian[rows].T @ jacobian[rows] for rows in group), np.zeros_like(gram))
        score = sum((jacobian[rows].T @ residual[rows] for rows in group), np.zeros(gram.shape[0]))
        known -= own
        moved.append(root @ _power(np.eye(gram.shape[0]) - root @ own @ root, -0.5) @ root @ score)
    steps = float(special.stdtrit(len(groups) - 1, 0.95)) / NORMAL_90 * np.array(moved)
    spread = steps.T @ steps + plain @ known @ plain
    larger = np.sqrt(np.maximum(np.diag(spread) / np.maximum(np.diag(plain), 1e-300), 1.0))
    return np.asarray(plain * np.outer(larger, larger))


_READINGS = 24


def lever_covariance(problem: JointProblem, solution: Solution) -> Array:
    """Return the covariance of the coordinates that is from the rounding of the lever's encoder, shape (m, m).

    The lever is what the joint is driven by in the fit, so its errors are errors of the input. In a steady motion they
    repeat with it: their share at the drive's frequency is larger than that of independent ones by the root of the
    periods, and of twice as many where both halves of a period are alike. It does not fall with a longer record, and as
    gain and phase of a few frequencies are what the parameters are from, it goes into these and hardly shows in what
    the fit leaves. So the lever is read again, and the fit moved along by its Jacobian. Widened by Student's factor for
    the number of readings.
    """
    rng = np.random.default_rng(0)
    back = np.linalg.pinv(solution.jacobian.T @ solution.jacobian, hermitian=True) @ solution.jacobian.T
    read = [problem.read_again(rng).problem().residual(solution.values) for _ in range(_READINGS)]
    steps = np.array([back @ (there - solution.residual) for there in read])
    widened = float(special.stdtrit(_READINGS, 0.95)) / NORMAL_90
    return np.asarray(widened**2 * steps.T @ steps / _READINGS)


def whole_covariance(problem: JointProblem, solution: Solution) -> Array:
    """Return the covariance of the coordinates, shape (m, m): of the residuals' noise and of the lever's rounding.

    No standard deviation is smaller than what the settings' scatter says (`settled_covariance`), which holds whatever
    else the model misses.
    """
    jacobian = solution.jacobian
    known = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True) + lever_covariance(problem, solution)
    settled = settled_covariance(jacobian, solution.residual, problem.settings())
    larger = np.sqrt(np.maximum(np.diag(settled) / np.maximum(np.diag(known), 1e-300), 1.0))
    return np.asarray(known * np.outer(larger, larger))


def _power(symmetric: Array, exponent: float) -> Array:
    """Return a power of a positive matrix; eigenvalues that rounding has made tiny or negative count as small."""
    values, vectors = np.linalg.eigh(symmetric)
    return np.asarray((vectors * np.maximum(values, 1e-12 * values[-1]) ** exponent) @ vectors.T)


@dataclass(frozen=True)
class JointSegment:
    """One fitted segment: the gyroscope's rate about the joint's axis, as it was and as the fit has it.

    swing: whose part it is. time_s: from the segment's first sample, shape (n,). measured, predicted: [rad/s],
    shape (n,). selected: which samples were fitted, shape (n,); the last of a segment lack the lever motion after them.
    predicted_current_a: mean current of the tendon motors over the segment.
    """

    swing: Swing
    time_s: Array
    measured: Array
    predicted: Array
    selected: Mask
    predicted_current_a: float

    @property
    def residual(self) -> Array:
        """Return measured less predicted [rad/s], shape (n,)."""
        return self.measured - self.predicted


@dataclass(frozen=True)
class JointFit:
    """What recordings of a rig say about its tendon joint.

    rig: where the fit began; fitted_rig: the same with the fitted values, origin calibrated.
    parameters: by the rig's dotted name, in the unit of the rig's parameter (SI). Those that were tied move along in
        `fitted_rig` (the base's radius with the head's, the head's inertia against the lever's).
    derived: physical combinations, unit in the key. Of the joint: `stiffness_n_m_rad` (G J/L), `tendon_moment_n_m`
        (head radius times the tension of one tendon at first contact). At each pretension, key ending in `[4 mm]`:
        `tendon_moment_n_m`, `tension_n` (of one tendon), `natural_frequency_hz` (undamped), `damping_ratio`, both at
        the torsion amplitude `amplitude_rad`; `cubic_n_m_rad3` (of the static restoring torque), and the shares of the
        energy lost in a cycle, `silicone_share`, `guide_friction_share`, `viscous_share`.
    pretension_mm: that were fitted, increasing. repeats: repetitions at each, over all recordings.
    repeatability: standard deviations between repetitions of pretension [m] and guide friction [1], estimated where
        there are repeats, else the rig's.
    covariance: of `parameters`, in their units.
    segments: measured and predicted. rmse: by channel with unit: `gyro_rad_s`, `tendon_current_a`.
    converged, message: how the search ended. unidentifiable: sentences.
    """

    rig: RigSpec
    fitted_rig: RigSpec
    parameters: dict[str, Estimate]
    derived: dict[str, Estimate]
    pretension_mm: tuple[float, ...]
    repeats: int
    repeatability: tuple[float, float]
    covariance: Covariance
    segments: tuple[JointSegment, ...]
    rmse: dict[str, float]
    converged: bool
    message: str
    unidentifiable: tuple[str, ...]

    def at_pretension(self, name: str, pretension_mm: float) -> Estimate:
        """Return one derived quantity at a pretension that was fitted; KeyError where there is none."""
        return self.derived[f"{name}[{pretension_mm:g} mm]"]


Progress = Callable[[float, float], None]

FREE = (
    "silicone.torsional_rigidity",
    "silicone.diameter",
    "silicone.loss_factor",
    "inertia.lever",
    "tendons.head_radius",
    "tendons.first_contact_tension",
    "tendons.guide_friction",
    "tendons.presliding_angle",
    "imu.residual_delay",
)
"""What is sought unless the caller says otherwise, by the rig's dotted names."""

_ROUGH, _FINE = 1e-3, 1e-5
_EVALUATIONS = 60
_QUIET = 1e-5  # rad/s: smallest noise of a whitened residual
_NEAR = 1e-6


def fit_joint(
    recordings: Sequence[xr.Dataset],
    rig: RigSpec,
    *,
    free: Sequence[str] = FREE,
    progress: Progress | None = None,
) -> JointFit:
    """Return the rig's tendon joint as the recordings have it.

    recordings: of the twin or a bench, with steady or ring-down segments. rig: where the search begins;
    what is not free stays as it is there, above all the sum of the inertias, without which no torque is known. The
    rig's bounds are a weak prior: a normal about the rig's value with the bounds' distance as its 95 % interval.
    free: dotted names of the rig's parameters. progress: called with (done, total).
    Raises RecordingError where the recordings have nothing to fit, SpecError for a name that cannot be free.
    """
    configure()
    if rig.section is not None:
        free = [name for name in free if name != "silicone.diameter"]  # it only names the circle around the section
    coordinates = make_coordinates(rig, free)
    swings = [swing for swing in swings_of(recordings, rig) if is_enough(swing, rig.imu.average_samples)]
    if not swings:
        raise RecordingError("no segment is long and whole enough to be fitted; record longer segments")
    problem, solution = _search(swings, coordinates, progress)
    return _tell(problem, solution)


def _search(
    swings: Sequence[Swing], coordinates: Coordinates, progress: Progress | None
) -> tuple[JointProblem, Solution]:
    steps = steps_per_sample(coordinates.numbers(np.zeros(len(coordinates.names))), max(s.sample_s for s in swings))
    first = make_problem(_easy(swings), coordinates, steps)
    x = _solved(first, np.zeros(first.size), _ROUGH).values
    report_progress = progress or (lambda done, total: None)
    report_progress(1, 4)
    problem = make_problem(swings, coordinates, steps)
    x = np.concatenate([x[: first.shared], np.zeros(problem.size - problem.shared)])
    solution = _solved(problem, x, _ROUGH)
    report_progress(2, 4)
    for leg, tolerance in enumerate((_ROUGH, _FINE), start=3):
        x, scatter = solution.values.copy(), _scatter(problem, solution)
        whitenings = whitening_of(problem.residuals(x), _QUIET)
        x[problem.of_settings] *= np.tile(_over(problem.repeatability, scatter), len(problem.pairs))
        problem = replace(problem, whitenings=whitenings, repeatability=scatter)
        solution = _solved(problem, x, tolerance)
        report_progress(leg, 4)
    return problem, solution


def _over(before: tuple[float, float], after: tuple[float, float]) -> Array:
    return np.array([one / other if other > 0 else 1.0 for one, other in zip(before, after, strict=True)])


def _scatter(problem: JointProblem, solution: Solution) -> tuple[float, float]:
    """Return the standard deviations of pretension [m] and guide friction [1] between settings.

    They are the rig's where every pretension was set once. Where there are repeats they are estimated: the mean square
    of a deviation and its own uncertainty, the rig's counting as much as `_STATED` settings.
    """
    known = stated_repeatability(problem.coordinates.rig)
    if problem.repeats < 2:
        return known
    gram = solution.jacobian.T @ solution.jacobian
    own = solution.values**2 + np.diag(np.linalg.pinv(gram, hermitian=True))
    squares = own[problem.of_settings].reshape(-1, 2).sum(axis=0) * np.square(problem.repeatability)
    weight = _STATED + len(problem.pairs)
    found = [float(np.sqrt((_STATED * k**2 + s) / weight)) for k, s in zip(known, squares, strict=True)]
    return found[0], found[1]


_STATED = 4


def _easy(swings: Sequence[Swing]) -> list[Swing]:
    """Return the steady swings of one repeat at each pretension; all where there are no steady ones."""
    steady = [swing for swing in swings if swing.kind == "steady"] or list(swings)
    first = {swing.pretension_mm: swing.pair for swing in reversed(steady)}
    return [swing for swing in steady if first[swing.pretension_mm] == swing.pair]


def _solved(problem: JointProblem, start: Array, tolerance: float) -> Solution:
    low, high = problem.bounds()
    inside = np.clip(start, low, high)
    return solve(problem.problem(), inside, bounds=(low, high), tolerance=tolerance, max_evaluations=_EVALUATIONS)


def _tell(problem: JointProblem, solution: Solution) -> JointFit:
    x, coordinates, shared = solution.values, problem.coordinates, problem.shared
    own = whole_covariance(problem, solution)[:shared, :shared]
    segments, slopes = _segments(problem, x), coordinates.slopes(x[:shared])
    return JointFit(
        rig=coordinates.rig,
        fitted_rig=coordinates.fitted_rig(x[:shared]),
        parameters=coordinates.estimates(x[:shared], np.sqrt(np.diag(own))),
        derived=derive(problem.swings, coordinates, x[:shared], own),
        pretension_mm=tuple(sorted({swing.pretension_mm for swing in problem.swings})),
        repeats=problem.repeats,
        repeatability=problem.repeatability,
        covariance=Covariance(own * np.outer(slopes, slopes), float(max(solution.degrees_of_freedom, 1))),
        segments=segments,
        rmse=_rmse(segments),
        converged=solution.converged,
        message=_message(problem, solution),
        unidentifiable=_unidentifiable(problem, solution),
    )


def _segments(problem: JointProblem, x: Array) -> tuple[JointSegment, ...]:
    found = []
    for swing, sieve, (rate, current) in zip(problem.swings, problem.sieves, problem.predicted(x), strict=True):
        begin = swing.recorded
        selected = np.zeros(swing.size, dtype=bool)
        selected[sieve.selected[0] : sieve.selected[-1] + 1] = True
        bias = float(np.mean((swing.gyro - rate)[selected]))
        time_s = np.arange(swing.size - begin, dtype=float) * swing.sample_s
        there = (selected & swing.present)[begin:]
        found.append(JointSegment(swing, time_s, swing.gyro[begin:], rate[begin:] + bias, there, current))
    return tuple(found)


def _rmse(segments: Sequence[JointSegment]) -> dict[str, float]:
    rates = np.concatenate([segment.residual[segment.selected] for segment in segments])
    currents = np.array([segment.swing.current_a - segment.predicted_current_a for segment in segments])
    currents = currents[np.isfinite(currents)]
    of_current = float(np.sqrt(np.mean(currents**2))) if currents.size else float("nan")
    return {"gyro_rad_s": float(np.sqrt(np.mean(rates**2))), "tendon_current_a": of_current}


def _message(problem: JointProblem, solution: Solution) -> str:
    lines = [solution.message]
    low, high = problem.bounds()
    for name, value, one, other in zip(problem.coordinates.names, solution.values, low, high, strict=False):
        if min(value - one, other - value) < _NEAR:
            lines.append(f"{name} lies at a bound of the rig, so its interval cannot be trusted; widen the bounds")
    widened = _over(problem.repeatability, stated_repeatability(problem.coordinates.rig))
    off = solution.values[problem.of_settings] * np.tile(widened, len(problem.pairs))
    largest = float(np.abs(off).max(initial=0.0))
    if largest > 4:
        lines.append(
            f"a repetition deviates by {largest:.1f} times the rig's stated repeatability; "
            "raise repeatability in the rig, or look for what changed between the repeats"
        )
    return "; ".join(lines)


def _unidentifiable(problem: JointProblem, solution: Solution) -> tuple[str, ...]:
    """Return the directions of the shared parameters that the data leave open, the deviations being any.

    What matters of a parameter is the standard deviation that the rig's bounds leave it.
    """
    jacobian = problem.data_rows(solution.jacobian)
    shared, others = jacobian[:, : problem.shared], jacobian[:, problem.shared :]
    seen = shared - others @ np.linalg.lstsq(others, shared, rcond=None)[0]
    coordinates = problem.coordinates
    natural = coordinates.width / coordinates.slopes(solution.values[: problem.shared])
    return find_unidentifiable(coordinates.names, natural, seen, 1.0)
