"""An oscillator of one degree of freedom, described by a handful of numbers.

    I φ̈ + d φ̇ + c |φ̇| φ̇ + k φ + k₂ φ² + k₃ φ³ + M_c tanh(φ̇/v) = M sin Ωt + I Ω² b sin Ωt,

the left side being `LAW`, a sum of terms (`sinew.mechanics.laws`). φ is the rotation against the base, which turns by
b sin Ωt. Dry friction M_c turns round over the speed v, `DryFriction.SLIDING_SHARE` of the natural frequency times the
expected amplitude, or times three static rotations where that is less; the more of the torque the friction takes up,
the less. A motion that rests for a part of its period creeps instead.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.measure.errors import SpecError
from sinew.mechanics.laws import Cubic, Drag, DryFriction, Linear, Number, Quadratic, Viscous
from sinew.solve.balance import Coordinate, Equations, Lane, Size
from sinew.solve.curves import Problem, Resolution

LAW = Linear() + Viscous() + Drag() + DryFriction() + Quadratic() + Cubic()


def _key(number: Number) -> str:
    """Return the name of a number of `LAW` with its unit, of a torque over powers of the rotation and its rate."""
    fast, far = number.scale
    powers = (("s", 2 - fast), ("rad", 1 - far))
    return "_".join((number.name, "n_m", *(f"{unit}{power if power > 1 else ''}" for unit, power in powers if power)))


KEYS = {"inertia_kg_m2": "inertia", "frequency_hz": "frequency_hz", "damping_ratio": "damping_ratio"} | {
    _key(number): number.name
    for term in LAW.terms
    for number in term.numbers
    if number.name not in ("stiffness", "damping")  # which the frequency and the damping ratio give
}
"""What `sinew predict --oscillator` takes, each with its unit, and the field of an `Oscillator` that it is."""

_LEAST_LEFT, _HEAVY = 0.1, 0.5


class Oscillator(NamedTuple):
    """An oscillator in SI: I [kg m²], k/I as natural frequency [Hz], D = d/(2 sqrt(k I)), k₃ [N m/rad³],
    k₂ [N m/rad²], M_c [N m], c [N m s²/rad²]; driven by a torque M [N m] or by its base, b [rad]."""

    inertia: float
    frequency_hz: float
    damping_ratio: float
    cubic: float = 0.0
    quadratic: float = 0.0
    coulomb: float = 0.0
    drag: float = 0.0
    torque: float = 0.0
    base: float = 0.0

    def friction_remark(self) -> str:
        """Return what is to be said of dry friction that takes up most of the torque; empty where it does not.

        Against time integration amplitudes are right to 0.3 % of the largest with friction of 0.3 of the torque, to
        1.5 % with 0.6, and to 8 % with 0.85.
        """
        if self.torque == 0 or self.coulomb <= _HEAVY * abs(self.torque):
            return ""
        return (
            f"dry friction is {self.coulomb / abs(self.torque):.0%} of the torque: the oscillator rests for a part of "
            "its period, which is computed as a creep; take amplitudes for rough, the more so the smaller they are"
        )

    def checked(self) -> "Oscillator":
        """Return the same oscillator. Raises SpecError where a number cannot be meant."""
        for name in ("inertia", "frequency_hz", "damping_ratio"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise SpecError(f"{name} is {getattr(self, name):g}, expected a positive number")
        for name, unit in (("coulomb", "N m"), ("drag", "N m s²/rad²")):
            if not getattr(self, name) >= 0:
                raise SpecError(f"{name} is {getattr(self, name):g} {unit}, expected zero or more")
        push = abs(self.torque) + abs(self.base)
        if not np.isfinite(push) or push == 0:
            raise SpecError("found nothing that drives the oscillator, expected a torque or a motion of the base")
        if self.coulomb > 0 and self.torque != 0 and abs(self.torque) <= self.coulomb:
            raise SpecError(
                f"a torque of {abs(self.torque):g} N m does not overcome {self.coulomb:g} N m of dry friction; the "
                "oscillator sticks, raise the torque"
            )
        return self

    @property
    def stiffness(self) -> float:
        """Return k [N m/rad]."""
        return float(self.inertia * (2 * np.pi * self.frequency_hz) ** 2)


class _Numbers(NamedTuple):
    inertia: jax.Array
    damping: jax.Array
    stiffness: jax.Array
    quadratic: jax.Array
    cubic: jax.Array
    coulomb: jax.Array
    drag: jax.Array
    speed: jax.Array
    torque: jax.Array
    base: jax.Array


def _rates(u: jax.Array, phase: jax.Array, omega: jax.Array, p: _Numbers) -> jax.Array:
    push = (p.torque + p.inertia * omega**2 * p.base) * jnp.sin(phase)
    return jnp.asarray((push - LAW.force(p._asdict(), u[0], u[1])) / p.inertia)[None]


SYMMETRIC = Equations((Coordinate("angle", "odd", 2),), _rates)
"""Equations without a quadratic term: odd harmonics, half a period."""

LOPSIDED = Equations((Coordinate("angle", "all", 2),), _rates)
"""Equations with a quadratic term."""


def equations_of(oscillators: list[Oscillator]) -> Equations:
    """Return the equations that hold for all of them."""
    return LOPSIDED if any(one.quadratic != 0 for one in oscillators) else SYMMETRIC


def expected_amplitude(one: Oscillator) -> float:
    """Return about how far the oscillator swings at resonance [rad]: its losses are what drives it, on the backbone of
    the fundamental: d Ω A + 8/(3π) c Ω² A² = M."""
    k, omega = one.stiffness, 2 * np.pi * one.frequency_hz
    damping = 2 * one.damping_ratio * k / omega
    low, high = 0.0, (abs(one.torque) + k * abs(one.base)) / (damping * omega) + 1e-300
    for _ in range(60):
        middle = 0.5 * (low + high)
        free = np.sqrt(max(k + 0.75 * one.cubic * middle**2, 0.01 * k) / one.inertia)
        push = abs(one.torque) + one.inertia * free**2 * abs(one.base)
        lost = damping * free * middle + 8 / (3 * np.pi) * one.drag * (free * middle) ** 2
        low, high = (middle, high) if lost < push else (low, middle)
    return float(high)


def lane_of(one: Oscillator, width_hz: float) -> Lane:
    """Return the oscillator as one lane; width_hz: of the band of frequencies."""
    omega, amplitude = 2 * np.pi * one.frequency_hz, expected_amplitude(one)
    static = abs(one.torque) / one.stiffness + abs(one.base)
    left = max(1 - one.coulomb / abs(one.torque), _LEAST_LEFT) if one.torque else 1.0
    numbers = (
        one.inertia,
        2 * one.damping_ratio * one.stiffness / omega,
        one.stiffness,
        one.quadratic,
        one.cubic,
        one.coulomb,
        one.drag,
        left * DryFriction.SLIDING_SHARE * omega * min(amplitude, 3 * static),
        one.torque,
        one.base,
    )
    leaves: list[NDArray[np.float64]] = [np.asarray(number, dtype=float) for number in numbers]
    return Lane(_Numbers(*leaves), np.array([amplitude]), np.asarray(2 * np.pi * width_hz))  # type: ignore[arg-type]


def _weakened(p: _Numbers, share: float) -> _Numbers:
    return p._replace(torque=p.torque * share, base=p.base * share)


def _eased(p: _Numbers, share: float) -> _Numbers:
    return p._replace(speed=p.speed / share**2)


def oscillator_problem(oscillators: list[Oscillator], band_hz: tuple[float, float]) -> Problem:
    """Return the problem of several oscillators over one band of frequencies [Hz], one lane each."""
    lanes = [lane_of(one.checked(), band_hz[1] - band_hz[0]) for one in oscillators]
    lane: Lane = jax.tree.map(lambda *leaves: np.stack(leaves), *lanes)
    return Problem(equations_of(oscillators), lane, np.zeros((len(lanes), 1)), _weakened, _eased)


def resolution_of(oscillators: list[Oscillator]) -> Resolution:
    """Return the waves that oscillators need."""
    dry = any(one.coulomb > 0 for one in oscillators)
    return resolution_for(dry=dry, lopsided=equations_of(oscillators) is not SYMMETRIC)


def resolution_for(*, dry: bool, lopsided: bool) -> Resolution:
    """Return the waves of one degree of freedom. dry: with friction that turns round within few samples, which need to
    be finer. lopsided: whether both sides of its spring differ."""
    half = 2 if lopsided else 1

    def pair(harmonics: int) -> tuple[Size, Size]:
        fine = 2 * harmonics + 1
        if dry:
            return Size(harmonics, 512 * half), Size(fine, 1024 * half)
        return Size(harmonics, 3 * (harmonics + 1) * half), Size(fine, 6 * (fine + 1) * half)

    return Resolution(tuple(pair(h) for h in ((9, 19) if dry else (7, 15, 31))), 1e-3 if dry else 1e-6)
