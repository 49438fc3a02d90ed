"""A model and its parts: a law of its motion, what its rest does, and how its numbers are called."""

import re
from dataclasses import dataclass, replace
from typing import Literal

from sinew.identify.oscillator.record import Excitation
from sinew.identify.oscillator.track import LOCAL
from sinew.measure.errors import SpecError
from sinew.mechanics.laws import (
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
