"""This is where it is estimated how much the plates at its ends stiffen a silicone that is bonded to them."""

import numpy as np

__all__ = ["bonded_axial_factor", "bonded_torsion_factor"]


def bonded_axial_factor(area: float, perimeter: float, length: float) -> float:
    """Return by how much bonded ends raise the axial stiffness 3 G A/L of an incompressible block: 1 + 2 S².

    S: loaded area over the area that is free to bulge, A/(P L). Gent and Lindley, Proc. Inst. Mech. Eng. 173 (1959).
    area [m²], perimeter of all edges [m], length [m].
    """
    return 1 + 2 * (area / (perimeter * length)) ** 2


def bonded_torsion_factor(torsion_constant: float, warping_constant: float, length: float) -> float:
    """Return by how much ends that hold the warping raise the torsional stiffness G J/L: 1/(1 - tanh(h)/h).

    h = L/2 · sqrt(G J/(E I_w)) with E = 3 G. Vlasov's theory of restrained warping (Timoshenko and Gere, Theory of
    Elastic Stability, section 5.3); one for a section that does not warp. Arguments in m⁴, m⁶ and m.
    """
    if warping_constant <= 1e-12 * torsion_constant * length**2:
        return 1.0
    h = 0.5 * length * np.sqrt(torsion_constant / (3 * warping_constant))
    return float(1 / (1 - np.tanh(h) / h))
