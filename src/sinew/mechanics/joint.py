"""Motion of the whole joint: its coordinates, its energy, and one function from state to rate."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp

from sinew.mechanics.drive import commanded_angle, duty, horn_torque
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.silicone import (
    BRANCHES,
    axial_stiffness,
    glassy_factor,
    relaxation_times,
    silicone_energy,
    silicone_power,
    viscoelastic_energy,
)
from sinew.mechanics.tendons import tendon_energy, tendon_stretch, total_tension

LOCKING_TIME = 5e-3
"""Time in which the speed of a lever that is locked on stopping is forgotten [s]; it acts on nothing."""


class State(NamedTuple):
    """State of one lane.

    torsion φ, torsion_rate [rad, rad/s]; shortening x, shortening_rate [m, m/s]; lever θ against the head and
    lever_rate; memory q_i [rad] and axial_memory u_i [m] of the silicone, by branch; gyro and gyro_rate: the low-pass
    of the gyroscope [rad/s, rad/s²]; bristles: deflections of those of the guides' friction, -1..1.
    """

    torsion: jax.Array
    torsion_rate: jax.Array
    shortening: jax.Array
    shortening_rate: jax.Array
    lever: jax.Array
    lever_rate: jax.Array
    memory: tuple[jax.Array, ...]
    axial_memory: tuple[jax.Array, ...]
    gyro: jax.Array
    gyro_rate: jax.Array
    bristles: tuple[jax.Array, ...]


def state_at_rest(shortening: jax.Array, p: Parameters) -> State:
    """Return the state of a joint that has rested at an axial shortening [m] until the silicone relaxed.

    A prescribed lever starts at the speed of its command.
    """
    zero = jnp.zeros(())
    start = jnp.where(p.prescribed > 0, p.amplitude * p.omega, 0.0)
    memory, axial_memory = (zero,) * BRANCHES, (shortening,) * BRANCHES
    bristles = (zero,) * len(p.guides.spread)
    return State(zero, zero, shortening, zero, zero, start, memory, axial_memory, zero, zero, bristles)


def friction_torque(state: State, p: Parameters) -> jax.Array:
    """Return the guides' friction torque on the head [N m], opposing the motion."""
    return jnp.asarray(p.guides.torque(total_tension(state.torsion, state.shortening, p), state.bristles))


def potential(torsion: jax.Array, shortening: jax.Array, p: Parameters) -> jax.Array:
    """Return the relaxed potential energy V(φ, x; ℓ_c) of silicone and tendons [J]."""
    tendons = sum(tendon_energy(stretch, p) for stretch in tendon_stretch(torsion, shortening, p))
    return silicone_energy(torsion, shortening, p) + tendons


def _strain_energy(torsion: jax.Array, shortening: jax.Array, state: State, p: Parameters) -> jax.Array:
    stored = viscoelastic_energy(torsion, shortening, state.memory, state.axial_memory, p)
    return potential(torsion, shortening, p) + stored


def head_torque(slope: jax.Array, friction: jax.Array, state: State, p: Parameters) -> jax.Array:
    """Return the torque on the head [N m], the lever's inertia apart.

    slope: of the strain energy, ∂V/∂φ [N m]. friction: torque of the guides [N m].
    """
    return -slope - p.viscous * state.torsion_rate - friction


def head_forces(state: State, p: Parameters) -> tuple[jax.Array, jax.Array]:
    """Return (torque on the head, the lever's inertia apart [N m]; ∂V/∂x [N]), by automatic differentiation."""
    slope = jax.grad(_strain_energy, argnums=(0, 1))(state.torsion, state.shortening, state, p)
    return head_torque(slope[0], friction_torque(state, p), state, p), slope[1]


def axial_omega(grip: float, p: Parameters) -> float:
    """Return ω of the head along its axis, the silicone unrelaxed [rad/s]. grip: of all tendons together [N/m]."""
    return math.sqrt((grip + float(axial_stiffness(p) * glassy_factor(p))) / float(p.head_mass))


