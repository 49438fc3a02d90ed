"""This is where a model is put together: a damping law, a stiffness law, and how its numbers are called."""

import re
from dataclasses import dataclass, replace
from typing import Literal

from sinew.identify.oscillator.record import Excitation
from sinew.identify.oscillator.track import LOCAL, DampingLaw, StiffnessLaw
from sinew.measure.errors import SpecError

Rest = Literal["offset", "drift", "creep"]


@dataclass(frozen=True)
class Model:
    """One degree of freedom: I r'' + damping + stiffness = input.

    name: what the command line calls it. damping: viscous, viscous and Coulomb, or a constant loss factor.
    terms: of the stiffness beyond the linear one, of "quadratic" and "cubic". pendulum: sin r instead of r (angles).
    rest: what the rest position does during the record: an offset, a linear drift, or an exponential creep.
    """

    name: str
    damping: DampingLaw = "viscous"
    terms: tuple[str, ...] = ()
    pendulum: bool = False
    rest: Rest = "offset"

    def resting(self, rest: Rest) -> "Model":
        """Return the same model with another rest position."""
        return replace(self, rest=rest)

    @property
    def stiffness(self) -> StiffnessLaw:
        """Return the form of the linear restoring term."""
        return "pendulum" if self.pendulum else "polynomial"

    def mechanics(self, excitation: Excitation) -> tuple[str, ...]:
        """Return the names (of `LOCAL`) of its mechanical numbers under an excitation."""
        damping = {"viscous": ("damping",), "coulomb": ("damping", "coulomb"), "loss-factor": ("loss_factor",)}
        names = {"stiffness", *damping[self.damping], *self.terms} | ({"gain"} if excitation != "none" else set())
        return tuple(name for name in LOCAL if name in names)

    def nuisance(self, excitation: Excitation) -> tuple[str, ...]:
        """Return the names (of `LOCAL`) of the numbers that every record has for itself."""
        memory = ("memory",) if self.damping == "loss-factor" and excitation == "none" else ()
        more = {"offset": (), "drift": ("drift",), "creep": ("drift", "creep_time")}
        return ("start", "start_rate", "offset", *more[self.rest], *memory)


MODELS: dict[str, Model] = {
    model.name: model
    for model in (
        Model("linear"),
        Model("loss-factor", "loss-factor"),
        Model("coulomb", "coulomb"),
        Model("cubic", terms=("cubic",)),
        Model("cubic-quadratic", terms=("quadratic", "cubic")),
        Model("loss-factor-cubic", "loss-factor", ("cubic",)),
        Model("loss-factor-cubic-quadratic", "loss-factor", ("quadratic", "cubic")),
        Model("coulomb-cubic", "coulomb", ("cubic",)),
        Model("coulomb-cubic-quadratic", "coulomb", ("quadratic", "cubic")),
        Model("pendulum", pendulum=True),
        Model("coulomb-pendulum", "coulomb", pendulum=True),
    )
}

NATURAL: dict[str, float] = {
    "stiffness": 0.5,
    "damping": 0.3,
    "loss_factor": 0.3,
    "coulomb": 0.1,
    "quadratic": 0.5,
    "cubic": 0.5,
    "gain": 0.5,
    "start": 0.5,
    "start_rate": 0.5,
    "offset": 0.5,
    "drift": 0.5,
    "creep_time": 2.0,
    "memory": 1.0,
}
"""Size of a change that matters, in the normal form of `LOCAL`; of the gain as a share of its value."""

WORDS: dict[str, str] = {
    "stiffness": "stiffness",
    "damping": "damping",
    "loss_factor": "loss factor",
    "coulomb": "dry friction",
    "quadratic": "quadratic term",
    "cubic": "cubic term",
    "gain": "input gain",
    "start": "start position",
    "start_rate": "start velocity",
    "offset": "offset",
    "drift": "drift",
    "creep_time": "creep time",
    "memory": "memory",
}
"""What people call the numbers of `LOCAL`."""


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
    return {
        "stiffness": "stiffness_per_s2",
        "damping": "damping_per_s",
        "loss_factor": "loss_factor",
        "coulomb": "_".join(filter(None, ("coulomb", unit, "per_s2"))),
        "quadratic": "_".join(filter(None, ("quadratic_per_s2", unit))),
        "cubic": "cubic_per_s2" + (f"_{unit}2" if unit else ""),
        "gain": "_".join(filter(None, ("input_gain", unit, "per_s2", given))),  # 1/I where unit over unit is 1/I's
    }[local]


def _token(unit: str) -> str:
    return "" if unit == "1" else re.sub(r"[^a-z0-9]+", "_", unit.lower()).strip("_")
