"""Describing function of a steady motion, its fundamental alone: gain, lag, stiffness and damping over amplitude.

With the phasors of the fundamentals, torsion Φ, lever Θ and a torque M from outside, the fundamental of the equation of
motion of the head is

    (k + jΩd) Φ = Ω² (I Φ + I_l Θ) + M,

so k and d are those of the linear spring and damper that would take the fundamental's place. They change with the
amplitude; where the torsion lags behind what drives it by 90°, k = I Ω². Harmonics above the first have no part in it.
"""

from dataclasses import dataclass

import numpy as np

from sinew.measure.arrays import Array, Complexes
from sinew.plan.rig import RigSpec
from sinew.predict.oscillator import Oscillator
from sinew.solve.branch import Branch

_HIGHEST_SHARE = 5


@dataclass(frozen=True)
class Equivalent:
    """stiffness k [N m/rad] and damping d [N m s/rad] that take the fundamental's place, (n,); damping_ratio
    d/(2 sqrt(k I)), not a number where k is not positive."""

    stiffness: Array
    damping: Array
    damping_ratio: Array


@dataclass(frozen=True)
class Describing:
    """Ratios of fundamentals along a curve, complex, (n,): torsion over command, torsion over lever, lever over
    command; and the equivalent spring and damper of the joint."""

    torsion_per_command: Complexes
    torsion_per_lever: Complexes
    lever_per_command: Complexes
    equivalent: Equivalent


def harmonic_shares(branch: Branch) -> dict[int, Array]:
    """Return the amplitudes of the harmonics from the second to the fifth as shares of the fundamental's, (n,) each.

    Orders that the equations' symmetry rules out are not there.
    """
    first = branch.fundamental
    return {
        int(h): np.abs(branch.harmonics[:, i]) / first for i, h in enumerate(branch.orders) if 1 < h <= _HIGHEST_SHARE
    }


def _equivalent(branch: Branch, inertia: float, push: Complexes) -> Equivalent:
    omega = 2 * np.pi * branch.frequency_hz
    dynamic = omega**2 * inertia + push / branch.phasor
    stiffness, damping = dynamic.real, dynamic.imag / omega
    root = np.sqrt(np.where(stiffness > 0, stiffness, np.nan) * inertia)
    return Equivalent(stiffness, damping, damping / (2 * root))


def equivalent_of_rig(branch: Branch, lever: Complexes, rig: RigSpec) -> Equivalent:
    """Return the equivalent spring and damper of a rig's joint. lever: phasor of its fundamental [rad], (n,)."""
    inertia = rig.inertia
    omega = 2 * np.pi * branch.frequency_hz
    push = np.asarray(omega**2 * inertia.lever.value * lever, dtype=complex)
    return _equivalent(branch, inertia.head.value + inertia.lever.value, push)


def equivalent_of_oscillator(branch: Branch, one: Oscillator, share: Array | float = 1.0) -> Equivalent:
    """Return the equivalent spring and damper of an oscillator. share: of its drive that acts, (n,) or one number."""
    omega = 2 * np.pi * branch.frequency_hz
    push = -1j * share * (one.torque + one.inertia * omega**2 * one.base)
    return _equivalent(branch, one.inertia, np.asarray(push, dtype=complex))


def lever_phasor(branch: Branch, command: float, *, prescribed: bool) -> Complexes:
    """Return the complex amplitude of the lever's fundamental [rad], (n,).

    command: amplitude A of the command A sin Ωt [rad]. prescribed: whether the lever follows it exactly.
    """
    return branch.drive * command if prescribed else branch.drive


def describing_function(branch: Branch, command: float, rig: RigSpec, *, prescribed: bool = False) -> Describing:
    """Return the describing function of a rig's joint along a curve at one amplitude of the command [rad]."""
    torsion, lever = branch.phasor, lever_phasor(branch, command, prescribed=prescribed)
    asked = -1j * command
    return Describing(torsion / asked, torsion / lever, lever / asked, equivalent_of_rig(branch, lever, rig))
