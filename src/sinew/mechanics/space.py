"""The joint in space: a rod with head, lever and tendons; its energy, its motion, and what its head does.

Frame B sits at the foot of the rod with x along the unloaded rod; H is the head plate's, at the rod's end. A joint that
stands straight and twists is the torsional joint of `sinew.mechanics.joint`, but for the weight and the rod's inertia.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.measure.arrays import Array
from sinew.mechanics.drive import commanded_angle, duty, horn_torque
from sinew.mechanics.joint import LOCKING_TIME
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.rod import (
    Rates,
    Rod,
    Sections,
    grid,
    memory_energy,
    memory_power,
    move_rod,
    rest_strains,
    rod_energy,
    rod_poses,
)
from sinew.mechanics.silicone import BRANCHES, relaxation_times
from sinew.mechanics.tendons import guide_points, tendon_energy, tendon_tension


class Space(NamedTuple):
    """Everything that the equations of motion in space need, in SI; leaves are scalars or small arrays.

    rod. head_mass [kg] and head_height [m]: of what is fixed to the plate, its centre of mass above the plate on the
    axis; head_tensor: its moments about its centre along x, y, z [kg m²]. lever_mass, lever_height, lever_tensor: of
    the lever with its weights, the tensor in the lever's own axes, of which y is along the arms.
    weight: acceleration of gravity in frame B (3,) [m/s²].
    channel: 1 where tendons run in a channel of the silicone, 0 where they are chords from plate to plate.
    cable_end, held_tension: of each tendon (tendon,) [m], [N]; they stand for those of the joint. pulls: amplitude with
    which each motor takes up its tendon in time with the drive (tendon,) [m].
    blow: angular impulse on the head about x, y, z of B [N m s], given within `BLOW_S` from the start as 1 - cos goes,
    which a few steps of RK4 add up exactly.
    added: inertia of coordinates that are too stiff for the time step (6 term, 6 term) [kg m²]; see `solve.spatial`.
    """

    rod: Rod
    head_mass: jax.Array
    head_height: jax.Array
    head_tensor: jax.Array
    lever_mass: jax.Array
    lever_height: jax.Array
    lever_tensor: jax.Array
    weight: jax.Array
    channel: jax.Array
    cable_end: jax.Array | Array
    held_tension: jax.Array | Array
    pulls: jax.Array
    blow: jax.Array
    added: jax.Array | Array

    @property
    def joint(self) -> Parameters:
        """The numbers of the torsional joint, its tendons set one by one."""
        return self.rod.joint._replace(
            cable_end=jnp.asarray(self.cable_end), held_tension=jnp.asarray(self.held_tension)
        )


BLOW_S = 5e-3
"""How long a blow lasts [s]: four steps."""


class SpaceState(NamedTuple):
    """State of one lane: coordinates of the rod q and their rate (6, term); lever θ against the head and its rate;
    memory: coordinates of the silicone's dashpots (branch, 6, term); bristles of the guides; gyro and gyro_rate: the
    low-pass of the gyroscope, axes of H (3,)."""

    q: jax.Array
    q_rate: jax.Array
    lever: jax.Array
    lever_rate: jax.Array
    memory: jax.Array
    bristles: tuple[jax.Array, ...]
    gyro: jax.Array
    gyro_rate: jax.Array


def space_at_rest(q: jax.Array, space: Space) -> SpaceState:
    """Return the state of a joint that has rested at q until the silicone relaxed; a prescribed lever is under way."""
    p, zero = space.rod.joint, jnp.zeros(())
    start = jnp.where(p.prescribed > 0, p.amplitude * p.omega, 0.0)
    memory = jnp.broadcast_to(q, (BRANCHES, *q.shape))
    return SpaceState(
        q, jnp.zeros_like(q), zero, start, memory, (zero,) * len(p.guides.spread), jnp.zeros(3), jnp.zeros(3)
    )


def twist_and_tilt(matrix: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Return (torsion about x [rad], tilt as a rotation vector about y and z of B (2,) [rad]) of a head's rotation.

    Swing and twist: the head first twists about its own axis, then swings about an axis across, so that a pure bend
    in any direction has no torsion. Undefined where the head looks down.
    """
    torsion = jnp.arctan2(matrix[2, 1] - matrix[1, 2], matrix[1, 1] + matrix[2, 2])
    across = jnp.stack([-matrix[2, 0], matrix[1, 0]])
    sine_square = across @ across
    small = sine_square < 1e-12
    sine = jnp.sqrt(jnp.where(small, 1.0, sine_square))
    ratio = jnp.where(small, 1 + sine_square / 6, jnp.arctan2(sine, matrix[0, 0]) / sine)
    return torsion, across * ratio


