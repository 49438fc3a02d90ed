"""This is where the load is found at which tendons make a joint buckle, sideways or by twisting.

Sideways: tendons run straight from guides on the head to guides on the base, so that their pull always points to the
base. With motors that hold a position they keep the head from tilting as well, the column is held at both ends and
P = 4 π² E I/L². With motors that hold a current nothing but the silicone keeps the head from tilting; a load whose line
passes through the foot of a clamped column gives P = π² E I/L² (Timoshenko and Gere, Theory of Elastic Stability,
chapter 2). Rubber columns are short and shear as well: Haringx's formula.

By twisting: compression lets a section twist more easily (Wagner). For an incompressible neo-Hookean bar at the stretch
λ the torsional stiffness is (G/L) (I_p/λ - (I_p - J)/λ⁴) (`sinew.twin.energy.twist_rigidity`), which vanishes where
λ³ = 1 - J/I_p; for slight compression that is Wagner's P = G J A/I_p.
"""

import numpy as np
from scipy import optimize

__all__ = ["compressive_load", "euler_load", "haringx_load", "mast_load", "twisting_stretch"]


def euler_load(bending_rigidity: float, length: float, *, tilt_held: bool) -> float:
    """Return the critical load [N] of a joint without shear: E I [N m²], length [m]; tilt_held: by the tendons."""
    return float((4 if tilt_held else 1) * np.pi**2 * bending_rigidity / length**2)


def mast_load(bending_rigidity: float, length: float, height: float) -> float:
    """Return the weight [N] at which a clamped column with a rigid mast on it falls over, without shear.

    height: of the weight above the column's end [m]. The root of k h tan(k L) = 1, P = k² E I (0 < k L < π/2); a height
    of nothing gives π² E I/(4 L²), Euler's free end.
    """
    if height <= 0:
        return float(np.pi**2 * bending_rigidity / (4 * length**2))
    ratio = height / length
    turn = optimize.brentq(lambda x: ratio * x * np.sin(x) - np.cos(x), 0.0, np.pi / 2)
    return float((turn / length) ** 2 * bending_rigidity)


def haringx_load(euler: float, shear_rigidity: float) -> float:
    """Return the critical load [N] of a column that shears as well: ½ G A (sqrt(1 + 4 P_E/(G A)) - 1).

    Haringx, Philips Research Reports 3 and 4 (1948, 1949), as used for rubber springs. shear_rigidity: G A [N].
    """
    return float(0.5 * shear_rigidity * (np.sqrt(1 + 4 * euler / shear_rigidity) - 1))


def twisting_stretch(torsion_constant: float, polar_moment: float) -> float:
    """Return the stretch λ at which the torsional stiffness of the silicone vanishes; 0 for a circle."""
    return float(np.cbrt(max(0.0, 1 - torsion_constant / polar_moment)))


def compressive_load(shear_rigidity: float, stretch: float) -> float:
    """Return the load [N] that compresses a neo-Hookean bar to a stretch λ: G A (1/λ² - λ)."""
    return shear_rigidity * (stretch**-2 - stretch)
