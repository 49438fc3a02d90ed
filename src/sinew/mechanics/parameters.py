"""The numbers of the equations of motion, one value per lane."""

from typing import NamedTuple

import jax

from sinew.mechanics.guides import GUIDE_LAWS, GuideFriction

for _law in GUIDE_LAWS.values():
    jax.tree_util.register_dataclass(_law, ["level", "reach"], [])

POSITION, POSITION_LIMITED, CURRENT = 0.0, 1.0, 2.0
TENDON_MODES = {"position": POSITION, "position-with-current-limit": POSITION_LIMITED, "current": CURRENT}


class Parameters(NamedTuple):
    """Everything the equations of motion need, in SI; each leaf is a scalar, or has a leading lane axis.

    Silicone: length L, torsional_rigidity G·J, axial_rigidity G·A,
    warping_rigidity G·(I_p - J), bending_rigidity E·I about the weaker axis, prony_shares g_i by branch, viscous d.
    Inertia: head I_h, lever I_l, armature J_a, head_mass m_h.
    Tendons: guide_directions by tendon as (cosine, sine), radii, free_span L_t, stiffness k_t (cable and servo in
    series), cable_end ℓ_c (length at which the cable between the guides goes slack; the motor's doing),
    held_tension (current mode, or the limit), mode; guides: the law of their friction.
    Drive: duty_torque and speed_slope of the torque line, friction, position_gain, duty_limit, torque_constant.
    Motion asked for: amplitude [rad], omega [rad/s], stop_s (when the drive stops), prescribed (1: the lever
    follows the command exactly), locked_stop (1: a stopped lever is locked to the head).
    Sensor: low_pass_omega [rad/s].
    """

    length: jax.Array
    torsional_rigidity: jax.Array
    axial_rigidity: jax.Array
    warping_rigidity: jax.Array
    bending_rigidity: jax.Array
    prony_shares: tuple[jax.Array, ...]
    viscous: jax.Array
    head: jax.Array
    lever: jax.Array
    armature: jax.Array
    head_mass: jax.Array
    guide_directions: tuple[tuple[jax.Array, jax.Array], ...]
    base_radius: jax.Array
    head_radius: jax.Array
    free_span: jax.Array
    stiffness: jax.Array
    cable_end: jax.Array
    held_tension: jax.Array
    mode: jax.Array
    guides: GuideFriction
    duty_torque: jax.Array
    speed_slope: jax.Array
    drive_friction: jax.Array
    position_gain: jax.Array
    duty_limit: jax.Array
    torque_constant: jax.Array
    amplitude: jax.Array
    omega: jax.Array
    stop_s: jax.Array
    prescribed: jax.Array
    locked_stop: jax.Array
    low_pass_omega: jax.Array