def head_motion(q: jax.Array, space: Space) -> tuple[jax.Array, jax.Array]:
    """Return (torsion [rad], tilt (2,) [rad]) of the head at coordinates q."""
    rotations, _ = rod_poses(q, space.rod)
    return twist_and_tilt(rotations[-1])


def tendon_spans(q: jax.Array, space: Space) -> jax.Array:
    """Return the length of every tendon between its guides [m], (tendon,): chords, or along channels in the silicone.

    A channel keeps its place in the section, so its length is ∫|ν + κ × a| ds. Where guides are further apart than the
    rod is long, the rest is straight.
    """
    rotations, positions = rod_poses(q, space.rod)
    _, chord = _chords(rotations[-1], positions[-1], space)
    return jnp.where(space.channel > 0, _channels(q, space), jnp.sqrt(jnp.sum(chord**2, axis=1)))


def plate_guides(space: Space) -> tuple[jax.Array, jax.Array]:
    """Return the guides of the base in B and those of the head in H, from the plates' centres (tendon, 3) [m]."""
    p = space.rod.joint
    both = (guide_points(radius, p.guide_directions) for radius in (p.base_radius, p.head_radius))
    feet, guides = (jnp.stack([jnp.stack(v) for v in points]) for points in both)
    return feet, guides


def _chords(head: jax.Array, plate: jax.Array, space: Space) -> tuple[jax.Array, jax.Array]:
    """Return (guides of the head, the ways to them from those of the base), in B (tendon, 3) [m], of a head turned by
    a matrix (3, 3) at a place (3,) [m]."""
    feet, guides = plate_guides(space)
    gap = _AXIS * (space.rod.joint.free_span - space.rod.joint.length)
    there = plate + (guides + gap) @ head.T
    return there, there - feet


def _channels(q: jax.Array, space: Space) -> jax.Array:
    """Return the length of every tendon in a channel of the silicone [m], (tendon,)."""
    p = space.rod.joint
    g = grid(q.shape[1])
    strains = rest_strains(space.rod) + g.at_nodes @ q.T
    arms = 0.5 * sum(plate_guides(space))
    tangents = strains[:, None, 3:] + jnp.cross(strains[:, None, :3] / p.length, arms)
    along = jnp.einsum("n,nt->t", g.weights, jnp.sqrt(jnp.sum(tangents**2, axis=2))) * p.length
    return along + p.free_span - p.length


def cable_ends(time_s: jax.Array, space: Space) -> jax.Array:
    """Return the length at which each tendon goes slack [m], (tendon,), driven in time with the lever."""
    p = space.rod.joint
    driven = jnp.where(time_s < p.stop_s, jnp.sin(p.omega * time_s), 0.0)
    return jnp.asarray(space.cable_end - space.pulls * driven)


def tensions(q: jax.Array, space: Space, cable_end: jax.Array | None = None) -> jax.Array:
    """Return the tension of every tendon [N], (tendon,). cable_end: of tendons that are driven."""
    joint = space.joint
    return tendon_tension(tendon_spans(q, space) - (joint.cable_end if cable_end is None else cable_end), joint)


def weight_energy(q: jax.Array, space: Space) -> jax.Array:
    """Return the potential energy of head, lever and rod in gravity [J]."""
    rotations, positions = rod_poses(q, space.rod)
    return -_moment_of_mass(rotations, positions, space) @ space.weight


def _moment_of_mass(rotations: jax.Array, positions: jax.Array, space: Space) -> jax.Array:
    mass = space.head_mass + space.lever_mass
    above = space.head_mass * space.head_height + space.lever_mass * space.lever_height
    line = space.rod.line_mass * space.rod.joint.length
    return mass * positions[-1] + above * rotations[-1][:, 0] + line * jnp.asarray(grid().weights) @ positions[:-1]


def space_potential(q: jax.Array, space: Space, cable_end: jax.Array | None = None) -> jax.Array:
    """Return the relaxed potential energy of silicone, tendons and weight at q (6, term) [J]."""
    ends = space.cable_end if cable_end is None else cable_end
    tendons = jnp.sum(tendon_energy(tendon_spans(q, space) - ends, space.joint))
    return rod_energy(q, space.rod) + tendons + weight_energy(q, space)


