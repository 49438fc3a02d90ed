"""Modes of a free decay: as many as swing in it and the data support."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from sinew.analysis.decay.decay_fit import (
    FreeOscillation,
    LikelihoodFit,
    fit_oscillation,
    pole_estimates,
    polynomials,
)
from sinew.analysis.decay.free_decay import block_means, find_peaks, free_decay
from sinew.analysis.decay.samples import read_samples
from sinew.analysis.signal.least_squares import solve_scaled
from sinew.measure.arrays import Array, Complexes
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import Estimate
from sinew.measure.result import Field, Result

Poles = list[tuple[complex, complex]]

_SHORTEST, _LONGEST = 100, 300  # columns of the pencil, a quarter of the samples: more tell little, and cost their cube
_EXTRA = (0, 2, 4, 8)  # poles beyond two a mode: rest, creep and noise take them
_STRONG = 10.0  # fall of Bayes' criterion that lets one more mode in,
_SURE = 4.0  # and its amplitude by its standard deviation
_QUARTERS = 4.0  # of the dominant half period: block means keep modes up to about eight times its frequency


@dataclass(frozen=True, repr=False)
class DecayMode(Result):
    """One mode of a decay: damped frequency_hz, natural_frequency_hz, damping_ratio, decay_rate_per_s.

    amplitude: at the start of the window, unit of the response; phase_rad: there, of A cos(ωt + phase).
    """

    frequency_hz: Annotated[Estimate, Field("frequency")]
    natural_frequency_hz: Annotated[Estimate, Field("", "detail")]
    damping_ratio: Annotated[Estimate, Field("damping ratio")]
    decay_rate_per_s: Annotated[Estimate, Field("decay rate")]
    amplitude: Annotated[Estimate, Field("amplitude", unit="[unit]")]
    phase_rad: Annotated[Estimate, Field("", "detail")]


@dataclass(frozen=True)
class ModalDecay:
    """A decay as a sum of modes about a rest position that may creep.

    modes: the largest amplitude first. covariance: of (λ_1, ω_1, λ_2, ...) in that order, shape (2m, 2m).
    bic: of each number of modes that was tried, by that number; the smallest number wins that no other beats by 10.
    creeps: whether the rest position has a relaxation beside its line.
    noise_std: of one sample; noise_coefficients: of its autoregression, empty where white. time_s, values, curve: of
        the window, shape (n,).
    message: a sentence on what to beware of, or empty.
    """

    modes: tuple[DecayMode, ...]
    covariance: Array
    bic: dict[int, float]
    creeps: bool
    noise_std: float
    noise_coefficients: Array
    time_s: Array
    values: Array
    curve: Array
    message: str


def fit_modes(
    time_s: ArrayLike,
    response: ArrayLike,
    *,
    drive: ArrayLike | None = None,
    unit: str = "",
    free_from_s: float | None = None,
    modes: int | None = None,
    most: int = 4,
    creeps: bool = False,
) -> ModalDecay:
    """Return the modes of the free decay in a record, each with its intervals.

    time_s, response, drive: shape (n,), even or nearly, the response in `unit`; free_from_s: where the decay is known
    to be free, else its start is sought.
    modes: how many; None lets Bayes' criterion choose up to `most`: one more must lower it by 10 and stand out of its
    own deviation four times. creeps: give the rest position an exponential relaxation beside its line.

    Start: matrix pencil at several orders; then maximum likelihood under autoregressive noise for all modes at once,
    so that the intervals know how alike two close modes are.
    Raises RecordingError where there is no free decay, samples of it are missing, or no mode is found in it.
    """
    samples = read_samples(time_s, response, drive, unit)
    t, x, clock = samples.even_s, samples.even, samples.clock_std
    begin = free_from_s if free_from_s is not None else free_decay(t, x, samples.drive)[0].start_s
    inside = t >= begin - 1e-9
    if samples.missing[inside].any():
        raise RecordingError(
            f"a decay is split into modes by all its samples, found: {'; '.join(samples.remarks)}; choose a stretch "
            "without that (--start, --stop), or leave the number of modes out"
        )
    if np.count_nonzero(inside) < 32:
        raise RecordingError(f"{np.count_nonzero(inside)} samples of free decay are too few for modes; record longer")
    half = find_peaks(t[inside], x[inside]).half_period_s
    t, x = block_means(t[inside], x[inside], half / _QUARTERS)
    counts = [modes] if modes is not None else list(range(1, most + 1))
    tried: dict[int, tuple[FreeOscillation, LikelihoodFit]] = {}
    chosen = 0
    for count in counts:
        fitted = _fit(t, x, count, creeps)
        if fitted is None:
            continue
        tried[count] = fitted
        if not chosen or (fitted[1].bic < tried[chosen][1].bic - _STRONG and _all_sure(*fitted)):
            chosen = count
        elif count > chosen + 1:
            break
    if not chosen:
        raise RecordingError("no decaying oscillation is found in the record; is it a free decay, sampled fast enough?")
    return _described(*tried[chosen], t, x, clock, {count: fit.bic for count, (_, fit) in tried.items()})


def _fit(t: Array, x: Array, count: int, creeps: bool) -> tuple[FreeOscillation, LikelihoodFit] | None:
    """Return model and fit with so many modes, or None where the pencil finds fewer."""
    window = float(t[-1] - t[0])
    s = (t - t[0]) / window
    model = FreeOscillation(s, (polynomials(s, 2),) * count, polynomials(s, 2), relaxing=creeps)
    if 2 * model.width > s.size:
        return None
    orders = tuple(2 * count + extra for extra in _EXTRA)
    tail = np.array([0.0, 0.0] + ([0.0, math.log(0.3)] if creeps else []))
    starts = []
    for poles in split_poles(x - x.mean(), float(t[1] - t[0]), orders):
        swinging = [(p, a) for p, a in poles if p.imag * window > 2.0 * math.pi and p.imag > -p.real]
        if len(swinging) >= count:  # what swings less than once is the rest position's
            starts.append(np.concatenate([_coefficients(swinging[:count], window), tail]))
    if not starts:
        return None
    best = min(starts, key=lambda start: _left_over(model, start, x))
    return model, fit_oscillation(model, [best], x)


def _coefficients(poles: Poles, window: float) -> Array:
    rows = [
        [math.log(max(abs(a), 1e-300)), math.atan2(a.imag, a.real), p.real * window, p.imag * window] for p, a in poles
    ]
    return np.array(rows).ravel()


def _left_over(model: FreeOscillation, start: Array, x: Array) -> float:
    """Return the sum of squares that a start leaves after its linear parameters are fitted."""
    columns = model.jacobian(start)[:, [k for k in range(start.size) if k % 4 < 2 or k >= model.rest_start]]
    left = x - columns @ solve_scaled(columns, x, 1e-10)
    return float(left @ left)


def _all_sure(model: FreeOscillation, fit: LikelihoodFit) -> bool:
    """Return whether every mode decays, swings once at least and has an amplitude that stands out of its deviation."""
    p, std = fit.parameters, np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    first = 4 * np.arange(len(model.bases))
    swings = (p[first + 3] > 2.0 * math.pi) & (p[first + 3] > -p[first + 2]) & (p[first + 2] < 0)
    return bool(np.all(std[first] < 1.0 / _SURE) and np.all(swings))


def _described(
    model: FreeOscillation, fit: LikelihoodFit, t: Array, x: Array, clock: float, bic: dict[int, float]
) -> ModalDecay:
    window, p, freedom = float(t[-1] - t[0]), fit.parameters, fit.degrees_of_freedom
    std = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    order = np.argsort(-p[: 4 * len(model.bases) : 4])
    turned = np.array([-1.0, 1.0]) / window  # of Re and Im c_1 into λ and ω
    found, places = [], []
    for m in order:
        first = 4 * int(m)
        here = [first + 2, first + 3]
        covariance = fit.covariance[np.ix_(here, here)] * np.outer(turned, turned)
        size = math.exp(min(float(p[first]), 300.0))
        phase = math.remainder(float(p[first + 1]), 2.0 * math.pi)
        found.append(
            DecayMode(
                **pole_estimates(p[here] * turned, covariance, freedom, clock),
                amplitude=Estimate.student(size, size * float(std[first]), freedom),
                phase_rad=Estimate.student(phase, float(std[first + 1]), freedom),
            )
        )
        places += here
    scale = np.tile(turned, len(found))
    said = []
    if not fit.converged:
        said.append("fit and noise did not settle; take the numbers as a start")
    if not _all_sure(model, fit):
        said.append("a mode does not stand out of its deviation, or is no decaying oscillation; ask for fewer modes")
    return ModalDecay(
        tuple(found),
        np.asarray(fit.covariance[np.ix_(places, places)] * np.outer(scale, scale)),
        bic,
        model.relaxing,
        fit.noise_std,
        fit.noise,
        t,
        x,
        x - fit.residual,
        "; ".join(said),
    )


# A sum of decaying oscillations is split into its poles without a guess, by the matrix pencil.


def split_poles(values: Array, step_s: float, orders: tuple[int, ...]) -> list[Poles]:
    """Return, for each order, (pole [1/s], amplitude) of the oscillations found, the most energetic first.

    values: shape (n,), evenly sampled, the rest position's mean taken off or not; orders: how many poles to split into,
    an oscillation taking two. Poles above the real axis that decay are returned; a real pole is a creeping rest.
    x(t) = Σ Re[a exp(pt)]. Hua and Sarkar, IEEE Trans. Acoust. Speech Signal Process. 38, 1990: eigenvalues of the
    shift between the dominant right singular vectors of the Hankel matrix of the samples.
    """
    n = values.size
    columns = min(n // 2, max(n // 4, _SHORTEST), _LONGEST)
    hankel = np.lib.stride_tricks.sliding_window_view(values, columns + 1)
    largest = columns + 1 - min(max(orders), columns), columns
    whole = np.ascontiguousarray(hankel)
    vectors = linalg.eigh(whole.T @ whole, subset_by_index=largest)[1][:, ::-1]  # right singular vectors, largest first
    found = []
    for order in orders:
        basis = vectors[:, : min(order, columns)]
        shift = np.linalg.lstsq(basis[:-1], basis[1:], rcond=None)[0]
        found.append(_energetic(np.linalg.eigvals(shift).astype(complex), values, step_s))
    return found


def _energetic(steps: Complexes, values: Array, step_s: float) -> Poles:
    steps = steps[(np.abs(steps) > 1e-6) & (np.abs(steps) < 1.05)]
    if steps.size == 0:
        return []
    pole = np.log(steps) / step_s
    courses = np.exp(np.outer(np.arange(values.size) * step_s, pole))
    amplitude = np.linalg.lstsq(courses, values.astype(complex), rcond=None)[0]
    energy = (np.abs(courses) ** 2).sum(axis=0) * np.abs(amplitude) ** 2
    order = np.argsort(-energy)
    return [
        (complex(pole[k]), complex(2.0 * amplitude[k]))
        for k in order
        if pole[k].imag > 1e-6 / step_s and pole[k].real < 0
    ]
