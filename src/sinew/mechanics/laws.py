"""Laws of an oscillator of one degree of freedom: terms that add up, each whole in one class.

    r'' + Σ force(r, r', z) = push,    `Linear() + Viscous() + Cubic()`,

r being the motion and everything divided by the inertia. A term knows its force and its own states z, what it
stores and what it loses in a swing, and of its numbers the names, the normal form and where a search begins. In normal
form time counts in 1/ω_r and motion in amplitudes A, so that all numbers are near one.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.mechanics.silicone import branch_stiffness, prony_shares

Values = Mapping[str, Any]
"""Numbers of a simulation by name, as JAX or NumPy has them; `amplitude` is A where a term needs it, else one."""


class Number(NamedTuple):
    """One number that a search moves.

    name: of it in a search; word: on the screen. natural: size of a change that matters, in normal form.
    scale: powers of ω_r and A that the normal form is multiplied by to be in SI units and radians.
    force: whether it is the factor of a force, and so in proportion to the inertia. positive: whether nothing has a
    negative one. absent: whether zero says that the term is not there. start: bounds of where a search begins,
    tried: or all the values at which it does, in normal form. prior: width of a weak prior, if not 20 natural scales.
    """

    name: str
    word: str
    natural: float
    scale: tuple[int, int] = (0, 0)
    force: bool = False
    positive: bool = False
    absent: bool = False
    start: tuple[float, float] = (-1e3, 1e3)
    tried: tuple[float, ...] = ()
    prior: float | None = None

    def over_inertia(self, unit: str) -> str:
        """Return the name with its unit over the inertia's; unit: of the motion in words, "" where it has none."""
        fast, far = self.scale
        below = [word for word in (_power("s", fast), _power(unit, -far)) if word]
        return "_".join(filter(None, (self.name, _power(unit, far), *(["per", *below] if below else []))))

    def in_full(self, force: str, unit: str) -> str:
        """Return the name with its unit of an angle under a torque ("n_m", "rad"), or a length under a force."""
        time, below = _power("s", 2 - self.scale[0]), _power(unit, 1 - self.scale[1])
        return "_".join(filter(None, (self.name, force, time, below and f"per_{below}")))


def _power(unit: str, exponent: int) -> str:
    return unit + (str(exponent) if unit and exponent > 1 else "") if exponent > 0 else ""


class Cycle(NamedTuple):
    """One free swing of amplitudes (a,): position and speed at nodes of the way there, and their weights, (a, n)."""

    amplitude: Array
    position: Array
    speed: Array
    weight: Array

    def around(self, force: Array) -> Array:
        """Return ∮ force dr, which has the same size on the way back, shape (a,)."""
        return np.asarray(2.0 * np.sum(self.weight * force, axis=1))


@dataclass(frozen=True)
class Term(ABC):
    """One term of a law. What a class says of itself:

    numbers: in the order of a search. history: what it saw before a record, a number of each record that has one;
    only_decays: or of free decays alone, where it makes a difference.
    lost: what a verdict calls its loss; empty for a spring. sticks: holds a resting motion, up to its number.
    plain: costs a simulation nothing, so that laws which differ in it alone share one compiled program.
    by_name: is fitted only where it is asked for by name. phase: longest step of a simulation in 1/ω_r, by which RK4 is
    right to 5e-6 in frequency.
    """

    numbers: ClassVar[tuple[Number, ...]] = ()
    history: ClassVar[Number | None] = None
    only_decays: ClassVar[bool] = False
    lost: ClassVar[str] = ""
    sticks: ClassVar[bool] = False
    plain: ClassVar[bool] = False
    by_name: ClassVar[bool] = False
    phase: ClassVar[float] = 0.15

    def __add__(self, other: "Term | Law") -> "Law":
        return Law((self,)) + other

    @abstractmethod
    def force(self, p: Values, r: Any, v: Any, z: Any) -> Any:
        """Return the force over the inertia against a motion r of the rate v; z: the term's own states, () if none."""

    def prepared(self, p: Values) -> dict[str, Any]:
        """Return what the force needs and does not change in time."""
        return {}

    def begin(self, p: Values, r: Any, v: Any) -> Any:
        """Return the states at the start of a record."""
        return ()

    def rate(self, p: Values, r: Any, v: Any, z: Any) -> Any:
        """Return the rates of the states."""
        return ()

    def stored(self, p: Values, r: Any) -> Any:
        """Return the energy over the inertia that is held at a position and comes back."""
        return 0.0 * r

    def dissipated(self, p: Values, cycle: Cycle) -> Any:
        """Return the energy over the inertia that a swing loses, shape (a,)."""
        return 0.0

    def regressor(self, r: Array, v: Array) -> tuple[Array, int]:
        """Return the signal whose derivative of this order has the term's first number as its factor in the force.

        r: motion, v: its rate, shape (n,): so a linear regression tells where a search begins.
        """
        return np.asarray(self.force({self.numbers[0].name: 1.0, "amplitude": 1.0}, r, v, ())), 0

    def started(self, values: Mapping[str, float], amplitude: float) -> dict[str, float]:
        """Return the first values that the regression does not tell as they are; values: in SI units."""
        return {}


