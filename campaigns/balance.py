"""Power balance of a steady oscillation: integrated with the motion, not sampled."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.mechanics.drive import commanded_angle, duty, electrical_torque, gear_friction
from sinew.mechanics.joint import State, friction_torque, mechanical_energy, rate, state_at_rest
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.silicone import silicone_power
from sinew.mechanics.tendons import tendon_stretch, tendon_tension
from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec
from sinew.plan.servo import SERVOS
from sinew.solve.march import runge_kutta
from sinew.twin.simulate import Lanes, lane_parameters

# The powers of a state stand: what the drive takes up, and where it goes.


class Electrics(NamedTuple):
    """What the equations of motion do not need of the motors.

    supply [V]. resistance, back_emf: of the drive [Ω], [V s/rad]. tendon_resistance [Ω]. newton: current of a tendon
    motor for a tension [A/N].
    """

    supply: jax.Array
    resistance: jax.Array
    back_emf: jax.Array
    tendon_resistance: jax.Array
    newton: jax.Array


class Powers(NamedTuple):
    """Powers of one state [W].

    electrical: into the drive's winding, duty times supply times current; drawn: of that what is not given back.
    copper: R i². gear: (k_e - k_t) i ω, what the torque at the horn lacks of the one that the back-EMF stands for.
    friction: Coulomb, at the horn. mechanical: horn's torque times its speed.
    silicone, guides, viscous: lost in the joint. holding: copper of the tendon motors.
    electrical = copper + gear + friction + mechanical at every moment; mechanical = silicone + guides + viscous +
    change of `mechanical_energy`.
    """

    electrical: jax.Array
    drawn: jax.Array
    copper: jax.Array
    gear: jax.Array
    friction: jax.Array
    mechanical: jax.Array
    silicone: jax.Array
    guides: jax.Array
    viscous: jax.Array
    holding: jax.Array


def electrics_of(rig: RigSpec) -> Electrics:
    """Return the motors' electrical side, in which `sinew.mechanics.drive` has its torque line.

    R: nominal voltage over stall current. k_e = (line's slope) R/k_t: the speed at which the torque of a duty is zero.
    """
    drive, tendons = rig.drive, rig.tendons
    servo = SERVOS[rig.wiring.tendon_model]
    numbers = (
        drive.supply_voltage.value,
        drive.resistance,
        drive.speed_slope * drive.resistance / drive.torque_constant,
        servo.resistance,
        tendons.current(1.0),
    )
    return Electrics(*(jnp.asarray(x) for x in numbers))


def powers(time_s: jax.Array, state: State, p: Parameters, e: Electrics) -> Powers:
    """Return the powers of a state whose lever is moved by its motor (not prescribed, not locked)."""
    goal, _, _ = commanded_angle(time_s, p)
    share = duty(goal - state.lever, p)
    torque = electrical_torque(share, state.lever_rate, p)
    current = torque / p.torque_constant
    electrical = share * e.supply * current
    friction = gear_friction(state.lever_rate, p)
    tension = [tendon_tension(stretch, p) for stretch in tendon_stretch(state.torsion, state.shortening, p)]
    return Powers(
        electrical=electrical,
        drawn=jnp.maximum(electrical, 0.0),
        copper=e.resistance * current**2,
        gear=(e.back_emf - p.torque_constant) * current * state.lever_rate,
        friction=friction * state.lever_rate,
        mechanical=(torque - friction) * state.lever_rate,
        silicone=silicone_power(state.torsion, state.shortening, state.memory, state.axial_memory, p),
        guides=friction_torque(state, p) * state.torsion_rate,
        viscous=p.viscous * state.torsion_rate**2,
        holding=e.tendon_resistance * e.newton**2 * jnp.asarray(sum(t**2 for t in tension)),
    )


_STEPS = 512
_LANES = 64


@dataclass(frozen=True)
class Balance:
    """Means over whole cycles of every lane, arrays (lane,): powers [W], see `campaigns.balance.Powers`.

    stored: growth of kinetic and stored energy per time; zero in a steady cycle.
    current_rms [A], of the drive; torsion, drive: amplitudes of the fundamentals [rad].
    """

    frequency_hz: Array
    electrical: Array
    drawn: Array
    copper: Array
    gear: Array
    friction: Array
    mechanical: Array
    silicone: Array
    guides: Array
    viscous: Array
    holding: Array
    stored: Array
    current_rms: Array
    torsion: Array
    drive: Array

    @property
    def drive_residual(self) -> Array:
        """Return electrical power less copper, gear, friction and mechanical power [W]: zero but for rounding."""
        return self.electrical - self.copper - self.gear - self.friction - self.mechanical

    @property
    def joint_residual(self) -> Array:
        """Return mechanical power less what the joint loses and stores [W]: zero but for the error of the steps."""
        return self.mechanical - self.silicone - self.guides - self.viscous - self.stored


def balance_groups(
    groups: Sequence[Group], rig: RigSpec, *, settle_cycles: int = 40, cycles: int = 5, rng_seed: int | None = None
) -> Balance:
    """Return the balance of driven groups, one lane each, in position mode; see `balance_lanes`.

    rng_seed: of the scatter between repeats, drawn as `sinew.twin.simulate.simulate` does with the same groups and
    seed; None for none. Raises SpecError for a group that is not steady.
    """
    if any(group.kind != "steady" for group in groups):
        raise SpecError("a power balance needs steady groups; leave ring-downs and idle groups out")
    scatter = None
    if rng_seed is not None:
        scatter = np.random.default_rng(np.random.SeedSequence(rng_seed).spawn(2)[0])
    return balance_lanes(lane_parameters(groups, rig, rng=scatter), rig, settle_cycles=settle_cycles, cycles=cycles)


def balance_lanes(lanes: Lanes, rig: RigSpec, *, settle_cycles: int = 40, cycles: int = 5) -> Balance:
    """Return the balance of lanes over `cycles` whole cycles, after `settle_cycles` from rest.

    lanes: parameters with a lane axis, and shortening at rest; their drive must run (not prescribed). All powers are
    integrated as states of their own beside the motion, with 512 steps of RK4 in a cycle.
    """
    p, shortening = lanes
    electrics = electrics_of(rig)
    count = int(np.size(shortening))
    rows = []
    for start in range(0, count, _LANES):
        index = np.minimum(np.arange(start, start + _LANES), count - 1)
        block = jax.tree.map(lambda leaf, index=index: np.asarray(leaf)[index], p)
        out = _run(block, np.asarray(shortening)[index], electrics, np.int64(settle_cycles), np.int64(cycles))
        rows.append(np.asarray(out)[:, : min(_LANES, count - start)])
    means = np.concatenate(rows, axis=1)
    names = [field.name for field in fields(Balance)][1 : 1 + len(Powers._fields) + 1]
    values = dict(zip(names, means, strict=False))
    square, t_re, t_im, d_re, d_im = means[len(names) :]
    frequency = np.broadcast_to(np.asarray(p.omega), (count,)) / (2 * np.pi)
    return Balance(
        frequency, **values, current_rms=np.sqrt(square), torsion=np.hypot(t_re, t_im), drive=np.hypot(d_re, d_im)
    )


def _flow(time_s: jax.Array, state: State, p: Parameters, e: Electrics) -> jax.Array:
    """Return what is integrated beside the motion: powers, squared current, parts of the fundamentals."""
    now = powers(time_s, state, p, e)
    c, s = 2 * jnp.cos(p.omega * time_s), 2 * jnp.sin(p.omega * time_s)
    waves = (state.torsion * c, state.torsion * s, state.lever * c, state.lever * s)
    return jnp.stack([*now, now.copper / e.resistance, *waves])


@jax.jit
def _run(p: Parameters, shortening: jax.Array, e: Electrics, settle: jax.Array, cycles: jax.Array) -> jax.Array:
    """Return means over the last cycles, (channel, lane): powers, stored, squared current, fundamentals."""

    def one(p: Parameters, shortening: jax.Array) -> jax.Array:
        step_s = 2 * jnp.pi / p.omega / _STEPS

        def slope(at: jax.Array, both: tuple[State, jax.Array]) -> tuple[State, jax.Array]:
            return rate(at, both[0], p), _flow(at, both[0], p, e)

        def step(n: jax.Array, both: tuple[State, jax.Array]) -> tuple[State, jax.Array]:
            return runge_kutta(slope, n * step_s, both, step_s)

        def only(n: jax.Array, state: State) -> State:
            return runge_kutta(lambda at, now: rate(at, now, p), n * step_s, state, step_s)

        begin = settle * _STEPS
        state = jax.lax.fori_loop(0, begin, only, state_at_rest(shortening, p))
        nothing = jnp.zeros(len(Powers._fields) + 5)
        after, total = jax.lax.fori_loop(begin, begin + cycles * _STEPS, step, (state, nothing))
        span = cycles * _STEPS * step_s
        stored = (mechanical_energy(after, p) - mechanical_energy(state, p)) / span
        mean = total / span
        return jnp.concatenate([mean[: len(Powers._fields)], stored[None], mean[len(Powers._fields) :]])

    return jax.vmap(one, out_axes=1)(p, shortening)
