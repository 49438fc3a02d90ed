"""A model: a law of its motion, what its rest does, how its numbers are called, and their layout in a search."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sinew.identify.oscillator.least_squares import Problem
from sinew.identify.oscillator.record import Excitation, Frame, Record, Scales, derivative_order, grid_of
from sinew.identify.oscillator.track import LOCAL, PLACE, Grid, track, track_slopes
from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import SpecError
from sinew.mechanics.laws import (
    HISTORIES,
    BoucWen,
    Cubic,
    Drag,
    DryFriction,
    Law,
    Linear,
    LossFactor,
    Pendulum,
    Quadratic,
    Viscous,
)

Rest = Literal["offset", "drift", "creep"]


@dataclass(frozen=True)
class Model:
    """One degree of freedom: r'' + law = input.

    name: what the command line calls it. law: the sum of its terms.
    rest: what the rest position does during the record: an offset, a linear drift, or an exponential creep.
    """

    name: str
    law: Law
    rest: Rest = "offset"

    def resting(self, rest: Rest) -> "Model":
        """Return the same model with another rest position."""
        return replace(self, rest=rest)

    def damped(self, losses: Law) -> "Model":
        """Return the same model with other losses."""
        return replace(self, law=self.law.springs + losses)

    def mechanics(self, excitation: Excitation) -> tuple[str, ...]:
        """Return the names (of `LOCAL`) of its mechanical numbers under an excitation."""
        return tuple(n.name for n in self.law.numbers) + (() if excitation == "none" else ("gain",))

    def nuisance(self, excitation: Excitation) -> tuple[str, ...]:
        """Return the names (of `LOCAL`) of the numbers that every record has for itself."""
        more = {"offset": (), "drift": ("drift",), "creep": ("drift", "creep_time")}
        return ("start", "start_rate", "offset", *more[self.rest], *self.law.histories(excitation == "none"))


VISCOUS = Law((Viscous(),))
"""The plainest loss, which other laws are held against."""

MODELS: dict[str, Model] = {
    name: Model(name, law)
    for name, law in {
        "linear": Linear() + Viscous(),
        "loss-factor": Linear() + LossFactor(),
        "coulomb": Linear() + Viscous() + DryFriction(),
        "cubic": Linear() + Viscous() + Cubic(),
        "cubic-quadratic": Linear() + Viscous() + Quadratic() + Cubic(),
        "loss-factor-cubic": Linear() + LossFactor() + Cubic(),
        "loss-factor-cubic-quadratic": Linear() + LossFactor() + Quadratic() + Cubic(),
        "coulomb-cubic": Linear() + Viscous() + DryFriction() + Cubic(),
        "coulomb-cubic-quadratic": Linear() + Viscous() + DryFriction() + Quadratic() + Cubic(),
        "pendulum": Pendulum() + Viscous(),
        "coulomb-pendulum": Pendulum() + Viscous() + DryFriction(),
        "bouc-wen": Linear() + Viscous() + BoucWen(),
        "bouc-wen-cubic": Linear() + Viscous() + BoucWen() + Cubic(),
        "drag": Linear() + Viscous() + Drag(),
        "drag-cubic": Linear() + Viscous() + Drag() + Cubic(),
        "drag-cubic-quadratic": Linear() + Viscous() + Drag() + Quadratic() + Cubic(),
        "drag-pendulum": Pendulum() + Viscous() + Drag(),
    }.items()
}


def get_model(name: str) -> Model:
    """Return the model of this name. Raises SpecError with the names there are."""
    if name == "tendon":
        raise SpecError(
            "model tendon is a rig's and is fitted to its recording (sinew.identify.joint.fit); choose cubic or auto"
        )
    if name not in MODELS:
        raise SpecError(f"model is {name!r}, expected auto or one of {', '.join(MODELS)}")
    return MODELS[name]


def parameter_name(local: str, excitation: Excitation, motion_unit: str, input_unit: str) -> str:
    """Return the name, with its unit, of a mechanical number divided by the inertia.

    `stiffness_per_s2` is k/I, `cubic_per_s2_rad2` is k₃/I, `coulomb_rad_per_s2` is the friction torque over I;
    a lever's `lever_inertia_ratio` is I_l/I. input_unit: of the input's motion for a base or lever.
    """
    unit, given = _token(motion_unit), _token(input_unit)
    if local == "gain" and unit == given:
        return {"lever": "lever_inertia_ratio", "base": "base_gain"}.get(excitation, "input_gain_per_s2")
    if local == "gain" and excitation in ("lever", "base"):
        return "_".join(filter(None, (f"{excitation}_gain", unit, "per" if given else "", given)))
    if local == "gain":
        return "_".join(filter(None, ("input_gain", unit, "per_s2", given)))  # 1/I where unit over unit is 1/I's
    return LOCAL[local].over_inertia(unit)


def _token(unit: str) -> str:
    return "" if unit == "1" else re.sub(r"[^a-z0-9]+", "_", unit.lower()).strip("_")


# The numbers that a search moves are laid out over one or several records.
#
# Mechanical numbers are shared by all records, or belong to a group of them (a pretension); each record has its own
# start and rest position. A search sees one vector in normal form, near one; every record sees the numbers of `LOCAL`.

_LINEAR_CREEP = 6.0  # of `creep_time`: the drift is a straight line


@dataclass(frozen=True)
class Part:
    """One record, ready to be simulated.

    kept: which of its samples the search sees, shape (n,). unit_size: A ω_r^order, the normal form of the output.
    """

    record: Record
    scales: Scales
    grid: Grid
    samples: NDArray[np.intp]
    kept: Mask
    order: int
    unit_size: float
    fixed: Array


@dataclass(frozen=True)
class Entry:
    """One number of the search: its name in `LOCAL`, and the group or record it belongs to (-1, "": all of them)."""

    local: str
    group: str = ""
    record: int = -1

    def label(self) -> str:
        """Return what tells it from its namesakes."""
        return f"[{self.group}]" if self.group else f"[{self.record}]" if self.record >= 0 else ""


@dataclass(frozen=True)
class Layout:
    """Which number goes where.

    entries: of the vector x, m of them. index, column, ratio: for each part, which of x it takes, which of `LOCAL`
    they are, and the factor between the two normal forms.
    """

    model: Model
    parts: tuple[Part, ...]
    entries: tuple[Entry, ...]
    index: tuple[NDArray[np.intp], ...]
    column: tuple[NDArray[np.intp], ...]
    ratio: tuple[Array, ...]

    def local(self, x: Array, part: int) -> Array:
        """Return the numbers of `LOCAL` of one part, shape (local,)."""
        p = self.parts[part].fixed.copy()
        p[self.column[part]] = x[self.index[part]] * self.ratio[part]
        return p

    def outputs(self, x: Array) -> list[Array]:
        """Return what every part would measure at its samples, in normal form."""
        return [self._track(x, i, part.record.size) for i, part in enumerate(self.parts)]

    def _track(self, x: Array, i: int, end: int) -> Array:
        part = self.parts[i]
        samples = part.samples[:end]
        found = track(self.local(x, i), part.grid, self.model.law, part.order, int(samples[-1]))
        return np.asarray(found[samples])

    def problem(self, seen: Sequence[Mask]) -> Problem:
        """Return the least-squares problem over the samples that are seen, one mask for each part."""
        ends = [int(np.flatnonzero(mask)[-1]) + 1 if mask.any() else 1 for mask in seen]
        masks = [mask[:end] for mask, end in zip(seen, ends, strict=True)]
        wanted = [part.record.output[:end] / part.unit_size for part, end in zip(self.parts, ends, strict=True)]

        def residual(x: Array) -> Array:
            return np.concatenate([(self._track(x, i, ends[i]) - wanted[i])[mask] for i, mask in enumerate(masks)])

        def jacobian(x: Array) -> Array:
            return np.concatenate([self._slopes(x, i, ends[i])[mask] for i, mask in enumerate(masks)])

        return Problem(residual, jacobian)

    def _slopes(self, x: Array, i: int, end: int) -> Array:
        part = self.parts[i]
        p, samples = self.local(x, i), part.samples[:end]
        slopes = track_slopes(p, self.column[i], part.grid, self.model.law, part.order, int(samples[-1]))
        found = np.zeros((end, x.size))
        found[:, self.index[i]] = slopes[samples] * self.ratio[i]
        return found


def make_part(record: Record, model: Model, scales: Scales, frame: Frame, kept: Mask) -> Part:
    """Return a record ready to be simulated with a model."""
    grid, samples = grid_of(record, scales, frame, model.law)
    order = derivative_order(record.output_unit)
    fixed = np.zeros(len(LOCAL))
    fixed[PLACE["creep_time"]] = _LINEAR_CREEP
    if record.excitation == "base":
        fixed[PLACE["gain"]] = 1.0 / scales.physical("gain")
    size = scales.amplitude * scales.omega**order
    return Part(record, scales, grid, samples, kept, order, size, fixed)


def free_mechanics(model: Model, record: Record) -> tuple[str, ...]:
    """Return the mechanical numbers that are sought; the gain of a base in the output's own unit is one."""
    known = record.excitation == "base" and record.input_motion_unit == record.motion_unit
    return tuple(name for name in model.mechanics(record.excitation) if not (known and name == "gain"))


