"""This is where the tendon joint is fitted to recordings: one set of parameters over all pretensions and repeats.

The model is the twin's equation of motion under the measured lever; see `joint_motion`. The search has three legs: the
steady segments of one repeat with a fifth of the signal taken for noise, which forgives a start that is far off; then
everything, with the noise that the residuals of the leg before show, twice.
"""

from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sinew.identify.certainty import Covariance, find_unidentifiable
from sinew.identify.joint_certainty import settled_covariance
from sinew.identify.joint_coordinates import Coordinates, make_coordinates
from sinew.identify.joint_derived import derive
from sinew.identify.joint_fitted import Deviation, JointFit, JointSegment
from sinew.identify.joint_motion import steps_per_sample
from sinew.identify.joint_problem import JointProblem, make_problem, whitening_of
from sinew.identify.joint_sieve import is_enough
from sinew.identify.joint_swing import Swing, swings_of
from sinew.identify.least_squares import Solution, solve
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import Estimate
from sinew.plan.rig import RigSpec
from sinew.twin.cache import configure

__all__ = ["FREE", "fit_joint"]

Array = NDArray[np.float64]
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
_NINETY = 1.6448536269514722


def fit_joint(
    recordings: Sequence[xr.Dataset],
    rig: RigSpec,
    *,
    free: Sequence[str] = FREE,
    progress: Progress | None = None,
) -> JointFit:
    """Return the rig's tendon joint as the recordings have it.

    recordings: of the twin or a bench, with steady or ring-down segments, each from rest. rig: where the search begins;
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
    _report(progress, 1)
    problem = make_problem(swings, coordinates, steps)
    x = np.concatenate([x[: first.shared], np.zeros(2 * len(problem.pairs))])
    for leg, tolerance in enumerate((_ROUGH, _ROUGH, _FINE), start=2):
        if leg > 2:
            problem = problem.sized(whitening_of(problem.residuals(x), _QUIET))
        solution = _solved(problem, x, tolerance)
        x = solution.values
        _report(progress, leg)
    return problem, solution


def _easy(swings: Sequence[Swing]) -> list[Swing]:
    """Return the steady swings of one repeat at each pretension; all where there are no steady ones."""
    steady = [swing for swing in swings if swing.kind == "steady"] or list(swings)
    first = {swing.pretension_mm: swing.pair for swing in reversed(steady)}
    return [swing for swing in steady if first[swing.pretension_mm] == swing.pair]


def _solved(problem: JointProblem, start: Array, tolerance: float) -> Solution:
    low, high = problem.bounds()
    inside = np.clip(start, low, high)
    return solve(problem.problem(), inside, bounds=(low, high), tolerance=tolerance, max_evaluations=_EVALUATIONS)


def _report(progress: Progress | None, leg: int) -> None:
    if progress is not None:
        progress(leg, 4)


def _tell(problem: JointProblem, solution: Solution) -> JointFit:
    x, coordinates, shared = solution.values, problem.coordinates, problem.shared
    covariance = settled_covariance(solution.jacobian, solution.residual, problem.settings())
    own = covariance[:shared, :shared]
    segments = _segments(problem, x)
    scales = np.concatenate([coordinates.slopes(x[:shared]), np.tile(problem.repeatability, len(problem.pairs))])
    deviations = _deviations(problem, x, covariance)
    labels = [f"{d.pretension_mm:g} mm, repeat {d.repeat}, recording {d.recording}" for d in deviations]
    names = [f"{name}[{label}]" for label in labels for name in ("pretension", "guide_friction")]
    freedom = float(max(solution.degrees_of_freedom, 1))
    return JointFit(
        coordinates.rig,
        coordinates.fitted_rig(x[:shared]),
        _parameters(coordinates, x[:shared], own),
        derive(problem.swings, coordinates, x[:shared], own),
        tuple(sorted({swing.pretension_mm for swing in problem.swings})),
        _repeats(problem),
        deviations,
        (*coordinates.names, *names),
        Covariance(covariance * np.outer(scales, scales), freedom),
        segments,
        _rmse(segments),
        solution.converged,
        _message(problem, solution),
        _unidentifiable(problem, solution),
    )


def _parameters(coordinates: Coordinates, x: Array, covariance: Array) -> dict[str, Estimate]:
    found = {}
    for k, (name, value) in enumerate(zip(coordinates.names, coordinates.values(x), strict=True)):
        half = np.zeros(x.size)
        half[k] = _NINETY * float(np.sqrt(covariance[k, k]))
        ends = [float(coordinates.values(x + side * half)[k]) for side in (-1, 1)]
        std = float(coordinates.slopes(x)[k] * np.sqrt(covariance[k, k]))
        found[name] = Estimate(float(value), std, *ends)
    return found


def _deviations(problem: JointProblem, x: Array, covariance: Array) -> tuple[Deviation, ...]:
    found = []
    std = np.sqrt(np.diag(covariance))
    for k, (recording, pretension, repeat) in enumerate(problem.pairs):
        column = problem.shared + 2 * k
        own = [
            Estimate.normal(float(x[column + j] * size), float(std[column + j] * size))
            for j, size in enumerate(problem.repeatability)
        ]
        found.append(Deviation(recording, pretension, repeat, own[0], own[1]))
    return tuple(found)


def _segments(problem: JointProblem, x: Array) -> tuple[JointSegment, ...]:
    found = []
    for swing, sieve, (rate, current) in zip(problem.swings, problem.sieves, problem.predicted(x), strict=True):
        begin = swing.recorded
        kept = np.zeros(swing.size, dtype=bool)
        kept[sieve.kept[0] : sieve.kept[-1] + 1] = True
        bias = float(np.mean((swing.gyro - rate)[kept]))
        found.append(
            JointSegment(
                recording=swing.recording,
                segment=swing.segment,
                kind=swing.kind,
                pretension_mm=swing.pretension_mm,
                frequency_hz=swing.frequency_hz,
                repeat=swing.repeat,
                time_s=np.arange(swing.size - begin, dtype=float) * np.float64(swing.sample_s),
                measured=swing.gyro[begin:],
                predicted=rate[begin:] + bias,
                kept=(kept & swing.present)[begin:],
                current_a=swing.current_a,
                predicted_current_a=current,
            )
        )
    return tuple(found)


def _repeats(problem: JointProblem) -> int:
    counts = [sum(pair[1] == pretension for pair in problem.pairs) for pretension in {p[1] for p in problem.pairs}]
    return max(counts)


def _rmse(segments: Sequence[JointSegment]) -> dict[str, float]:
    rates = np.concatenate([segment.residual[segment.kept] for segment in segments])
    currents = np.array([segment.current_a - segment.predicted_current_a for segment in segments])
    currents = currents[np.isfinite(currents)]
    of_current = float(np.sqrt(np.mean(currents**2))) if currents.size else float("nan")
    return {"gyro_rad_s": float(np.sqrt(np.mean(rates**2))), "tendon_current_a": of_current}


def _message(problem: JointProblem, solution: Solution) -> str:
    told = [solution.message]
    low, high = problem.bounds()
    for name, value, one, other in zip(problem.coordinates.names, solution.values, low, high, strict=False):
        if min(value - one, other - value) < _NEAR:
            told.append(f"{name} lies at a bound of the rig, so its interval cannot be trusted; widen the bounds")
    off = solution.values[problem.shared :]
    largest = float(np.abs(off).max(initial=0.0))
    if largest > 4:
        told.append(
            f"a repetition deviates by {largest:.1f} times the rig's stated repeatability; "
            "raise repeatability in the rig, or look for what changed between the repeats"
        )
    return "; ".join(told)


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