def _lever_tensor(lever: jax.Array, space: Space) -> jax.Array:
    """Return the lever's moments about its centre in the head's axes (3, 3) at its angle [rad]."""
    c, s = jnp.cos(lever), jnp.sin(lever)
    a, b = space.lever_tensor[1], space.lever_tensor[2]
    zero = jnp.zeros_like(c)
    return jnp.array(
        [
            [space.lever_tensor[0], zero, zero],
            [zero, a * c * c + b * s * s, (a - b) * c * s],
            [zero, (a - b) * c * s, a * s * s + b * c * c],
        ]
    )


class Motion(NamedTuple):
    """How coordinates move the bodies. mass: M (18, 18) with the lever locked; lever_row: its coupling to the lever
    (18,); bias: generalised force of centrifugal and gyroscopic terms (18,), lever_bias: the same on the lever; spin:
    angular velocity of the head in its own axes (3,), spin_bias: its rate where coordinates do not accelerate;
    sections, rates: the rod's, see `mechanics.rod`."""

    mass: jax.Array
    lever_row: jax.Array
    bias: jax.Array
    lever_bias: jax.Array
    spin: jax.Array
    spin_bias: jax.Array
    sections: Sections
    rates: Rates


_AXIS = np.array([1.0, 0.0, 0.0])