class Linear(Term):
    """A spring k r."""

    numbers = (Number("stiffness", "stiffness", 0.5, (2, 0), force=True, positive=True),)

    def force(self, p: Values, r: Any, v: Any, z: Any) -> Any:
        return p["stiffness"] * r

    def stored(self, p: Values, r: Any) -> Any:
        return p["stiffness"] * (0.5 * r**2)


class Pendulum(Linear):
    """A weight's k sin r, of an angle."""

    def force(self, p: Values, r: Any, v: Any, z: Any) -> Any:
        return p["stiffness"] * (jnp.sin(r * p["amplitude"]) / p["amplitude"])

    def stored(self, p: Values, r: Any) -> Any:
        return p["stiffness"] * (1.0 - np.cos(r * p["amplitude"])) / p["amplitude"] ** 2


class Viscous(Term):
    """A damper d r'."""

    numbers = (Number("damping", "damping", 0.3, (1, 0), force=True, positive=True, start=(0.004, 1e3)),)
    lost = "viscous"
    plain = True

    def force(self, p: Values, r: Any, v: Any, z: Any) -> Any:
        return p["damping"] * v

    def dissipated(self, p: Values, cycle: Cycle) -> Any:
        return p["damping"] * cycle.around(cycle.speed)

    def regressor(self, r: Array, v: Array) -> tuple[Array, int]:
        return r, 1


class LossFactor(Term):
    """A constant loss factor η of the linear spring, by a Prony series (see `sinew.mechanics.silicone`).

    The stiffness is the dynamic one at the natural frequency, K_r Re G*(√K) = K, so the force is beside the spring's
    K r that of its relaxation, K_r (r + Σ g_i (r - z_i)) - K r. Before a record the branches have seen a steady
    oscillation (memory 0), or a long rest where it starts (memory 1).
    """

    LARGEST: ClassVar[float] = 1.0
    numbers = (Number("loss_factor", "loss factor", 0.3, positive=True, start=(1e-3, 0.8), prior=1.0),)
    history = Number("memory", "memory", 1.0, start=(0.0, 1.0), prior=1.0)
    only_decays = True
    lost = "a constant loss factor"

    def prepared(self, p: Values) -> dict[str, Any]:
        shares = _shares(p["loss_factor"])
        return {"shares": shares, "relaxed": p["stiffness"] / _storage(shares, _natural(p), p["relaxation"])}

    @staticmethod
    def storage(p: Values, omega: Any) -> Any:
        """Return the storage stiffness at a frequency in ω_r."""
        shares, times = _shares(p["loss_factor"]), p["relaxation"]
        return p["stiffness"] * _storage(shares, omega, times) / _storage(shares, _natural(p), times)

    def force(self, p: Values, r: Any, v: Any, z: Any) -> Any:
        return p["relaxed"] * (r + jnp.sum(p["shares"] * (r - z))) - p["stiffness"] * r

    def rate(self, p: Values, r: Any, v: Any, z: Any) -> Any:
        return (r - z) / p["relaxation"]

    def begin(self, p: Values, r: Any, v: Any) -> Any:
        swinging = (r - v * p["relaxation"]) / (1.0 + p["relaxation"] ** 2)
        return swinging + p["memory"] * (r - swinging)

    def dissipated(self, p: Values, cycle: Cycle) -> Any:
        return np.pi * p["loss_factor"] * p["stiffness"] * cycle.amplitude**2

    def regressor(self, r: Array, v: Array) -> tuple[Array, int]:
        return r, 1

    def started(self, values: Mapping[str, float], amplitude: float) -> dict[str, float]:
        return {"loss_factor": values["loss_factor"] / float(np.sqrt(max(values["stiffness"], 1e-12)))}


