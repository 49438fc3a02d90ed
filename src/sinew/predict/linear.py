"""This is where the joint at rest becomes linear: the twin's own equations of motion, differentiated at rest.

Two systems per pretension. `drive` has the lever on its servo: from the command, and from a torque on the head, to
torsion and lever. `lever` has the lever moved as told: from its angle, and from a torque on the head, to torsion.

What is not smooth at rest is not linearised tacitly:

- Guide friction: at small angles the bristle follows the torsion, z = φ/φ_s, so it is a spring of stiffness μ ΣT/φ_s.
  Its loss grows with the amplitude and is nothing to first order; the bristle's state is replaced by that relation.
- Coulomb friction of the gear turns round over a small speed. A lever slower than that creeps, as on a damper; one
  that is faster slides against a constant, which has no part in a linear response. `Gear` says which is meant.
- The duty is taken below its limit, tendons as they are at rest.

Shortening moves the torsion only to second order (tendons lengthen either way), so it leaves both systems.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.plan.plan import Group, TendonMode
from sinew.plan.rig import RigSpec
from sinew.predict.state_space import StateSpace
from sinew.twin.effects import Effects
from sinew.twin.energy import tendon_stretch, tendon_tension, total_tension
from sinew.twin.motion import State, derivative, free_lever_acceleration, rate, state_at_rest
from sinew.twin.parameters import Parameters
from sinew.twin.prony import BRANCHES
from sinew.twin.simulate import lane_parameters

__all__ = ["GEARS", "Gear", "LinearJoint", "linear_joints"]

Array = NDArray[np.float64]
Gear = Literal["sliding", "creeping"]

GEARS: tuple[Gear, ...] = ("sliding", "creeping")
"""How the gear's Coulomb friction is taken: as a constant that the moving lever slides against, or as the damper that
it is to a lever that hardly moves."""

_NAMES = (
    *("torsion_rad", "torsion_rate_rad_s", "shortening_m", "shortening_rate_m_s", "lever_rad", "lever_rate_rad_s"),
    "bristle",
    *(f"memory_{i + 1}_rad" for i in range(BRANCHES)),
    *(f"axial_memory_{i + 1}_m" for i in range(BRANCHES)),
)
"""States of the twin in their order, without the gyroscope's low-pass, which acts on nothing."""

_PLACE = {name: i for i, name in enumerate(_NAMES)}
_MEMORY = tuple(name for name in _NAMES if name.startswith("memory"))
_COUPLING = 1e-9


@dataclass(frozen=True)
class LinearJoint:
    """One joint at one pretension, linear. drive, lever: the two systems. tension: of each tendon at rest [N].
    guide_stiffness: of the guides before they slip, μ ΣT/φ_s [N m/rad]. error_limit: error of angle at which the
    duty is at its limit [rad]. notes: sentences on what is not in it."""

    pretension_mm: float
    drive: StateSpace
    lever: StateSpace
    tension: float
    guide_stiffness: float
    error_limit: float
    notes: tuple[str, ...]


@cache
def _slopes() -> Any:
    """Return the compiled derivatives of the rates at rest: by the states, by the command, by a torque on the head and
    by the lever's acceleration."""

    def of(shortening: jax.Array, p: Parameters) -> tuple[jax.Array, ...]:
        idle = p._replace(amplitude=jnp.zeros(()), omega=jnp.ones(()), stop_s=jnp.full((), jnp.inf))
        rest, unravel = jax.flatten_util.ravel_pytree(state_at_rest(shortening, idle))
        top = jnp.asarray(0.5 * jnp.pi)  # where a command A sin t is A

        def flat(state: State) -> jax.Array:
            return jax.flatten_util.ravel_pytree(state)[0]

        def by_state(y: jax.Array) -> jax.Array:
            return flat(rate(jnp.zeros(()), unravel(y), idle))

        def by_command(angle: jax.Array) -> jax.Array:
            return flat(rate(top, unravel(rest), idle._replace(amplitude=angle)))

        def by_torque(torque: jax.Array) -> jax.Array:
            turned = free_lever_acceleration(torque, jnp.zeros(()), idle)
            lever = jnp.where(idle.prescribed > 0, 0.0, turned)
            return flat(derivative(unravel(rest), torque, jnp.zeros(()), lever, idle))

        def by_lever(acceleration: jax.Array) -> jax.Array:
            return flat(derivative(unravel(rest), jnp.zeros(()), jnp.zeros(()), acceleration, idle))

        zero = jnp.zeros(())
        inputs = [jax.jacfwd(column)(zero) for column in (by_command, by_torque, by_lever)]
        return jax.jacfwd(by_state)(rest), *inputs

    return jax.jit(jax.vmap(of))


@cache
def _rest() -> Any:
    def of(shortening: jax.Array, p: Parameters) -> tuple[jax.Array, jax.Array]:
        zero = jnp.zeros(())
        stretch = tendon_stretch(zero, shortening, p)[0]
        spring = p.guide_friction * total_tension(zero, shortening, p) / p.presliding_angle
        return tendon_tension(stretch, p), spring

    return jax.jit(jax.vmap(of))