def motion_of(q: jax.Array, q_rate: jax.Array, lever: jax.Array, lever_rate: jax.Array, space: Space) -> Motion:
    """Return mass and bias of the equations M q̈ + m θ̈ + bias = forces, at a state.

    Bodies are sections of the rod at the nodes, head, lever. With J their velocities by coordinates: M = Jᵀ m J and
    bias = Jᵀ m J̇ q̇ with Euler's gyroscopic terms, all in frame B.
    """
    sections, rates = move_rod(q, q_rate, space.rod)
    g = grid(q.shape[1])
    share = jnp.asarray(g.weights) * space.rod.joint.length
    head = sections.turned[-1]
    points, masses, section = _mass_points(sections, space)
    lever_tensor = _lever_tensor(lever, space)
    tensor = jnp.diag(space.head_tensor) + lever_tensor
    own = jnp.concatenate([share[:, None, None] * jnp.diag(jnp.stack(space.rod.line_inertia)), tensor[None]])
    tensors = sections.turned @ own @ jnp.swapaxes(sections.turned, 1, 2)

    velocities = sections.velocities(points, section).reshape(-1, q.size)
    turns = sections.turns.reshape(-1, q.size // 2)
    momenta = (tensors @ sections.turns).reshape(turns.shape)
    mass = (jnp.repeat(masses, 3)[:, None] * velocities).T @ velocities
    mass = mass.at[: q.size // 2, : q.size // 2].add(momenta.T @ turns)

    # The lever turns against the head: L = I ω + I_l (ω + θ̇ e_x), its tensor turning with it.
    spin, spin_bias = rates.spin[-1] @ head, rates.spin_bias[-1] @ head
    relative = lever_rate * _AXIS
    whole = spin + relative
    turning = jnp.cross(relative, lever_tensor @ whole) - lever_tensor @ jnp.cross(relative, whole)
    lever_momentum = lever_tensor @ whole
    head_gyration = turning + jnp.cross(spin, space.head_tensor * spin + lever_momentum)
    rod_spin = rates.spin[:-1]
    rod_gyration = jnp.cross(rod_spin, jnp.einsum("bij,bj->bi", tensors[:-1], rod_spin))
    gyration = jnp.concatenate([rod_gyration, (head @ head_gyration)[None]])
    torques = jnp.einsum("bij,bj->bi", tensors, rates.spin_bias) + gyration
    forces = masses[:, None] * rates.acceleration(points, section)
    bias = forces.ravel() @ velocities
    bias = bias.at[: q.size // 2].add(torques.ravel() @ turns)

    lever_row = space.lever_tensor[0] * (head[:, 0] @ sections.spins[-1])
    lever_bias = (lever_tensor @ spin_bias + turning + jnp.cross(spin, lever_momentum))[0]
    return Motion(mass, lever_row, bias, lever_bias, spin, spin_bias, sections, rates)


def _mass_points(sections: Sections, space: Space) -> tuple[jax.Array, jax.Array, NDArray[np.intp]]:
    """Return (centres of mass in B (body, 3) [m], masses (body,) [kg], section that each is fixed to (body,)): of the
    rod's sections at the nodes, of the head, of the lever."""
    heights = jnp.stack([space.head_height, space.lever_height])
    above = sections.places[-1] + heights[:, None] * sections.turned[-1][:, 0]
    rod = jnp.asarray(grid().weights) * space.rod.joint.length * space.rod.line_mass
    masses = jnp.concatenate([rod, jnp.stack([space.head_mass, space.lever_mass])])
    nodes = sections.places.shape[0] - 1
    return (
        jnp.concatenate([sections.places[:-1], above]),
        masses,
        np.array([*range(nodes), nodes, nodes], dtype=np.intp),
    )


class Pull(NamedTuple):
    """What a state feels: force -∂V/∂q with guides and dampers (18,) [J]; the friction's torque [N m]; torsion rate
    [rad/s]; tensions [N] and spans [m] (tendon,)."""

    force: jax.Array
    friction: jax.Array
    torsion_rate: jax.Array
    tension: jax.Array
    spans: jax.Array


def pull_of(time_s: jax.Array, state: SpaceState, space: Space, moved: Motion | None = None) -> Pull:
    """Return the generalised forces of a state, the inertia's apart. moved: how its coordinates move the bodies, where
    that is known.

    Guides rub and the damper acts on the head's torsion, as in the torsional joint; what tendons lose at their guides
    while the head tilts is not known and left out. Forces on the bodies act through their velocities by coordinates;
    the silicone's, which sections have for themselves, are the slope of its energy.
    """
    p = space.rod.joint
    moved = moved or motion_of(state.q, state.q_rate, state.lever, state.lever_rate, space)
    sections, rates = moved.sections, moved.rates
    ends = cable_ends(time_s, space)
    head, plate = sections.turned[-1], sections.places[-1]
    guides, chord = _chords(head, plate, space)
    chords = jnp.sqrt(jnp.sum(chord**2, axis=1))
    channels = _channels(state.q, space)
    spans = jnp.where(space.channel > 0, channels, chords)
    tension = tendon_tension(spans - ends, space.joint)

    def stored(q: jax.Array) -> jax.Array:
        own = rod_energy(q, space.rod) + memory_energy(q, state.memory, space.rod)
        return own + space.channel * (jax.lax.stop_gradient(tension) @ _channels(q, space))

    slope = jax.grad(stored)(state.q).ravel()
    # Chords pull the head by a force and a torque about the foot; so does the weight, section by section.
    pulled = (1 - space.channel) * (tension / chords)[:, None] * chord
    turned = jnp.sum(jnp.cross(guides, pulled), axis=0)
    points, masses, section = _mass_points(sections, space)
    weights = (masses[:, None] * space.weight).ravel() @ sections.velocities(points, section).reshape(-1, slope.size)
    by_torsion, torsion_rate = _torsion_by(sections.spins[-1], head), _torsion_by(rates.spin[-1], head)
    friction = p.guides.torque(jnp.sum(tension), state.bristles)
    resisting = friction + p.viscous * torsion_rate
    force = weights - slope - jnp.sum(pulled, axis=0) @ sections.moves[-1] - turned @ sections.spins[-1]
    return Pull(force - resisting * by_torsion, friction, torsion_rate, tension, spans)


def _torsion_by(spin: jax.Array, head: jax.Array) -> jax.Array:
    """Return the torsion's rate from the angular velocity of the head in B (3, ...): ω·(e + n)/(1 + e·n), e the axis of
    the base and n that of the head."""
    along = head[:, 0] + _AXIS
    return along @ spin / along[0]


def space_derivative(time_s: jax.Array, state: SpaceState, space: Space) -> tuple[SpaceState, Motion, Pull]:
    """Return (time derivative of the state, how its coordinates move the bodies, what it feels).

    The lever is driven by its servo, or follows its command, or is locked after a stop, as in `mechanics.joint`.
    """
    p = space.rod.joint
    moved = motion_of(state.q, state.q_rate, state.lever, state.lever_rate, space)
    felt = pull_of(time_s, state, space, moved)
    goal, goal_rate, goal_acceleration = commanded_angle(time_s, p)
    horn = horn_torque(duty(goal - state.lever, p), state.lever_rate, p)
    locked = (p.locked_stop > 0) & (time_s >= p.stop_s)
    prescribed = (p.prescribed > 0) | locked

    hit = jnp.where(time_s < BLOW_S, (1 - jnp.cos(2 * jnp.pi / BLOW_S * time_s)) / BLOW_S, 0.0) * space.blow
    force = felt.force + hit @ moved.sections.spins[-1] - moved.bias
    acceleration, free = free_acceleration(force, horn, moved, space, goal_acceleration, prescribed)
    after = state_rate(state, acceleration, free, moved, felt, space)
    after = after._replace(
        lever=jnp.where(prescribed, goal_rate, state.lever_rate),
        lever_rate=jnp.where(locked, -state.lever_rate / LOCKING_TIME, free),
    )
    return after, moved, felt


def _eliminated(mass: jax.Array, right: jax.Array) -> jax.Array:
    """Return the solution of a system with a mass matrix by Gauss-Jordan elimination, which needs no pivots there.

    A call to LAPACK would send the whole program to JAX's one thread, where two of them wait for one another. The
    coupled balance, which is differentiated, has its own: `solve.balance.solve`.
    """
    table = jnp.concatenate([mass, right], axis=1)
    for k in range(mass.shape[0]):
        row = table[k, 1:] / table[k, 0]
        table = (table[:, 1:] - table[:, :1] * row).at[k].set(row)
    return table


def free_acceleration(
    force: jax.Array,
    horn: jax.Array,
    moved: Motion,
    space: Space,
    given: jax.Array | float = 0.0,
    prescribed: jax.Array | bool = False,
    solved: Callable[[jax.Array, jax.Array], jax.Array] = _eliminated,
) -> tuple[jax.Array, jax.Array]:
    """Return accelerations (of the coordinates (18,), of the lever [rad/s²]) under generalised forces.

    force: on the coordinates, less `moved.bias` (18,). horn: torque of the drive [N m]. given: acceleration of a lever
    that is `prescribed`. solved: how systems of equations with a mass matrix are solved.
    """
    # The servo's lever is one more coordinate, eliminated; the prescribed one's acceleration is given.
    both = solved(moved.mass + space.added, jnp.stack([force, moved.lever_row], axis=1))
    free = (horn - moved.lever_bias - moved.lever_row @ both[:, 0]) / (
        space.lever_tensor[0] + space.rod.joint.armature - moved.lever_row @ both[:, 1]
    )
    lever_acceleration = jnp.where(prescribed, given, free)
    return both[:, 0] - both[:, 1] * lever_acceleration, lever_acceleration


def state_rate(
    state: SpaceState, acceleration: jax.Array, lever_acceleration: jax.Array, moved: Motion, felt: Pull, space: Space
) -> SpaceState:
    """Return the time derivative of the state at given accelerations of coordinates (18,) and lever."""
    p = space.rod.joint
    times = jnp.asarray(relaxation_times())[:, None, None]
    w = p.low_pass_omega
    return SpaceState(
        q=state.q_rate,
        q_rate=acceleration.reshape(state.q.shape),
        lever=state.lever_rate,
        lever_rate=lever_acceleration,
        memory=(state.q - state.memory) / times,
        bristles=p.guides.rates(felt.torsion_rate, state.bristles),
        gyro=state.gyro_rate,
        gyro_rate=w * w * (moved.spin - state.gyro) - jnp.sqrt(2.0) * w * state.gyro_rate,
    )


def space_energy(time_s: jax.Array, state: SpaceState, space: Space) -> jax.Array:
    """Return kinetic plus stored energy [J], that of bent bristles apart; with what is added to stiff coordinates."""
    p = space.rod.joint
    moved = motion_of(state.q, state.q_rate, state.lever, state.lever_rate, space)
    speed = state.q_rate.ravel()
    kinetic = 0.5 * speed @ (moved.mass + space.added) @ speed + state.lever_rate * (moved.lever_row @ speed)
    kinetic = kinetic + 0.5 * (space.lever_tensor[0] + p.armature) * state.lever_rate**2
    stored = space_potential(state.q, space, cable_ends(time_s, space))
    return kinetic + stored + memory_energy(state.q, state.memory, space.rod)


def space_dissipation(time_s: jax.Array, state: SpaceState, space: Space) -> tuple[jax.Array, jax.Array]:
    """Return (power lost in silicone, damper and guides, power of drive and tendon motors) [W]; not that of a blow."""
    p = space.rod.joint
    felt = pull_of(time_s, state, space)
    lost = p.viscous * felt.torsion_rate**2 + felt.friction * felt.torsion_rate
    goal, _, _ = commanded_angle(time_s, p)
    horn = horn_torque(duty(goal - state.lever, p), state.lever_rate, p)
    ends_rate = jax.jvp(lambda t: cable_ends(t, space), (time_s,), (jnp.ones_like(time_s),))[1]
    given = horn * state.lever_rate - felt.tension @ ends_rate
    return lost + memory_power(state.q, state.memory, space.rod), given
