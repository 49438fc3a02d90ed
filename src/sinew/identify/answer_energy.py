"""This is where a simulated ring-down tells who took its energy: silicone, guides, or the recoiling lever's servo.

Along one and the same motion the power of every loss is integrated from one drive period after the stop on. Together
they are the energy that the swing had then, less what is left at the end. That energy holds what comes back: bristles
of the guides' friction that have not broken loose store ½ μ ΣT φ_s z², of whose torque μ ΣT z only μ ΣT z² |φ'| is lost
(Dahl); and the position loop of the servo is a spring on the lever: only back-EMF and gear friction take energy.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sinew.plan.plan import Group
from sinew.twin.drive import gear_friction
from sinew.twin.energy import total_tension, twist_rigidity
from sinew.twin.integrate import LANES, runge_kutta
from sinew.twin.motion import State, friction_torque, mechanical_energy, rate, state_at_rest
from sinew.twin.parameters import Parameters
from sinew.twin.prony import relaxation_times

__all__ = ["LOSSES", "energy_shares"]

LOSSES = ("silicone", "guides", "servo")
"""Who takes the energy; the silicone with the dashpot in parallel to it."""

_STEP_S = 1.25e-3


class _Spending(NamedTuple):
    """The state, and what each loss has taken so far [J]."""

    state: State
    silicone: jax.Array
    guides: jax.Array
    servo: jax.Array


def energy_shares(lanes: tuple[Parameters, NDArray[np.float64]], groups: list[Group]) -> NDArray[np.float64]:
    """Return what each of `LOSSES` takes of the swing's mechanical energy, shape (lane, 3).

    lanes: parameters with a lane axis and shortening at rest [m], one for each ring-down of `groups`; see
    `sinew.twin.simulate.lane_parameters`. They add up to one but for the work of a tension that changes while bristles
    are bent, a hundredth or so.
    """
    p, shortening = lanes
    free_from = np.array([group.settle_s + 1.0 / group.frequency_hz for group in groups])
    steps = jnp.asarray(int(np.ceil(max(group.duration_s for group in groups) / _STEP_S)))
    shares = []
    for start in range(0, len(groups), LANES):  # blocks of one size, so that it is compiled once
        index = np.minimum(np.arange(start, start + LANES), len(groups) - 1)
        block = jax.tree.map(lambda leaf, index=index: np.asarray(leaf)[index], p)
        shares.append(np.asarray(_spent(block, shortening[index], free_from[index], steps)))
    return np.concatenate(shares)[: len(groups)]


@jax.jit
def _spent(p: Parameters, shortening: jax.Array, free_from: jax.Array, steps: jax.Array) -> jax.Array:
    def lane(own: Parameters, rest: jax.Array, begin: jax.Array) -> jax.Array:
        zero = jnp.zeros(())
        first = _Spending(state_at_rest(rest, own), zero, zero, zero)

        def step(k: jax.Array, carry: tuple[_Spending, jax.Array]) -> tuple[_Spending, jax.Array]:
            now, energy = carry
            time_s = k * _STEP_S
            counted = time_s >= begin
            started = counted & (time_s - _STEP_S < begin)
            energy = jnp.where(started, _energy(now.state, own), energy)
            after = runge_kutta(partial(_slope, p=own), time_s, now, jnp.asarray(_STEP_S))
            kept = [jnp.where(counted, a, b) for a, b in zip(after[1:], now[1:], strict=True)]
            return _Spending(after.state, *kept), energy

        end, energy = jax.lax.fori_loop(0, steps, step, (first, zero))
        lost = energy - _energy(end.state, own)
        return jnp.asarray(jnp.stack(end[1:]) / lost)

    return jnp.asarray(jax.vmap(lane)(p, shortening, free_from))


def _slope(time_s: jax.Array, now: _Spending, p: Parameters) -> _Spending:
    state = now.state
    stretch = 1 - state.shortening / p.length
    torsional, axial = twist_rigidity(stretch, p) / p.length, 3 * p.axial_rigidity / p.length
    silicone = p.viscous * state.torsion_rate**2
    for share, tau, q, u in zip(p.prony_shares, relaxation_times(), state.memory, state.axial_memory, strict=True):
        branch = torsional * (state.torsion - q) ** 2 + axial * (state.shortening - u) ** 2
        silicone = silicone + share * branch / tau
    sliding = p.guide_friction * total_tension(state.torsion, state.shortening, p) * state.bristle**2
    drag = p.speed_slope * state.lever_rate + gear_friction(state.lever_rate, p)
    return _Spending(rate(time_s, state, p), silicone, sliding * jnp.abs(state.torsion_rate), drag * state.lever_rate)


def _energy(state: State, p: Parameters) -> jax.Array:
    """Return the mechanical energy with that of bristles and position loop [J], the drive being told to stay at 0."""
    bristles = 0.5 * p.presliding_angle * friction_torque(state, p) * state.bristle
    asked = p.position_gain * jnp.abs(state.lever)
    within = jnp.minimum(asked, p.duty_limit)
    loop = p.duty_torque * within * (asked - 0.5 * within) / p.position_gain
    return mechanical_energy(state, p) + bristles + loop