def make_layout(
    model: Model, parts: Sequence[Part], varying: Sequence[str] = (), steady: Sequence[str] | None = None
) -> Layout:
    """Return the layout of a fit. varying: names of `LOCAL` that belong to a group each instead of to all.

    steady: of steady states, which have neither start nor rest position, the names of the numbers instead of `LOCAL`.
    """
    place = PLACE if steady is None else {name: k for k, name in enumerate(steady)}
    groups = list(dict.fromkeys(part.record.group for part in parts))
    entries = []
    for name in free_mechanics(model, parts[0].record):
        entries += [Entry(name, group=group) for group in groups] if name in varying else [Entry(name)]
    if steady is None:
        entries += [
            Entry(name, record=i if len(parts) > 1 else -1)
            for i in range(len(parts))
            for name in model.nuisance(parts[i].record.excitation)
        ]
    index, column, ratio = [], [], []
    for i, part in enumerate(parts):
        mine = [
            k for k, entry in enumerate(entries) if entry.group in ("", part.record.group) and entry.record in (-1, i)
        ]
        index.append(np.array(mine, dtype=np.intp))
        column.append(np.array([place[entries[k].local] for k in mine], dtype=np.intp))
        ratio.append(np.array([_ratio(entries[k].local, parts[0].scales, part.scales) for k in mine]))
    return Layout(model, tuple(parts), tuple(entries), tuple(index), tuple(column), tuple(ratio))


def _ratio(local: str, first: Scales, own: Scales) -> float:
    if local in ("start", "start_rate", "offset", "drift", "creep_time", *HISTORIES):
        return 1.0
    return first.physical(local) / own.physical(local)
