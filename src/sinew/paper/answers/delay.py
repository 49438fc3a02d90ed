"""The delay that would explain the phase: one extra delay, fitted to the measured response.

The dynamic stiffness over the inertia follows from the response H (torsion over measured lever angle, lag negative) as

    K(A) + j S(A, ω) = ω² + γ ω² exp(-jωτ)/H,

γ being the lever's share of the inertia and τ how much later than the written delay budget says the torsion was
recorded. K is a polynomial of the amplitude A, for a joint that hardens or whose friction gives way, and grows with
ln ω as the stiffness of a lossy solid does; S is a polynomial of A too, for losses that do not depend on frequency,
plus a part in proportion to ω for viscous ones, which cannot be negative. A delay shows where the joint itself cannot:
far above the resonance the lever's inertia is all there is, and a lag beyond 180° grows as ω τ.
"""

import math
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import least_squares

from sinew.analysis.signal.repeats import pool_repeats
from sinew.analysis.signal.signals import DelayBudget, delay_budget, torsion_delay
from sinew.identify.joint.fit import JointFit
from sinew.measure.arrays import Array
from sinew.measure.estimate import NORMAL_90, Estimate
from sinew.paper.answers.answer import CANNOT_TELL, Answer, Cell, cannot_tell, in_words
from sinew.plan.rig import RigSpec

NAME = "delay"
QUESTION = "Which delay would explain the phase? (sections 5.2.5 and 5.3)"
_FEWEST = 8
_FIRST = 4  # unknowns before the polynomials
_SCALE_S = 1e-3
_DELAY = "imu.residual_delay"
_LONGEST_S = 0.05  # of an extra delay: beyond it the phase is no delay


class _Curve(NamedTuple):
    """One response: angular frequency, complex response, amplitude over its largest (zero where unknown), (f,)."""

    omega: Array
    response: NDArray[np.complex128]
    amplitude: Array


def answer_delay(
    results: xr.Dataset, recording: xr.Dataset, rig: RigSpec | None = None, joint: JointFit | None = None
) -> Answer:
    """Return the extra delay of the torsion behind the lever that the phase asks for, beside the written budget.

    results: of a sweep with a measured drive. recording: whose sample rate the budget needs. rig: with the budget that
    `phase_lag_rad` of the results is corrected by; None where nothing was corrected. joint: a tendon joint fitted to
    the recording from this rig on, whose own delay is told beside.

    Numbers: `extra_delay_s`, over all pretensions, the scatter between them in its interval; `budget_s`, what was
    corrected at 3 Hz, with its own uncertainty; `total_delay_s`; `extra_delay_of_joint_s`, of `joint`. Rows: the same
    by pretension; `delay_for_90_s`: what would bring the lag to 90° at the largest gain by measured drive; `misfit`.
    """
    if "phase_lag_rad" not in results:
        return cannot_tell(NAME, QUESTION, "The recording holds no sweep; a delay shows in the phase of one.")
    if not np.isfinite(results["phase_lag_rad"].values).any():
        return cannot_tell(
            NAME, QUESTION, "The drive was not measured, so there is no phase; record the lever's angle."
        )
    budget = delay_budget(recording, rig)
    pretensions, delays, misfits = _all_delays(results)
    if not pretensions:
        return cannot_tell(
            NAME, QUESTION, f"A delay needs {_FEWEST} frequencies on both sides of a resonance at one pretension."
        )
    pooled = pool_repeats([[d for d, _ in row] for row in delays], [[s for _, s in row] for row in delays])
    means = np.array([one.value for one in pooled.estimates])
    extra = _overall(means, pooled.std / math.sqrt(max(len(delays[0]), 1)))
    written = torsion_delay(budget, 3.0) - budget.drive_delay_s
    known = Estimate.normal(written, budget.delay_std_s)
    numbers = {
        "extra_delay_s": extra,
        "budget_s": known,
        "total_delay_s": Estimate(written + extra.value, extra.std, written + extra.low, written + extra.high),
    }
    of_joint = _of_joint(rig, joint)
    if of_joint is not None:
        numbers["extra_delay_of_joint_s"] = of_joint
    crossing = _delay_for_90(results)
    rows: list[dict[str, Cell]] = []
    for i, p in enumerate(pretensions):
        row: dict[str, Cell] = {
            "pretension_mm": float(results["pretension_mm"].values[p]),
            "extra_delay_s": pooled.estimates[i],
            "misfit": misfits[i],
        }
        if math.isfinite(crossing[p]):
            row["delay_for_90_s"] = float(crossing[p])
        rows.append(row)
    verdict, said = _judge(extra, budget, written)
    words = (said, *_joint_words(of_joint), *_details(extra, written, crossing, misfits))
    return Answer(NAME, QUESTION, verdict, words, numbers, tuple(rows))