def _storage(shares: Any, omega: Any, relaxation: Any) -> Any:
    return 1.0 + jnp.sum(branch_stiffness(shares, omega * relaxation)[0])


def _natural(p: Values) -> Any:
    return jnp.sqrt(jnp.maximum(p["stiffness"], 1e-6))


_TABLE = 401


@cache
def share_table() -> Array:
    """Return the Prony shares of loss factors from zero to the largest, shape (401, branch)."""
    return np.stack([prony_shares(factor) for factor in np.linspace(0.0, LossFactor.LARGEST, _TABLE)])


def _shares(loss_factor: jax.Array) -> jax.Array:
    """Return the Prony shares, odd in the loss factor so that a fit may pass through zero."""
    table = share_table()
    size = jnp.clip(jnp.abs(loss_factor) / LossFactor.LARGEST, 0.0, 1.0) * (_TABLE - 1)
    row = jnp.clip(jnp.floor(size).astype(int), 0, _TABLE - 2)
    s = size - row
    values, slopes = jnp.asarray(table), jnp.asarray(np.gradient(table, axis=0))
    ends = (2 * s**3 - 3 * s**2 + 1) * values[row] + (3 * s**2 - 2 * s**3) * values[row + 1]
    leaning = (s**3 - 2 * s**2 + s) * slopes[row] + (s**3 - s**2) * slopes[row + 1]
    return jnp.asarray(jnp.sign(loss_factor) * (ends + leaning))


class DryFriction(Term):
    """Coulomb's friction c sign r', which holds a rest; softened to c tanh(r'/v₀) where a motion must be smooth.

    With v₀ the `SLIDING_SHARE` of the largest speed, the fundamental of the friction is right to 2e-4.
    """

    SLIDING_SHARE: ClassVar[float] = 0.02
    numbers = (Number("coulomb", "dry friction", 0.1, (2, 1), True, True, absent=True, start=(1e-3, 0.8)),)
    lost = "dry friction"
    sticks = True

    def force(self, p: Values, r: Any, v: Any, z: Any) -> Any:
        return p["coulomb"] * jnp.tanh(v / p["speed"])

    def dissipated(self, p: Values, cycle: Cycle) -> Any:
        return 4.0 * p["coulomb"] * cycle.amplitude

    def regressor(self, r: Array, v: Array) -> tuple[Array, int]:
        return np.sign(v), 0


class Drag(Term):
    """Drag c |r'| r', as of a body in air or water: damping that grows with the amplitude."""

    numbers = (Number("drag", "quadratic drag", 0.3, (0, -1), True, True, absent=True, start=(1e-3, 10.0)),)
    lost = "quadratic drag"
    plain = True

    def force(self, p: Values, r: Any, v: Any, z: Any) -> Any:
        return p["drag"] * jnp.abs(v) * v

    def dissipated(self, p: Values, cycle: Cycle) -> Any:
        return p["drag"] * cycle.around(cycle.speed**2)


