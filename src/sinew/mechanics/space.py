"""The joint in space: a rod with head, lever and tendons; its energy, its motion, and what its head does.

Frame B sits at the foot of the rod with x along the unloaded rod; H is the head plate's, at the rod's end. A joint that
stands straight and twists is the torsional joint of `sinew.mechanics.joint`, but for the weight and the rod's inertia.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from sinew.mechanics.drive import commanded_angle, duty, horn_torque
from sinew.mechanics.joint import LOCKING_TIME
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.rod import Rod, grid, hat, memory_energy, memory_power, rest_strains, rod_energy, rod_poses
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
    blow: angular impulse on the head about x, y, z of B [N m s], given evenly within `BLOW_S` from the start.
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
    cable_end: jax.Array
    held_tension: jax.Array
    pulls: jax.Array
    blow: jax.Array
    added: jax.Array

    @property
    def joint(self) -> Parameters:
        """The numbers of the torsional joint, its tendons set one by one."""
        return self.rod.joint._replace(cable_end=self.cable_end, held_tension=self.held_tension)


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
    p = space.rod.joint
    rotations, positions = rod_poses(q, space.rod)
    feet = jnp.stack([jnp.stack(v) for v in guide_points(p.base_radius, p.guide_directions)])
    guides = jnp.stack([jnp.stack(v) for v in guide_points(p.head_radius, p.guide_directions)])
    gap = jnp.array([1.0, 0.0, 0.0]) * (p.free_span - p.length)
    chord = positions[-1] + (guides + gap) @ rotations[-1].T - feet
    straight = jnp.sqrt(jnp.sum(chord**2, axis=1))

    g = grid(q.shape[1])
    strains = rest_strains(space.rod) + g.at_nodes @ q.T
    arms = 0.5 * (feet + guides)
    tangents = strains[:, None, 3:] + jnp.cross(strains[:, None, :3] / p.length, arms)
    along = jnp.einsum("n,nt->t", g.weights, jnp.sqrt(jnp.sum(tangents**2, axis=2))) * p.length
    return jnp.where(space.channel > 0, along + p.free_span - p.length, straight)


def cable_ends(time_s: jax.Array, space: Space) -> jax.Array:
    """Return the length at which each tendon goes slack [m], (tendon,), while motors move it in time with the drive."""
    p = space.rod.joint
    driven = jnp.where(time_s < p.stop_s, jnp.sin(p.omega * time_s), 0.0)
    return space.cable_end - space.pulls * driven


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
    spins: ∂spin/∂q̇ (3, 18); reach, reach_bias: the same of the plate's velocity, in B."""

    mass: jax.Array
    lever_row: jax.Array
    bias: jax.Array
    lever_bias: jax.Array
    spin: jax.Array
    spin_bias: jax.Array
    spins: jax.Array
    reach: jax.Array
    reach_bias: jax.Array