def rate(time_s: jax.Array, state: State, p: Parameters) -> State:
    """Return the time derivative of the state.

    Kinetic energy T = ½ I_h φ̇² + ½ I_l (φ̇ + θ̇)² + ½ J_a θ̇² + ½ m_h ẋ²; forces are -∇V. The rotor's spin about its own
    axis adds J_a/353 to the coupling and is left out.
    """
    torque, axial_slope = head_forces(state, p)
    goal, goal_rate, goal_acceleration = commanded_angle(time_s, p)
    horn = horn_torque(duty(goal - state.lever, p), state.lever_rate, p)

    locked = (p.locked_stop > 0) & (time_s >= p.stop_s)
    prescribed = (p.prescribed > 0) | locked
    lever_acceleration = jnp.where(prescribed, goal_acceleration, free_lever_acceleration(torque, horn, p))
    moving = derivative(state, torque, axial_slope, lever_acceleration, p)
    return moving._replace(
        lever=jnp.where(prescribed, goal_rate, state.lever_rate),
        lever_rate=jnp.where(locked, -state.lever_rate / LOCKING_TIME, lever_acceleration),
    )


def free_lever_acceleration(torque: jax.Array, horn: jax.Array, p: Parameters) -> jax.Array:
    """Return θ̈ [rad/s²] of a lever that only its motor's torque `horn` moves; `torque` acts on the head [N m].

    [I_h + I_l, I_l; I_l, I_l + J_a] [φ̈; θ̈] = [torque; horn].
    """
    a, b, c = p.head + p.lever, p.lever, p.lever + p.armature
    determinant = a * c - b * b
    return (a * horn - b * torque) / determinant


def derivative(
    state: State, torque: jax.Array, axial_slope: jax.Array, lever_acceleration: jax.Array, p: Parameters
) -> State:
    """Return the time derivative of the state under given forces.

    torque: on the head, the lever's inertia apart [N m]. axial_slope: ∂V/∂x [N]. lever_acceleration: θ̈ [rad/s²].
    """
    a, b = p.head + p.lever, p.lever
    torsion_acceleration = (torque - b * lever_acceleration) / a
    times = relaxation_times()
    speed = state.torsion_rate
    w = p.low_pass_omega
    return State(
        torsion=speed,
        torsion_rate=torsion_acceleration,
        shortening=state.shortening_rate,
        shortening_rate=-axial_slope / p.head_mass,
        lever=state.lever_rate,
        lever_rate=lever_acceleration,
        bristles=p.guides.rates(speed, state.bristles),
        memory=tuple((state.torsion - q) / tau for q, tau in zip(state.memory, times, strict=True)),
        axial_memory=tuple((state.shortening - u) / tau for u, tau in zip(state.axial_memory, times, strict=True)),
        gyro=state.gyro_rate,
        gyro_rate=w * w * (speed - state.gyro) - jnp.sqrt(2.0) * w * state.gyro_rate,
    )


def mechanical_energy(state: State, p: Parameters) -> jax.Array:
    """Return kinetic plus stored energy [J]; the bristles' energy is counted with the friction work."""
    lever = state.torsion_rate + state.lever_rate
    kinetic = p.head * state.torsion_rate**2 + p.lever * lever**2 + p.armature * state.lever_rate**2
    kinetic = 0.5 * (kinetic + p.head_mass * state.shortening_rate**2)
    return kinetic + _strain_energy(state.torsion, state.shortening, state, p)


def dissipation(time_s: jax.Array, state: State, p: Parameters) -> tuple[jax.Array, jax.Array]:
    """Return (power lost in silicone, viscous damper and guides, power delivered by the horn) [W]."""
    silicone = silicone_power(state.torsion, state.shortening, state.memory, state.axial_memory, p)
    lost = p.viscous * state.torsion_rate**2 + friction_torque(state, p) * state.torsion_rate + silicone
    goal, _, _ = commanded_angle(time_s, p)
    horn = horn_torque(duty(goal - state.lever, p), state.lever_rate, p)
    return lost, horn * state.lever_rate
