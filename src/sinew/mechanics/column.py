"""Column: the load at which a straight compressed rod of silicone buckles sideways, shearing and shortening with it.

The rod is that of `sinew.mechanics.rod`: under a load N = G A (1/λ² - λ) it has the stretch λ, bends with
G I (1 + 2/λ³)/λ and shears with 0.9 G A. Turned by θ, the second variation of its energy with the load's is

    ½ ∫ B θ'² - N (λ + N/(0.9 G A)) θ² ds,

the shear being eliminated; so it buckles where B (π/L)² = N (λ + N/(0.9 G A)) between ends that keep their direction
and may move aside. A load that always points to the foot, as that of tendons, does the same: for one end free to turn
at π, for both ends held at 2π. Euler's load E I (π/L)² says which, so it is what is given here.

Haringx's formula with a constant E I leaves out that the rod thickens as it is pressed: for a length of 3.4 radii it
says half of what the exact incremental solution does. This one is within 2.3 % of it up to a radius of 0.35 lengths.
"""

from typing import Any

from sinew.measure.arrays import namespace_of
from sinew.mechanics.rod import SHEAR_FACTOR
from sinew.mechanics.silicone import compressive_load

SHORTEST = 0.5
"""Stretch beyond which the column is not asked: a joint that is pressed to half its length is no rod any more."""

_HALVINGS = 40


def column_load(euler: Any, shear_rigidity: Any) -> Any:
    """Return the critical load [N] of a column of rubber by Euler's [N] and G A [N]; NumPy's numbers or JAX's.

    A column so short that it does not buckle before it is pressed to `SHORTEST` has the load of that stretch, the least
    that it can be. Differentiable: the last step is Newton's.
    """
    return compressive_load(shear_rigidity, column_stretch(euler / shear_rigidity))


def column_stretch(share: Any) -> Any:
    """Return the stretch λ at which a column buckles; share: Euler's load over G A, E I (x/L)²/(G A)."""
    xp = namespace_of(share)
    low, high = SHORTEST + 0 * share, 1 + 0 * share
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        bends = _excess(middle, share) > 0
        low, high = xp.where(bends, low, middle), xp.where(bends, middle, high)
    found = xp.where(_excess(low, share) > 0, SHORTEST, high)
    step = 1e-6
    slope = (_excess(found + step, share) - _excess(found - step, share)) / (2 * step)
    return xp.where(found > SHORTEST, found - _excess(found, share) / slope, SHORTEST)


def _excess(stretch: Any, share: Any) -> Any:
    """Return what bending resists less what the load takes, over G A: positive where the column stands."""
    load = compressive_load(1.0, stretch)
    return share / 3 * (1 + 2 * stretch**-3) / stretch - load * (stretch + load / SHEAR_FACTOR)