def motion_of(q: jax.Array, q_rate: jax.Array, lever: jax.Array, lever_rate: jax.Array, space: Space) -> Motion:
    """Return mass and bias of the equations M q̈ + m θ̈ + bias = forces, at a state.

    Bodies are sections of the rod at the nodes, head, lever. With J their velocities by coordinates: M = Jᵀ m J and
    bias = Jᵀ m J̇ q̇ with Euler's gyroscopic terms.
    """
    count = q.size

    def place(flat: jax.Array) -> tuple[jax.Array, jax.Array]:
        return rod_poses(flat.reshape(q.shape), space.rod)

    flat, speed = q.ravel(), q_rate.ravel()
    (turned, _), push = jax.linearize(place, flat)
    by_turn, by_place = jax.vmap(push)(jnp.eye(count))  # (coordinate, body, 3, 3), (coordinate, body, 3)

    def velocity(at: jax.Array) -> tuple[jax.Array, jax.Array]:
        return jax.jvp(place, (at,), (speed,))[1]

    _, (turn_bias, place_bias) = jax.jvp(velocity, (flat,), (speed,))
    # Rᵀ dR is the cross product with the angular velocity in the body's axes.
    spins = _vee(jnp.einsum("bji,cbjk->cbik", turned, by_turn))  # (coordinate, body, 3)
    spin = jnp.einsum("c,cbi->bi", speed, spins)
    crossed = jax.vmap(hat)(spin)
    spin_bias = _vee(jnp.einsum("bji,bjk->bik", turned, turn_bias) - crossed @ crossed)

    g = grid(q.shape[1])
    share = jnp.asarray(g.weights) * space.rod.joint.length
    line = jnp.stack(space.rod.line_inertia)
    rod_tensor = share[:, None, None] * jnp.diag(line)
    rod_mass = share * space.rod.line_mass

    head = turned[-1]
    arms = jnp.stack([space.head_height, space.lever_height])
    masses = jnp.stack([space.head_mass, space.lever_mass])
    along = head[:, 0]
    axis_by = by_turn[:, -1, :, 0]  # of the head's x axis, by coordinates
    axis_bias = turn_bias[-1][:, 0]
    centre_by = by_place[:, -1, None, :] + arms[:, None] * axis_by[:, None, :]  # (coordinate, body, 3)
    centre_bias = place_bias[-1] + arms[:, None] * axis_bias
    del along

    lever_tensor = _lever_tensor(lever, space)
    tensor = jnp.diag(space.head_tensor) + lever_tensor
    translation = jnp.concatenate([by_place[:, :-1], centre_by], axis=1)
    all_masses = jnp.concatenate([rod_mass, masses])
    acceleration = jnp.concatenate([place_bias[:-1], centre_bias])
    momenta = all_masses[:, None] * translation
    tensors = jnp.concatenate([rod_tensor, tensor[None]])
    turned_momenta = jnp.einsum("bij,cbj->cbi", tensors, spins)
    mass = jnp.einsum("cbi,dbi->cd", momenta, translation) + jnp.einsum("cbi,dbi->cd", turned_momenta, spins)

    # The lever turns against the head: L = I ω + I_l (ω + θ̇ e_x), its tensor turning with it.
    whole = spin[-1] + jnp.array([1.0, 0.0, 0.0]) * lever_rate
    unit = jnp.array([1.0, 0.0, 0.0])
    relative = lever_rate * unit
    turning = jnp.cross(relative, lever_tensor @ whole) - lever_tensor @ jnp.cross(relative, whole)
    rod_gyration = jnp.cross(spin[:-1], jnp.einsum("bij,bj->bi", rod_tensor, spin[:-1]))
    head_momentum = space.head_tensor * spin[-1] + lever_tensor @ whole
    gyration = jnp.concatenate([rod_gyration, (turning + jnp.cross(spin[-1], head_momentum))[None]])
    torques = jnp.einsum("bij,bj->bi", tensors, spin_bias) + gyration
    bias = jnp.einsum("cbi,bi->c", momenta, acceleration) + jnp.einsum("cbi,bi->c", spins, torques)

    lever_row = jnp.einsum("ci,i->c", spins[:, -1], lever_tensor @ unit)
    lever_bias = (lever_tensor @ spin_bias[-1] + turning + jnp.cross(spin[-1], lever_tensor @ whole))[0]
    return Motion(
        mass, lever_row, bias, lever_bias, spin[-1], spin_bias[-1], spins[:, -1].T, by_place[:, -1].T, place_bias[-1]
    )


def _vee(matrix: jax.Array) -> jax.Array:
    """Return the vectors of skew matrices (..., 3, 3); what is not skew in them is dropped."""
    pairs = [(2, 1), (0, 2), (1, 0)]
    return jnp.stack([0.5 * (matrix[..., i, j] - matrix[..., j, i]) for i, j in pairs], axis=-1)


class Pull(NamedTuple):
    """What a state feels: force -∂V/∂q with guides, dampers and blow (18,) [J]; the friction's torque [N m]; torsion
    rate [rad/s]; tensions (tendon,) [N]."""

    force: jax.Array
    friction: jax.Array
    torsion_rate: jax.Array
    tension: jax.Array