class BoucWen(Term):
    """Hysteresis f w, whose state w follows the motion as far as it yields (Bouc 1967, Wen 1976).

    w' = r'/y (1 - w² where r' and w have the same sign, else 1): Wen's equation with n = 2 and β = γ, by which w turns
    back elastically and then goes to its limit as tanh(r/y). A small motion sees a spring f/y, a large one friction f.
    """

    numbers = (
        Number("hysteresis", "hysteresis", 0.1, (2, 1), True, True, absent=True, start=(0.02, 0.8)),
        Number("yield", "yield motion", 0.3, (0, 1), positive=True, start=(0.03, 2.0), tried=(0.05, 0.2, 0.6)),
    )
    history = Number("hysteresis_start", "hysteresis at the start", 0.5, start=(-2.0, 2.0), prior=1.0)
    lost = "Bouc-Wen hysteresis"
    by_name = True
    phase = 0.03
    _LEAST: ClassVar[float] = 0.03

    def force(self, p: Values, r: Any, v: Any, z: Any) -> Any:
        return p["hysteresis"] * z

    def begin(self, p: Values, r: Any, v: Any) -> Any:
        return jnp.tanh(p["hysteresis_start"])  # a state that the motion can have led to

    def rate(self, p: Values, r: Any, v: Any, z: Any) -> Any:
        return v / self._yield(p) * (1.0 - jnp.where(v * z > 0, z * z, 0.0))

    def stored(self, p: Values, r: Any) -> Any:
        return 0.5 * p["hysteresis"] * self._turning(p, np.abs(r)) * np.abs(r)  # to first order: the loop's secant

    def dissipated(self, p: Values, cycle: Cycle) -> Any:
        w = self._turning(p, cycle.amplitude)
        slid = 2.0 * cycle.amplitude / self._yield(p) - w
        return 2.0 * p["hysteresis"] * self._yield(p) * (np.logaddexp(slid, -slid) - np.log(2.0) - 0.5 * w**2)

    def regressor(self, r: Array, v: Array) -> tuple[Array, int]:
        return np.sign(v), 0

    @classmethod
    def _yield(cls, p: Values) -> Any:
        return jnp.maximum(p["yield"], cls._LEAST)  # what yields sooner is dry friction, and too stiff for a step

    @classmethod
    def _turning(cls, p: Values, amplitude: Array) -> Array:
        """Return the state where a steady swing turns: w = tanh(2 A/y - w)."""
        twice = 2.0 * amplitude / cls._yield(p)
        w = np.tanh(0.5 * twice)
        for _ in range(20):
            end = np.tanh(twice - w)
            w = w - (w - end) / (2.0 - end**2)
        return np.asarray(w)


class _Bend(Term):
    """A spring's k_n rⁿ."""

    power: ClassVar[int]
    plain = True

    def force(self, p: Values, r: Any, v: Any, z: Any) -> Any:
        return p[self.numbers[0].name] * r**self.power

    def stored(self, p: Values, r: Any) -> Any:
        return p[self.numbers[0].name] * r ** (self.power + 1) / (self.power + 1.0)


class Quadratic(_Bend):
    """A spring's k₂ r²."""

    numbers = (Number("quadratic", "quadratic term", 0.5, (2, -1), force=True, absent=True),)
    power = 2


class Cubic(_Bend):
    """A spring's k₃ r³."""

    numbers = (Number("cubic", "cubic term", 0.5, (2, -2), force=True, absent=True),)
    power = 3


TERMS: tuple[Term, ...] = (
    Linear(),
    Pendulum(),
    Viscous(),
    LossFactor(),
    DryFriction(),
    Drag(),
    BoucWen(),
    Quadratic(),
    Cubic(),
)
"""Every term there is, in the order in which a sum holds them."""