def _torsional(a: Array, names: tuple[str, ...]) -> tuple[Array, tuple[str, ...]]:
    """Return (A of the named states and the memory that acts on them, their names).

    The bristle is replaced by φ/φ_s: its slope by the torsion's rate over that of the torsion is 1/φ_s. What is left
    out must not act on what stays.
    """
    bristle, torsion, speed = (_PLACE[name] for name in ("bristle", "torsion_rad", "torsion_rate_rad_s"))
    a = a.copy()
    a[:, torsion] += a[:, bristle] * a[bristle, speed]
    names += tuple(name for name in _MEMORY if a[speed, _PLACE[name]] != 0)
    kept = [_PLACE[name] for name in names]
    axial = [i for name, i in _PLACE.items() if name.startswith(("shortening", "axial"))]
    assert np.abs(a[np.ix_(kept, axial)]).max() <= _COUPLING * np.abs(a[kept]).max()
    return a[np.ix_(kept, kept)], names


def _drive(a: Array, by_command: Array, by_torque: Array) -> StateSpace:
    part, names = _torsional(a, ("torsion_rad", "torsion_rate_rad_s", "lever_rad", "lever_rate_rad_s"))
    kept = [_PLACE[name] for name in names]
    seen = np.eye(len(names))[[0, 2]]
    inputs, outputs = ("command_rad", "torque_n_m"), ("torsion_rad", "lever_rad")
    return StateSpace(
        part, np.stack([by_command, by_torque], axis=1)[kept], seen, np.zeros((2, 2)), names, inputs, outputs
    )


def _lever(a: Array, by_torque: Array, by_acceleration: Array) -> StateSpace:
    """Return the system whose lever moves as told, by angle.

    The lever acts by its acceleration: ẋ = A x + e θ̈. With x = ξ + A e θ + e θ̇ this is ξ̇ = A ξ + A² e θ, and the
    torsion, whose own row of e is zero, is that of ξ + A e θ: no derivative of the input is left.
    """
    part, names = _torsional(a, ("torsion_rad", "torsion_rate_rad_s"))
    kept = [_PLACE[name] for name in names]
    e = by_acceleration[kept]
    shifted = tuple(f"{name}_less_lever" if i < 2 else name for i, name in enumerate(names))
    seen = np.eye(len(names))[:1]
    b = np.stack([part @ part @ e, by_torque[kept]], axis=1)
    d = np.concatenate([seen @ part @ e, [0.0]])[None]
    return StateSpace(part, b, seen, d, shifted, ("lever_rad", "torque_n_m"), ("torsion_rad",))


def _notes(p: Parameters, tension: float, spring: float, gear: Gear) -> tuple[str, ...]:
    notes = []
    if spring > 0:
        turn = np.degrees(float(p.presliding_angle))
        notes.append(
            f"the guides' friction is a spring of {spring:.3g} N m/rad without loss, right for torsions far below "
            f"{turn:.3g}°; its loss grows with the amplitude"
        )
    if float(p.drive_friction) > 0:
        sticks = np.degrees(float(p.drive_friction / (p.duty_torque * p.position_gain)))
        slides = f"commands far above {sticks:.2g}°" if gear == "sliding" else f"commands far below {sticks:.2g}°"
        does = "slides against a constant friction" if gear == "sliding" else "creeps"
        notes.append(f"the gear {does}: right for {slides}")
    limit = np.degrees(float(p.duty_limit / p.position_gain))
    if limit < 360:
        notes.append(f"the duty limit is not in it: the drive saturates where lever and command are {limit:.3g}° apart")
    if tension <= 0:
        notes.append("the tendons carry no load at rest: they act only at larger torsions, which is not in it")
    return tuple(notes)


def linear_joints(
    rig: RigSpec,
    pretension_mm: NDArray[np.float64] | list[float],
    *,
    gear: Gear = "sliding",
    mode: TendonMode = "position",
    effects: Effects | None = None,
) -> tuple[LinearJoint, ...]:
    """Return the linear joint at each pretension [mm], for motions so small that the stiffness does not change.

    gear: how the friction of the drive's gear is taken, see `GEARS`. mode: of the tendon motors.
    effects: of the twin; without `drive_dynamics` the lever follows its command, so use `LinearJoint.lever`.
    """
    effects = effects or Effects()
    groups = [Group("steady", float(mm), 1.0, 1.0, 0, 1.0, 1.0) for mm in np.atleast_1d(pretension_mm)]
    lanes, shortening = lane_parameters(groups, rig, mode=mode, effects=effects)
    lanes = lanes._replace(prescribed=np.zeros_like(shortening))  # type: ignore[arg-type]
    if gear == "sliding":
        lanes = lanes._replace(drive_friction=np.zeros_like(shortening))  # type: ignore[arg-type]
    held = lanes._replace(prescribed=np.ones_like(shortening))  # type: ignore[arg-type]
    free = [np.asarray(leaf) for leaf in _slopes()(shortening, lanes)]
    told = [np.asarray(leaf) for leaf in _slopes()(shortening, held)]
    tension, spring = (np.asarray(leaf) for leaf in _rest()(shortening, lanes))
    own = float(rig.drive.friction.value)
    joints = []
    for i, group in enumerate(groups):
        p = jax.tree.map(lambda leaf, i=i: np.asarray(leaf)[i], lanes)._replace(drive_friction=np.asarray(own))
        joints.append(
            LinearJoint(
                group.pretension_mm,
                _drive(free[0][i], free[1][i], free[2][i]),
                _lever(told[0][i], told[2][i], told[3][i]),
                float(tension[i]),
                float(spring[i]),
                float(p.duty_limit / p.position_gain),
                _notes(p, float(tension[i]), float(spring[i]), gear),
            )
        )
    return tuple(joints)