def _of_joint(rig: RigSpec | None, joint: JointFit | None) -> Estimate | None:
    """Return how much longer than the rig's the fitted joint's sensor delay is [s]."""
    if rig is None or joint is None or _DELAY not in joint.parameters:
        return None
    fitted, written = joint.parameters[_DELAY], rig.imu.residual_delay.value
    return Estimate(fitted.value - written, fitted.std, fitted.low - written, fitted.high - written)


def _joint_words(of_joint: Estimate | None) -> list[str]:
    if of_joint is None:
        return []
    return [
        f"The fitted tendon joint, which knows the form of its friction, asks for {in_words(of_joint, 1e3, 'ms')}; its "
        "interval holds for a joint of that form only."
    ]


def _all_delays(results: xr.Dataset) -> tuple[list[int], list[list[tuple[float, float]]], list[float]]:
    """Return of the pretensions that have one: place, (delay, std) [s] of each repeat, and the largest misfit."""
    gain, lag = (results[name].values for name in ("gain_measured_drive", "phase_lag_rad"))
    amplitude = results["amplitude_rad"].values if "amplitude_rad" in results else np.full_like(gain, np.nan)
    omega = 2.0 * np.pi * results["frequency_hz"].values
    places, delays, misfits = [], [], []
    for p in range(gain.shape[0]):
        found, worst = [], 0.0
        for r in range(gain.shape[2]):
            good = np.isfinite(gain[p, :, r]) & np.isfinite(lag[p, :, r]) & (gain[p, :, r] > 0)
            if np.count_nonzero(good) < _FEWEST or not _spans_resonance(lag[p, good, r]):
                continue
            swing = np.nan_to_num(amplitude[p, good, r])
            swing = swing / swing.max() if swing.max() > 0 else swing
            curve = _Curve(omega[good], gain[p, good, r] * np.exp(-1j * lag[p, good, r]), swing)
            delay, std, misfit = _fit_delay(curve)
            found.append((delay, std))
            worst = max(worst, misfit)
        if found:
            places.append(p)
            delays.append(found)
            misfits.append(worst)
    return places, delays, misfits


def _spans_resonance(lag: Array) -> bool:
    return bool(lag.min() < 0.5 * np.pi < lag.max())


def _fit_delay(curve: _Curve) -> tuple[float, float, float]:
    """Return the extra delay of one response, its standard deviation [s], and the relative rmse that is left.

    Unknowns: the lever's share, the delay [ms], the viscous loss and the stiffness' growth with ln ω (both at least
    zero, else they would pass for a delay), the polynomials of stiffness and loss.
    """
    centre = float(curve.omega[np.argmax(np.abs(curve.response))])
    x = curve.omega / centre
    powers = _powers(curve)
    split = _FIRST + powers.shape[1]

    def residual(theta: Array) -> Array:
        stiffness = powers @ theta[_FIRST:split] + theta[3] * np.log(x)
        loss = powers @ theta[split:] + theta[2] * x
        late = np.exp(-1j * curve.omega * theta[1] * _SCALE_S)
        off = theta[0] * x**2 * late / (stiffness + 1j * loss - x**2) / curve.response - 1.0
        return np.concatenate([off.real, off.imag])

    begin = _begin(curve, x, powers)
    low, high = np.full(begin.size, -np.inf), np.full(begin.size, np.inf)
    low[1], high[1] = -_LONGEST_S / _SCALE_S, _LONGEST_S / _SCALE_S
    low[2:_FIRST] = 0.0
    found = least_squares(residual, begin, bounds=(low, high), x_scale="jac", max_nfev=300)
    free = (found.x - low > 1e-6) | ~np.isfinite(low)
    free[1] = True
    seen = np.asarray(found.jac)[:, free]
    scale = float(found.fun @ found.fun) / max(found.fun.size - seen.shape[1], 1)
    covariance = np.linalg.pinv(seen.T @ seen) * scale
    misfit = math.sqrt(2.0 * float(np.mean(found.fun**2)))
    return float(found.x[1]) * _SCALE_S, math.sqrt(max(float(covariance[1, 1]), 0.0)) * _SCALE_S, misfit


def _powers(curve: _Curve) -> Array:
    """Return the columns of a polynomial of the amplitude, (f, 1 to 3): as many as the points can pay for."""
    room = 1 if not curve.amplitude.any() else 2 if curve.omega.size < 2 * _FEWEST else 3
    return np.stack(
        [(2.0 * curve.amplitude - 1.0) ** k if k else np.ones_like(curve.omega) for k in range(room)], axis=1
    )