def pull_of(time_s: jax.Array, state: SpaceState, space: Space) -> Pull:
    """Return the generalised forces of a state, the inertia's apart.

    Guides rub and the damper acts on the head's torsion, as in the torsional joint; what tendons lose at their guides
    while the head tilts is not known and left out.
    """
    p = space.rod.joint
    ends = cable_ends(time_s, space)

    def stored(q: jax.Array) -> jax.Array:
        return space_potential(q, space, ends) + memory_energy(q, state.memory, space.rod)

    def torsion(q: jax.Array) -> jax.Array:
        return head_motion(q, space)[0]

    slope = jax.grad(stored)(state.q)
    by_torsion = jax.grad(torsion)(state.q)
    torsion_rate = jnp.sum(by_torsion * state.q_rate)
    tension = tensions(state.q, space, ends)
    friction = p.guides.torque(jnp.sum(tension), state.bristles)
    resisting = friction + p.viscous * torsion_rate
    return Pull((-slope - resisting * by_torsion).ravel(), friction, torsion_rate, tension)


def space_rate(time_s: jax.Array, state: SpaceState, space: Space) -> SpaceState:
    """Return the time derivative of the state."""
    return space_derivative(time_s, state, space)[0]


def space_derivative(time_s: jax.Array, state: SpaceState, space: Space) -> tuple[SpaceState, Motion, Pull]:
    """Return (time derivative of the state, how its coordinates move the bodies, what it feels).

    The lever is driven by its servo, or follows its command, or is locked after a stop, as in `mechanics.joint`.
    """
    p = space.rod.joint
    moved = motion_of(state.q, state.q_rate, state.lever, state.lever_rate, space)
    felt = pull_of(time_s, state, space)
    goal, goal_rate, goal_acceleration = commanded_angle(time_s, p)
    horn = horn_torque(duty(goal - state.lever, p), state.lever_rate, p)
    locked = (p.locked_stop > 0) & (time_s >= p.stop_s)
    prescribed = (p.prescribed > 0) | locked

    hit = jnp.where(time_s < BLOW_S, 1.0 / BLOW_S, 0.0) * space.blow
    rotations, _ = rod_poses(state.q, space.rod)
    blow = (rotations[-1].T @ hit) @ moved.spins
    force = felt.force + blow - moved.bias
    inertia = moved.mass + space.added
    # The servo's lever is one more coordinate, eliminated; the prescribed one's acceleration is given.
    factor = jax.scipy.linalg.cho_factor(inertia)
    both = jax.scipy.linalg.cho_solve(factor, jnp.stack([force, moved.lever_row], axis=1))
    free = (horn - moved.lever_bias - moved.lever_row @ both[:, 0]) / (
        space.lever_tensor[0] + p.armature - moved.lever_row @ both[:, 1]
    )
    lever_acceleration = jnp.where(prescribed, goal_acceleration, free)
    acceleration = both[:, 0] - both[:, 1] * lever_acceleration

    times = jnp.asarray(relaxation_times())[:, None, None]
    w = p.low_pass_omega
    after = SpaceState(
        q=state.q_rate,
        q_rate=acceleration.reshape(state.q.shape),
        lever=jnp.where(prescribed, goal_rate, state.lever_rate),
        lever_rate=jnp.where(locked, -state.lever_rate / LOCKING_TIME, lever_acceleration),
        memory=(state.q - state.memory) / times,
        bristles=p.guides.rates(felt.torsion_rate, state.bristles),
        gyro=state.gyro_rate,
        gyro_rate=w * w * (moved.spin - state.gyro) - jnp.sqrt(2.0) * w * state.gyro_rate,
    )
    return after, moved, felt


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
    """Return (power lost in silicone, damper and guides, power of drive and tendon motors) [W], a blow left out."""
    p = space.rod.joint
    felt = pull_of(time_s, state, space)
    lost = p.viscous * felt.torsion_rate**2 + felt.friction * felt.torsion_rate
    goal, _, _ = commanded_angle(time_s, p)
    horn = horn_torque(duty(goal - state.lever, p), state.lever_rate, p)
    ends_rate = jax.jvp(lambda t: cable_ends(t, space), (time_s,), (jnp.ones_like(time_s),))[1]
    given = horn * state.lever_rate - felt.tension @ ends_rate
    return lost + memory_power(state.q, state.memory, space.rod), given
