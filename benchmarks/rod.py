"""The joint in space against its peers: `python -m benchmarks rod`.

The rod, bare and with the paper's head, beside SoRoMoX: frequencies, and where the tip rests under weight across it.
Both have six strains of the same order. The peer's material is linear; ours is neo-Hookean, so statics are told twice:
as it is, and with our energy made quadratic, which leaves poses and weights to compare. Then the rigid head on its
tendons beside MuJoCo (see `mujoco_space`), and the rod beside finite elements of the solid (see `solid_bending`).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize

from benchmarks import mujoco_space, solid_bending
from benchmarks.peers import PeerSilentError, told_by
from sinew.measure.arrays import Array
from sinew.measure.units import STANDARD_GRAVITY
from sinew.mechanics.rod import rod_poses, straight
from sinew.mechanics.space import Space, weight_energy
from sinew.plan.toml import load_rig
from sinew.solve.programs import configure
from sinew.solve.spatial import linear_equations, modes, settle
from sinew.twin.parameters import space_from_rig

ACCELERATIONS = (1.0, STANDARD_GRAVITY)
KINDS = {"torsion": 0, "bending": 1, "stretch": 3}
"""Rows of strains; a mode is of the kind whose row moves most."""


class Bare(NamedTuple):
    """A rod without tendons, of plain numbers, and what sits on it."""

    space: Space
    shear_modulus: float
    radius: float
    density: float


def bare(head: bool) -> Bare:
    """Return the paper's rod, elastic, shear unreduced as the peer's, without weight; with its head or none."""
    rig = load_rig("paper")
    space = space_from_rig(rig)
    joint = space.rod.joint
    radius = float(np.sqrt(2 * joint.torsional_rigidity / joint.axial_rigidity))
    shear_modulus = float(joint.axial_rigidity) / (np.pi * radius**2)
    density = float(space.rod.line_mass) / (np.pi * radius**2)
    elastic = joint._replace(prony_shares=tuple(0.0 * g for g in joint.prony_shares))
    rod = space.rod._replace(joint=elastic, shear=joint.axial_rigidity)
    space = space._replace(rod=rod, weight=jnp.zeros(3))
    if not head:
        mass, tensor = jnp.zeros(()), jnp.zeros(3)
        space = space._replace(head_mass=mass, lever_mass=mass, head_tensor=tensor, lever_tensor=tensor)
    return Bare(jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float), space), shear_modulus, radius, density)


def head_of(space: Space) -> dict[str, Any]:
    """Return head and locked lever as one body: mass [kg], height [m] of its centre, its three moments [kg m²]."""
    masses = np.array([space.head_mass, space.lever_mass])
    heights = np.array([space.head_height, space.lever_height])
    mass = float(masses.sum())
    height = float(masses @ heights / mass) if mass else 0.0
    apart = float(masses @ (heights - height) ** 2)
    tensor = space.head_tensor + space.lever_tensor + apart * np.array([0.0, 1.0, 1.0])
    return {"mass": mass, "height": height, "tensor": tensor.tolist()}


def own_frequencies(space: Space) -> dict[str, float]:
    """Return the lowest frequency of each kind [Hz]; of bending the slower one, about the axis across the lever."""
    linear = linear_equations(np.asarray(straight()), space)
    scale = np.sqrt(np.diag(linear.around.stiffness))
    found: dict[str, float] = {}
    for mode in modes(linear, space, below_hz=1e4):
        share = np.sum((mode.shape * scale).reshape(6, -1) ** 2, axis=1)
        for kind, row in KINDS.items():
            near = share[row] + (share[2] if kind == "bending" else 0.0)
            if near > 0.5 * share.sum() and kind not in found:
                found[kind] = mode.frequency_hz
    return found


def own_tip(space: Space, acceleration: float) -> Array:
    """Return (position [m], rotation about z [rad]) of the tip that rests under a weight towards -y (4,)."""
    q, _ = settle(np.asarray(straight()), space._replace(weight=jnp.array([0.0, -acceleration, 0.0])))
    return _tip(q, space)


def _tip(q: Array, space: Space) -> Array:
    rotations, positions = rod_poses(jnp.asarray(q), space.rod)
    return np.array([*positions[-1], np.arctan2(rotations[-1][1, 0], rotations[-1][0, 0])], dtype=float)


def linear_tip(space: Space, acceleration: float) -> Array:
    """Return the same of a rod whose energy is quadratic in its strains: G J, 3 G I, 3 G A, G A."""
    rod, joint = space.rod, space.rod.joint
    length, terms = float(joint.length), straight().shape[1]
    bends = [3 * float(b) / length for b in rod.bending]
    axial, shear = 3 * float(joint.axial_rigidity) * length, float(rod.shear) * length
    rows = np.array([float(joint.torsional_rigidity) / length, *bends, axial, shear, shear])
    stiffness = (rows[:, None] / (2 * np.arange(terms) + 1)).ravel()
    loaded = space._replace(weight=jnp.array([0.0, -acceleration, 0.0]))
    pulled = jax.jit(lambda flat: stiffness * flat + jax.grad(weight_energy)(flat.reshape(6, terms), loaded).ravel())

    def slope(flat: Array) -> Array:
        return np.asarray(pulled(flat))

    found = scipy.optimize.root(slope, np.zeros(6 * terms), tol=1e-13)
    return _tip(found.x.reshape(6, terms), space)


def told_frequencies(frequencies: list[float], own: dict[str, float]) -> dict[str, float]:
    """Return of the peer's frequencies [Hz] those that are nearest to our own."""
    return {kind: min(frequencies, key=lambda f: abs(f - near)) for kind, near in own.items()}


