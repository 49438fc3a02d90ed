"""This is where it is estimated how much the plates at its ends stiffen a silicone that is bonded to them."""

import numpy as np

__all__ = ["LOST", "bonded_axial_factor", "bonded_torsion_factor"]


LOST = 0.163
"""Length that bonded ends take from a slender cylinder, in diameters: finite elements, `python -m benchmarks solid`."""


def bonded_axial_factor(area: float, perimeter: float, length: float) -> float:
    """Return by how much bonded ends raise the axial stiffness 3 G A/L of an incompressible block.

    A slender one is as stiff as one that is shorter by 0.163 diameters, 1/(1 - 0.163 d/L), with d = 4 A/P: for a circle
    within 0.3 % from a length of one width on. A squat one follows 1 + 2 S² with S = A/(P L), loaded area over the one
    that is free to bulge (Gent and Lindley, Proc. Inst. Mech. Eng. 173, 1959). The larger of both holds.
    area [m²], perimeter of all edges [m], length [m].
    """
    shape = area / (perimeter * length)
    left = 1 - LOST * 4 * shape
    return max(1 + 2 * shape**2, 1 / left if left > 0.5 else 0.0)


def bonded_torsion_factor(torsion_constant: float, warping_constant: float, length: float) -> float:
    """Return by how much ends that hold the warping raise the torsional stiffness G J/L: 1/(1 - tanh(h)/h).

    h = L/2 · sqrt(G J/(E I_w)) with E = 3 G. Vlasov's theory of restrained warping (Timoshenko and Gere, Theory of
    Elastic Stability, section 5.3); one for a section that does not warp. Arguments in m⁴, m⁶ and m.
    """
    if warping_constant <= 1e-12 * torsion_constant * length**2:
        return 1.0
    h = 0.5 * length * np.sqrt(torsion_constant / (3 * warping_constant))
    return float(1 / (1 - np.tanh(h) / h))