@dataclass(frozen=True)
class Law:
    """A sum of terms, each at most once and in the order of `TERMS`: a value that programs are compiled for.

    Raises SpecError for a term that is added twice, and for a second linear spring.
    """

    terms: tuple[Term, ...]

    def __post_init__(self) -> None:
        names = [number.name for number in self.numbers]
        if twice := [name for name in names if names.count(name) > 1]:
            raise SpecError(f"the law holds {twice[0]} twice, expected every term once and one linear spring")

    def __add__(self, other: "Term | Law") -> "Law":
        more = other.terms if isinstance(other, Law) else (other,)
        if unknown := [term for term in more if term not in TERMS]:
            known = ", ".join(type(term).__name__ for term in TERMS)
            raise SpecError(f"found a term {unknown[0]!r} in a law, expected one of {known}; add it to TERMS")
        return Law(tuple(sorted((*self.terms, *more), key=TERMS.index)))

    def has(self, kind: type[Term]) -> bool:
        """Return whether a term of this class is in the sum."""
        return any(isinstance(term, kind) for term in self.terms)

    @property
    def numbers(self) -> tuple[Number, ...]:
        """Return the numbers of all terms."""
        return tuple(number for term in self.terms for number in term.numbers)

    def histories(self, let_go: bool) -> tuple[str, ...]:
        """Return the names of what its terms saw before a record. let_go: whether the record is a free decay."""
        return tuple(t.history.name for t in self.terms if t.history is not None and (let_go or not t.only_decays))

    @property
    def losses(self) -> "Law":
        """Return the terms that lose energy."""
        return Law(tuple(term for term in self.terms if term.lost))

    @property
    def springs(self) -> "Law":
        """Return the terms that do not."""
        return Law(tuple(term for term in self.terms if not term.lost))

    @property
    def bends(self) -> tuple[str, ...]:
        """Return the names of the stiffness's numbers beyond the linear one."""
        return tuple(n.name for term in self.springs.terms if not isinstance(term, Linear) for n in term.numbers)

    @property
    def sticks(self) -> bool:
        """Return whether there is friction that holds a rest."""
        return any(term.sticks for term in self.terms)

    @cached_property
    def compiled(self) -> "Law":
        """Return the sum with all plain terms, whose numbers are zero where it has none of them: what is compiled."""
        return Law(tuple(term for term in TERMS if term.plain or term in self.terms))

    @property
    def phase(self) -> float:
        """Return the longest step of a simulation in 1/ω_r."""
        return min(term.phase for term in self.terms)

    def in_words(self) -> str:
        """Return what a verdict calls the losses, or the springs where there are none."""
        if lost := [term.lost for term in self.terms if term.lost]:
            return "viscous damping" if lost == [Viscous.lost] else " and ".join(lost)
        if self.has(Pendulum):
            return "a pendulum"
        several = f"spring with {' and '.join(self.bends)} terms"
        return "a " + {(): "linear spring", ("cubic",): "cubic spring"}.get(self.bends, several)

    def prepared(self, p: Values) -> dict[str, Any]:
        """Return the numbers with what the forces need and does not change in time."""
        return {**p, **{name: one for term in self.terms for name, one in term.prepared(p).items()}}

    def begin(self, p: Values, r: Any, v: Any) -> tuple[Any, ...]:
        """Return the states of all terms at the start of a record, () for a term that has none."""
        return tuple(term.begin(p, r, v) for term in self.terms)

    def force(self, p: Values, r: Any, v: Any, z: tuple[Any, ...] = (), *, sliding: bool = True) -> Any:
        """Return the sum of forces over the inertia; sliding: with the friction that holds a rest, softened."""
        own = zip(self.terms, z or ((),) * len(self.terms), strict=True)
        return sum(term.force(p, r, v, state) for term, state in own if sliding or not term.sticks)

    def limit(self, p: Values) -> Any:
        """Return the largest force over the inertia with which friction holds a rest."""
        return sum(p[term.numbers[0].name] for term in self.terms if term.sticks)

    def rate(self, p: Values, r: Any, v: Any, z: tuple[Any, ...]) -> tuple[Any, ...]:
        """Return the rates of the states."""
        return tuple(term.rate(p, r, v, own) for term, own in zip(self.terms, z, strict=True))

    def stored(self, p: Values, r: Array) -> Array:
        """Return the energy over the inertia that is held at positions."""
        return np.asarray(sum(term.stored(p, r) for term in self.terms))

    def dissipated(self, p: Values, cycle: Cycle) -> Array:
        """Return the energy over the inertia that swings lose, shape (a,)."""
        return np.asarray(sum(term.dissipated(p, cycle) for term in self.terms))


NUMBERS: dict[str, Number] = {number.name: number for term in TERMS for number in term.numbers}
"""The numbers of all terms, by name."""

HISTORIES: dict[str, Number] = {term.history.name: term.history for term in TERMS if term.history is not None}
"""What terms with a memory saw before a record, by name."""
