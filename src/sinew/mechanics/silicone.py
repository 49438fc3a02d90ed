"""Silicone: strain energy of twist and compression, and the memory that makes its loss factor."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from sinew.mechanics.parameters import Parameters

BAND_HZ = (0.3, 30.0)
"""Band over which the loss factor is held constant [Hz]."""

Memory = tuple[jax.Array, ...]

BRANCHES = 4
"""Maxwell branches; over two decades four keep the loss factor within 2 % of constant."""


def relaxation_times() -> NDArray[np.float64]:
    """Return the relaxation times τ_i of the branches [s], shape (branch,), longest first."""
    corner_hz = np.geomspace(BAND_HZ[0] / 1.3, BAND_HZ[1] * 1.3, BRANCHES)
    return np.asarray(1 / (2 * np.pi * corner_hz))


def branch_stiffness(share: Any, turned: Any) -> tuple[Any, Any]:
    """Return (storage, loss) of Maxwell branches of stiffness g at ωτ, in the unit of g; NumPy's numbers or JAX's."""
    return share * turned**2 / (1 + turned**2), share * turned / (1 + turned**2)


def prony_shares(loss_factor: float) -> NDArray[np.float64]:
    """Return the branch stiffnesses g_i as shares of the relaxed stiffness, shape (branch,).

    Fitted by non-negative least squares to tan δ = G''/G' = `loss_factor` over `BAND_HZ`; the condition
    G'' - tan δ G' = 0 is linear in g, with G* = 1 + Σ g_i iωτ_i/(1 + iωτ_i).
    """
    omega = 2 * np.pi * np.geomspace(*BAND_HZ, 60)
    wt = omega[:, None] * relaxation_times()
    storage, loss = branch_stiffness(1.0, wt)
    shares, _ = nnls(loss - loss_factor * storage, np.full(omega.size, loss_factor))
    return np.asarray(shares)


def silicone_energy(torsion: jax.Array, shortening: jax.Array, p: Parameters) -> jax.Array:
    """Return the relaxed strain energy of the silicone [J].

    Incompressible neo-Hookean solid cylinder in combined torsion and compression (Rivlin), stretch λ = 1 - x/L:
    W = (G L / 2) [A (λ² + 2/λ - 3) + J φ² / (L² λ)]; a section that warps see `twist_rigidity`.
    """
    stretch = 1 - shortening / p.length
    axial = p.axial_rigidity * p.length * (stretch**2 + 2 / stretch - 3)
    return 0.5 * (axial + twist_rigidity(stretch, p) * torsion**2 / p.length)


def twist_rigidity(stretch: jax.Array, p: Parameters) -> jax.Array:
    """Return the relaxed torsional rigidity at a stretch λ [N m²]: G (I_p/λ - (I_p - J)/λ⁴).

    Small twist on a stretched incompressible neo-Hookean bar that warps freely; G J/λ for a circle, whose warping
    rigidity G (I_p - J) is zero.
    """
    return (p.torsional_rigidity + p.warping_rigidity * (1 - stretch**-3)) / stretch


def axial_stiffness(p: Parameters) -> jax.Array:
    """Return the relaxed axial stiffness at small strain [N/m]: 3 G A/L."""
    return 3 * p.axial_rigidity / p.length


def compressive_load(shear_rigidity: Any, stretch: Any) -> Any:
    """Return the load [N] that compresses a neo-Hookean bar to a stretch λ: G A (1/λ² - λ)."""
    return shear_rigidity * (stretch**-2 - stretch)


def glassy_factor(p: Parameters) -> Any:
    """Return the stiffness of what is too fast for the branches to relax, over the relaxed one: 1 + Σ g_i."""
    return 1 + sum(p.prony_shares)


def memory_stiffness(omega: jax.Array, shortening: jax.Array, p: Parameters) -> tuple[jax.Array, jax.Array]:
    """Return (storage, loss) of the branches in torsion, beside the relaxed stiffness [N m/rad]. omega: [rad/s]."""
    torsional = twist_rigidity(1 - shortening / p.length, p) / p.length
    storage, loss = jnp.zeros(()), jnp.zeros(())
    for share, tau in zip(p.prony_shares, relaxation_times(), strict=True):
        more = branch_stiffness(share, omega * tau)
        storage, loss = storage + more[0], loss + more[1]
    return torsional * storage, torsional * loss


def _twice_stored(
    torsion: jax.Array, shortening: jax.Array, memory: Memory, axial_memory: Memory, p: Parameters
) -> list[jax.Array]:
    torsional, axial = twist_rigidity(1 - shortening / p.length, p) / p.length, axial_stiffness(p)
    rows = zip(p.prony_shares, memory, axial_memory, strict=True)
    return [share * (torsional * (torsion - q) ** 2 + axial * (shortening - u) ** 2) for share, q, u in rows]


def viscoelastic_energy(
    torsion: jax.Array, shortening: jax.Array, memory: Memory, axial_memory: Memory, p: Parameters
) -> jax.Array:
    """Return the energy in the Maxwell branches [J].

    memory [rad], axial_memory [m]: dashpot positions q_i, u_i, by branch. Branch stiffnesses are the shares
    g_i of the torsional stiffness at the present stretch, and of the axial one.
    """
    return 0.5 * sum(_twice_stored(torsion, shortening, memory, axial_memory, p), start=jnp.zeros(()))


def silicone_power(
    torsion: jax.Array, shortening: jax.Array, memory: Memory, axial_memory: Memory, p: Parameters
) -> jax.Array:
    """Return the power that the branches' dashpots turn to heat [W]: twice the energy of each over τ_i."""
    twice = _twice_stored(torsion, shortening, memory, axial_memory, p)
    return sum((one / tau for one, tau in zip(twice, relaxation_times(), strict=True)), start=jnp.zeros(()))