def ask_soromox() -> tuple[list[Bare], dict[str, Any]]:
    """Return (rods without and with a head, what the peer tells of both); raises PeerSilentError where it does not."""
    bares = [bare(head=False), bare(head=True)]
    one = bares[0]
    asked = {
        "length": float(one.space.rod.joint.length),
        "radius": one.radius,
        "density": one.density,
        "shear_modulus": one.shear_modulus,
        "order": straight().shape[1] - 1,
        "heads": [head_of(b.space) for b in bares],
        "accelerations": ACCELERATIONS,
    }
    return bares, told_by("soromox_rod.py", asked)


def _against_soromox() -> None:
    try:
        bares, told = ask_soromox()
    except PeerSilentError as error:
        print(f"  SoRoMoX: skipped, {error}")
        return
    print(f"the paper's rod without tendons, order {straight().shape[1] - 1}, beside SoRoMoX")
    for name, mine, theirs in zip(("bare", "with head"), bares, told["heads"], strict=True):
        own = own_frequencies(mine.space)
        peer = told_frequencies(theirs["frequencies_hz"], own)
        for kind, frequency in own.items():
            wanted = 0.02 if kind == "torsion" else 0.1
            off = 100 * (frequency / peer[kind] - 1)
            print(f"  {name:9} {kind:8} {frequency:10.5f} Hz, SoRoMoX {peer[kind]:10.5f}, "
                  f"{off:+.6f} % (wanted: within {wanted:g})")  # fmt: skip
        for acceleration, tip in zip(ACCELERATIONS, theirs["tips"], strict=True):
            for material, ours in (
                ("neo-Hookean", own_tip(mine.space, acceleration)),
                ("made linear", linear_tip(mine.space, acceleration)),
            ):
                apart = 100 * (ours[[1, 3]] / np.array(tip)[[1, 3]] - 1)
                print(f"  {name:9} tip across at {acceleration:4.2f} m/s², ours {material}: {1e3 * ours[1]:9.5f} mm, "
                      f"SoRoMoX {1e3 * tip[1]:9.5f}, {apart[0]:+.6f} %, tilt {apart[1]:+.6f} % (0.1)")  # fmt: skip
    print("  (the peer is linear: E I and E A whatever the strain; ours bends the easier the more it is stretched, "
          "so the statics of the same problem are those made linear)")  # fmt: skip


def main() -> None:
    """Print the rod and the head beside SoRoMoX, MuJoCo and finite elements."""
    configure()
    _against_soromox()
    mujoco_space.main()
    solid_bending.main()


if __name__ == "__main__":
    main()
