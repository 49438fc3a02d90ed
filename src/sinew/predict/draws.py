"""This is where rigs are drawn from what is known of a calibrated one: its parameters, as they vary together.

The parameters of the rig's `[calibration]` table are drawn from their joint normal distribution. Parameters with a 90 %
interval that the table does not name are drawn independently, with the interval's half width over 1.645 as standard
deviation. A draw in which a parameter lies outside its bounds is drawn again.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sinew.measure.errors import SpecError
from sinew.plan.parameter import Parameter
from sinew.plan.rig import RigSpec

__all__ = ["Draws", "carried_over", "draw_rigs", "spread_of"]

Array = NDArray[np.float64]

_NINETY = 1.6448536269514722
_TIMES = 200
_NEGATIVE = 1e-4


class Draws(NamedTuple):
    """Rigs that are as likely as the calibration says. names: of the k parameters that vary. values: (draw, k), SI.
    remarks: sentences on what to know of them."""

    rigs: tuple[RigSpec, ...]
    names: tuple[str, ...]
    values: Array
    remarks: tuple[str, ...]


def spread_of(rig: RigSpec) -> tuple[tuple[str, ...], Array]:
    """Return (dotted names of the parameters that vary, their covariance (k, k) in SI).

    Raises SpecError where nothing is known to vary, or where the correlations contradict each other.
    """
    table, known = dict(rig.parameters()), rig.calibration
    joint = () if known is None else known.parameters
    alone = [name for name, one in table.items() if one.interval90 is not None and name not in joint]
    names = (*joint, *alone)
    if not names:
        raise SpecError(
            f"the rig {rig.name} holds no intervals, so nothing is known of how far it can be off; give one that "
            "sinew calibrate wrote"
        )
    covariance = np.zeros((len(names), len(names)))
    if known is not None:
        lower = np.zeros((len(joint), len(joint)))
        for i, row in enumerate(known.correlation):
            lower[i, : i + 1] = row
        whole = lower + np.tril(lower, -1).T
        if np.linalg.eigvalsh(whole)[0] < -_NEGATIVE:
            raise SpecError(
                f"the correlations in [calibration] of the rig {rig.name} contradict each other (an eigenvalue is "
                "negative); calibrate anew, or take the table out"
            )
        covariance[: len(joint), : len(joint)] = np.outer(known.std, known.std) * whole
    for i, name in enumerate(alone, start=len(joint)):
        low, high = table[name].interval90 or (np.nan, np.nan)
        covariance[i, i] = ((high - low) / (2 * _NINETY)) ** 2
    return names, covariance


def draw_rigs(rig: RigSpec, count: int, seed: int) -> Draws:
    """Return `count` rigs drawn about a calibrated one; the same seed gives the same rigs.

    Raises SpecError as `spread_of`, and where hardly any draw lies inside the parameters' bounds.
    """
    names, covariance = spread_of(rig)
    table = dict(rig.parameters())
    centre = np.array([table[name].value for name in names])
    low, high = (np.array([table[name].bounds[i] for name in names]) for i in (0, 1))
    rng = np.random.default_rng(seed)
    factor, kept, tried = _factor(covariance), np.zeros((0, len(names))), 0
    room = 1e-9 * (high - low)
    while len(kept) < count:
        tried += count
        if tried > _TIMES * count:
            raise SpecError(
                f"hardly any draw of the rig {rig.name} lies inside the bounds of its parameters; calibrate from "
                "recordings that tell more, or widen the bounds"
            )
        some = centre + rng.standard_normal((count, len(names))) @ factor.T
        inside = np.all((some >= low - room) & (some <= high + room), axis=1)
        kept = np.concatenate([kept, some[inside]])
    kept = np.clip(kept[:count], low, high)
    return Draws(tuple(_moved(rig, names, row) for row in kept), names, kept, tuple(_remarks(rig, table, tried, count)))


def carried_over(base: RigSpec, rig: RigSpec) -> tuple[RigSpec, tuple[str, ...]]:
    """Return (a rig that was made from a calibrated one, with what is still known of it; what is no longer known).

    Parameters that have kept their value and its origin keep their uncertainty. Dotted names of those that have not are
    returned: they are what the design says, and are taken as certain, unless they have an interval of their own.
    """
    before, after = dict(base.parameters()), dict(rig.parameters())
    known, old = base.calibration, [name for name, one in before.items() if one.interval90 is not None]
    names = dict.fromkeys((*old, *(known.parameters if known is not None else ())))
    kept = [
        name for name in names if (after[name].value, after[name].origin) == (before[name].value, before[name].origin)
    ]
    intervals = {name: {"interval90": before[name].interval90} for name in kept}
    parts: dict[str, object] = {}
    for part in {name.split(".")[0] for name in kept}:
        mine = {name.split(".")[1]: row for name, row in intervals.items() if name.startswith(f"{part}.")}
        section = getattr(rig, part)
        parts[part] = section.model_copy(
            update={name: getattr(section, name).model_copy(update=row) for name, row in mine.items()}
        )
    parts["calibration"] = None if known is None else known.only(kept)
    certain = tuple(name for name in names if name not in kept and after[name].interval90 is None)
    return rig.model_copy(update=parts), certain


def _factor(covariance: Array) -> Array:
    """Return F with F Fᵀ = covariance, (k, k); what rounding made negative counts as zero."""
    std = np.sqrt(np.diag(covariance))
    safe = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(safe, safe))
    return np.asarray(std[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def _remarks(rig: RigSpec, table: dict[str, Parameter], tried: int, count: int) -> list[str]:
    told = []
    if rig.calibration is None:
        told.append(
            "the rig has intervals but no [calibration] table, so its parameters were drawn independently and the "
            "bands are too wide where they are known better together; calibrate it anew"
        )
    fixed = [name for name, one in table.items() if one.origin == "assumed" and one.bounds[0] < one.bounds[1]]
    told.append(f"{len(fixed)} assumed parameters are held at their values; the bands say nothing of them")
    if tried > 2 * count:
        told.append("more than half of the draws lay outside the bounds of the parameters and were drawn again")
    return told


def _moved(rig: RigSpec, names: tuple[str, ...], values: Array) -> RigSpec:
    """Return the rig with other values, without intervals and calibration of its own."""
    parts: dict[str, dict[str, Parameter]] = {}
    for dotted, value in zip(names, values.tolist(), strict=True):
        part, name = dotted.split(".")
        old = getattr(getattr(rig, part), name)
        parts.setdefault(part, {})[name] = old.model_copy(update={"value": value, "interval90": None})
    moved: dict[str, object] = {part: getattr(rig, part).model_copy(update=rows) for part, rows in parts.items()}
    return rig.model_copy(update={**moved, "calibration": None})
