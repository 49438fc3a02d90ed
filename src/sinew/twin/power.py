"""This is where the powers of a state stand: what the drive takes up, and where it goes."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from sinew.plan.rig import RigSpec
from sinew.plan.servo import SERVOS, servo_of
from sinew.twin.drive import commanded_angle, duty, electrical_torque, gear_friction
from sinew.twin.energy import tendon_stretch, tendon_tension, twist_rigidity
from sinew.twin.motion import State, friction_torque
from sinew.twin.parameters import Parameters
from sinew.twin.prony import relaxation_times

__all__ = ["Electrics", "Powers", "electrics_of", "powers"]


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
    """Return the motors' electrical side, in which `sinew.twin.drive` has its torque line.

    R: nominal voltage over stall current. k_e = (line's slope) R/k_t: the speed at which the torque of a duty is zero.
    """
    drive, tendons = rig.drive, rig.tendons
    servo = servo_of(rig.wiring.tendon_model) or SERVOS["XH430-W350"]
    resistance = drive.nominal_voltage.value / drive.stall_current.value
    constant = (drive.stall_torque.value + drive.friction.value) / drive.stall_current.value
    slope = drive.stall_torque.value / drive.no_load_speed.value
    numbers = (
        drive.supply_voltage.value,
        resistance,
        slope * resistance / constant,
        servo.resistance,
        tendons.pulley_radius.value / tendons.torque_constant.value,
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
    stretch = 1 - state.shortening / p.length
    torsional, axial = twist_rigidity(stretch, p) / p.length, 3 * p.axial_rigidity / p.length
    silicone = jnp.zeros(())
    for weight, tau, q, u in zip(p.prony_shares, relaxation_times(), state.memory, state.axial_memory, strict=True):
        branch = torsional * (state.torsion - q) ** 2 + axial * (state.shortening - u) ** 2
        silicone = silicone + weight * branch / tau
    return Powers(
        electrical=electrical,
        drawn=jnp.maximum(electrical, 0.0),
        copper=e.resistance * current**2,
        gear=(e.back_emf - p.torque_constant) * current * state.lever_rate,
        friction=friction * state.lever_rate,
        mechanical=(torque - friction) * state.lever_rate,
        silicone=silicone,
        guides=friction_torque(state, p) * state.torsion_rate,
        viscous=p.viscous * state.torsion_rate**2,
        holding=e.tendon_resistance * e.newton**2 * jnp.asarray(sum(t**2 for t in tension)),
    )
