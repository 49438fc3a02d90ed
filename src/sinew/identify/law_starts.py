"""This is where the search for a damping law begins: at a smaller model's fit, or beside a minimum of friction."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sinew.identify.fitted import Fit
from sinew.identify.layout import Entry, Layout, Part, make_layout
from sinew.identify.least_squares import Problem, Solution, solve

__all__ = ["beside_friction", "carried_over", "dry_starts", "remembering_starts"]

Array = NDArray[np.float64]
Masks = Sequence[NDArray[np.bool_]]

_LARGE = 0.1  # of the largest output: motion that dry friction does not bring to rest
_AMPLITUDES = (0.2, 0.45)  # of the largest: where friction takes over a share of the work
_SHARES = (0.05, 0.2, 0.4, 0.6, 0.8, 0.95)
_TRIED = 2  # of the splits between friction and viscous damping are followed
_ASIDE, _LEAST_ASIDE = 2.0, 0.03  # standard deviations; of the friction
_ROUNDS = 3
_LEAST_GAIN = 1e-3  # of the residuals' variance
_LOSS_FACTORS = (1e-3, 0.8)
_RESTING = ("start", "start_rate", "offset", "drift", "creep_time")


def carried_over(layout: Layout, first: Array, smaller: Fit) -> Array:
    """Return where a search begins if it knows what a smaller model's fit to the same records found, shape (m,).

    layout: of the larger model, in the scales of the smaller one's. first: where it would begin else. A viscous fit
    gives a loss factor its damping, and dry friction nothing.
    """
    found = {_key(entry): value for entry, value in zip(smaller.layout.entries, smaller.solution.values, strict=True)}
    x = first.copy()
    same_rest = smaller.model.rest == layout.model.rest
    for k, entry in enumerate(layout.entries):
        if entry.local in _RESTING and not same_rest:
            continue
        if _key(entry) in found:
            x[k] = found[_key(entry)]
        elif entry.local == "loss_factor":
            damping = found.get(("damping", entry.group, entry.record), found.get(("damping", "", -1), 0.0))
            x[k] = _loss_factor(damping, found, entry)
        elif entry.local in ("coulomb", "quadratic", "cubic"):
            x[k] = 0.0
    return x


def _key(entry: Entry) -> tuple[str, str, int]:
    return entry.local, entry.group, entry.record


def _loss_factor(damping: float, found: dict[tuple[str, str, int], float], entry: Entry) -> float:
    stiffness = found.get(("stiffness", entry.group, entry.record), found.get(("stiffness", "", -1), 1.0))
    return float(np.clip(damping / np.sqrt(max(stiffness, 1e-3)), *_LOSS_FACTORS))


def remembering_starts(layout: Layout, first: Array, masks: Masks, taught: Array | None) -> list[Array]:
    """Return the starts of a search for a loss factor: of a decay the viscous fit, let go after a drive or a rest.

    taught: what `carried_over` said of a smaller model; where it is None the viscous fit is made.
    """
    memory = np.array([entry.local == "memory" for entry in layout.entries])
    if not memory.any():
        return [first] if taught is None else [taught, first]
    x = _from_viscous(layout, first, masks) if taught is None else taught
    return [x, np.where(memory, 1.0, x), first]


def _from_viscous(layout: Layout, first: Array, masks: Masks) -> Array:
    at = {_key(entry): k for k, entry in enumerate(layout.entries)}
    viscous = make_layout(replace(layout.model, damping="viscous"), layout.parts)
    same = [(entry.local.replace("damping", "loss_factor"), entry.group, entry.record) for entry in viscous.entries]
    if not all(key in at for key in same):
        return first
    whose = [at[key] for key in same]
    bent = np.array([entry.local in layout.model.terms for entry in viscous.entries])
    starts = [first[whose], np.where(bent, 0.0, first[whose])] if bent.any() else [first[whose]]
    values = solve(viscous.problem(masks), *starts, tolerance=1e-6, max_evaluations=60).values
    found = {_key(entry): value for entry, value in zip(viscous.entries, values, strict=True)}
    x = first.copy()
    x[whose] = values
    for k, entry in enumerate(layout.entries):
        if entry.local == "loss_factor":
            x[k] = _loss_factor(float(x[k]), found, entry)
    return x


def dry_starts(layout: Layout, first: Array, masks: Masks, taught: Array | None) -> list[Array]:
    """Return the start of a search with dry friction, whose sum of squares jumps where the motion comes to rest.

    It is smooth as long as the motion is large, so that part is fitted first: the damping without friction is divided
    between both in many ways, of equal work at one amplitude (4 c r = π d ω r²), and the best are followed.
    """
    coulomb, damping, stiffness = (_all_of(layout, name) for name in ("coulomb", "damping", "stiffness"))
    moving = [m & _large(part) for part, m in zip(layout.parts, masks, strict=True)]
    if sum(int(m.sum()) for m in moving) <= 2 * first.size:
        moving = list(masks)
    base = taught
    if base is None:
        base = first.copy()
        base[coulomb] = 0.0
        viscous = replace(layout, model=replace(layout.model, damping="viscous"))
        base = solve(viscous.problem(moving), base, tolerance=1e-6, max_evaluations=60).values
    turning = 0.25 * np.pi * np.sqrt(max(float(np.median(base[stiffness])), 1e-3))
    starts = [base] if np.any(base[coulomb] != 0.0) else []
    for amplitude in _AMPLITUDES:
        whole = float(np.median(np.abs(base[damping]))) + float(np.median(base[coulomb])) / (turning * amplitude)
        for share in _SHARES:
            starts.append(base.copy())
            starts[-1][coulomb] = turning * amplitude * share * whole
            starts[-1][damping] = (1.0 - share) * whole
    problem = layout.problem(moving)
    left = [_sum_of_squares(problem.residual(start)) for start in starts]
    best = [starts[k] for k in np.argsort(left)[:_TRIED]]
    return [solve(problem, *best, tolerance=1e-4, max_evaluations=15).values]


def _all_of(layout: Layout, local: str) -> NDArray[np.intp]:
    return np.flatnonzero([entry.local == local for entry in layout.entries])


def _sum_of_squares(residual: Array) -> float:
    with np.errstate(over="ignore"):
        return float(residual @ residual) if np.isfinite(residual).all() else np.inf


def _large(part: Part) -> NDArray[np.bool_]:
    """Return the samples up to the last at which the output is a tenth of its largest."""
    output = part.record.output - np.median(part.record.output)
    last = int(np.flatnonzero(np.abs(output) > _LARGE * np.abs(output).max())[-1])
    return np.arange(output.size) <= last


def beside_friction(layout: Layout, problem: Problem, found: Solution) -> Solution:
    """Return the best solution with dry friction, sought on both sides of the one that was found, too.

    Samples that pass from sliding to rest leave small steps in the sum of squares, and a search from one side ends at
    the first of them: of 40 noisy decays in four a better minimum lay up to three standard deviations further.
    """
    for k in map(int, _all_of(layout, "coulomb")):
        for _ in range(_ROUNDS):
            variance = found.sum_of_squares / max(found.degrees_of_freedom, 1)
            aside = _along(found, k, variance)
            if aside is None:
                break
            other = solve(problem, found.values - aside, found.values + aside, tolerance=1e-6, max_evaluations=20)
            if other.sum_of_squares >= found.sum_of_squares - _LEAST_GAIN * variance:
                break
            found = other
    return found


def _along(found: Solution, k: int, variance: float) -> Array | None:
    """Return the step aside of number k with which the others lean along, shape (m,); None where nothing tells it."""
    own, rest = found.jacobian[:, k], np.delete(found.jacobian, k, axis=1)
    size = np.maximum(np.linalg.norm(rest, axis=0), 1e-300)
    lean = -np.linalg.lstsq(rest / size, own, rcond=1e-8)[0] / size
    left = float(np.linalg.norm(own + rest @ lean))
    if not left > 0 or not np.isfinite(lean).all():
        return None
    step = max(_ASIDE * float(np.sqrt(variance)) / left, _LEAST_ASIDE * abs(float(found.values[k])))
    return np.asarray(step * np.insert(lean, k, 1.0))
