"""This is where the stiffness of a joint at rest is told apart: silicone, tendons, guides."""

from collections.abc import Sequence

import numpy as np

from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec
from sinew.twin.simulate import lane_parameters

__all__ = ["rest_stiffness"]


def rest_stiffness(rig: RigSpec, pretension_mm: Sequence[float]) -> dict[str, float]:
    """Return tension and small-angle stiffness of the joint at rest, keys ending in `[12 mm]`.

    `tension_n` of each tendon. `tendon_stiffness_n_m_rad`: of n tendons at constant tension, n T r_b r_h/ℓ.
    `guide_stiffness_n_m_rad`: of guide friction before it breaks loose, μ n T/φ_s. `joint_stiffness_n_m_rad`: both
    with the relaxed silicone, G J/(L λ). `guide_torque_n_m`: of guide friction that has broken loose, μ n T.
    """
    groups = [Group("idle", p, np.nan, np.nan, 0, 0.0, 1.0) for p in pretension_mm]
    p, shortening = lane_parameters(groups, rig, mode="current")
    length, tendons = rig.silicone.length.value, rig.tendons
    total = tendons.count * np.asarray(p.held_tension)
    radii = tendons.base_radius.value * tendons.head_radius.value
    tendon = total * radii / (tendons.free_span.value - shortening)
    guide_torque = tendons.guide_friction.value * total
    guide = guide_torque / tendons.presliding_angle.value
    silicone = rig.silicone.torsional_rigidity.value / (length - shortening)
    rows = {
        "tension_n": total / tendons.count,
        "tendon_stiffness_n_m_rad": tendon,
        "guide_stiffness_n_m_rad": guide,
        "joint_stiffness_n_m_rad": silicone + tendon + guide,
        "guide_torque_n_m": guide_torque,
    }
    return {f"{name}[{at:g} mm]": float(row[i]) for i, at in enumerate(pretension_mm) for name, row in rows.items()}