def _begin(curve: _Curve, x: Array, powers: Array) -> Array:
    """Return where the search begins: the equation above is linear without a delay."""
    inverse = x**2 / curve.response
    few = np.ones((x.size, 1))
    rows = np.concatenate(
        [
            np.concatenate([-inverse.real[:, None], few, np.zeros_like(few)], axis=1),
            np.concatenate([-inverse.imag[:, None], np.zeros_like(few), few], axis=1),
        ]
    )
    target = np.concatenate([x**2, np.zeros_like(x)])
    weight = np.tile(np.abs(curve.response) / x**2, 2)
    share, stiffness, loss = np.linalg.lstsq(rows * weight[:, None], target * weight, rcond=None)[0]
    begin = np.zeros(_FIRST + 2 * powers.shape[1])
    begin[2:_FIRST] = 1e-3
    begin[0], begin[_FIRST], begin[_FIRST + powers.shape[1]] = share, stiffness, max(float(loss), 1e-3)
    return begin


def _overall(means: Array, noise: float) -> Estimate:
    """Return the mean over pretensions. What differs between them by more than noise is the model's misfit, no chance:
    it is counted in full, not divided by the root of their number."""
    count = means.size
    scatter = float(means.std(ddof=1)) if count > 1 else 0.0
    misfit = math.sqrt(max(scatter**2 - noise**2, 0.0))
    return Estimate.normal(float(means.mean()), math.hypot(noise / math.sqrt(count), misfit))


def _delay_for_90(results: xr.Dataset) -> Array:
    """Return what delay would bring the lag to 90° at the largest gain by measured drive [s], by pretension."""
    if "resonance_measured_drive_hz" not in results:
        return np.full(results.sizes["pretension_mm"], np.nan)
    lag = np.asarray(results["phase_lag_rad"].values, dtype=float)
    frequency = np.asarray(results["frequency_hz"].values, dtype=float)
    found = np.full(lag.shape[0], np.nan)
    for p, at in enumerate(results["resonance_measured_drive_hz"].values):
        some = np.isfinite(lag[p]).any(axis=1)
        if math.isfinite(at) and some.any():
            here = float(np.interp(at, frequency[some], np.nanmean(lag[p][some], axis=1)))
            found[p] = (here - 0.5 * np.pi) / (2.0 * np.pi * at)
    return found


def _judge(extra: Estimate, budget: DelayBudget, written: float) -> tuple[str, str]:
    told = in_words(extra, 1e3, "ms")
    reach = math.hypot(0.5 * (extra.high - extra.low), NORMAL_90 * budget.delay_std_s)
    if not math.isfinite(reach):
        return CANNOT_TELL, "One response at one pretension leaves the delay without an interval; measure more."
    if written > 0 and reach > written:
        return CANNOT_TELL, (
            f"The phase asks for an extra delay of {told}, an interval wider than the written budget of "
            f"{1e3 * written:.1f} ms itself; measure more frequencies far above the resonance."
        )
    if abs(extra.value) <= reach:
        if written == 0:
            return "none", f"No delay is needed: the phase asks for {told}."
        return "the written budget", (
            f"The written budget of {1e3 * written:.1f} ms ± {1e3 * budget.delay_std_s:.1f} ms explains the phase: "
            f"what it leaves is {told}."
        )
    what = "beyond the written budget" if written > 0 else "with no budget written"
    return "an extra delay", f"A delay of {told} {what} would explain the phase."


def _details(extra: Estimate, written: float, crossing: Array, misfits: list[float]) -> list[str]:
    words = []
    if written > 0:
        words.append(
            f"Uncorrected, the torsion is recorded {1e3 * (written + extra.value):.1f} ms after the lever, which is "
            f"{360 * 3 * (written + extra.value):.0f}° of phase at 3 Hz."
        )
    known = crossing[np.isfinite(crossing)]
    if known.size:
        low, high = (f"{1e3 * x:+.1f}".replace("-", "−") for x in (known.min(), known.max()))
        words.append(
            f"To bring the lag to 90° at the largest gain it would take {low} to {high} ms; that is no measure of a "
            "delay, since in a damped or anharmonic joint the two do not fall together."
        )
    words.append(
        "The model allows stiffness and losses that change with amplitude, and losses with and without dependence on "
        f"frequency; it leaves up to {100 * max(misfits):.2g} % of the response unexplained."
    )
    return words
