"""A real tendon-driven arm against the rod: `python -m benchmarks arm --data FOLDER`.

The arm hangs, tapers from 31 to 10 mm over 360 mm, and two tendons in it pull it aside; markers on it were followed
by motion capture while it stood still. The recordings are those of paper_results/secVa_system_identification in tud-
phi/soromox (MIT), 22 files m1_u..., m2_u..., m12_u...csv; they are not part of this repository. A row has a count, a
time and five markers, x, y, z each [m], in any order.

The rod's statics are ours: strains in Legendre polynomials, poses on SE(3), a neo-Hookean bar's energy, here with a
section that tapers. Young's modulus is fitted to half of the recordings, the other half is predicted. Geometry,
routing, places of markers and the radius of the pulleys are those that the source gives; the density is the one it
starts from.
"""

import argparse
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize

from sinew.measure.arrays import Array
from sinew.measure.units import STANDARD_GRAVITY
from sinew.mechanics.rod import NODES, SHEAR_FACTOR, Rod, grid, rod_energy, rod_poses
from sinew.plan.toml import load_rig
from sinew.solve.programs import configure
from sinew.twin.parameters import space_from_rig

BODY_M, TIP_M = 0.305, 0.055
RADII_M = (0.01541, 0.00642, 0.00480)
"""Where the body begins, where it ends and the tip begins, where the tip ends."""
DENSITY = 1500.0
PULLEY_M = 0.0325
ROUTE_M, ROUTE_SLOPE, ROUTE_DEG = 0.0114, -0.0295, (30.0, 150.0)
"""Of the tendons: distance from the axis at the base, its change with the reference length, and direction."""
MARKERS = ((0.1291, 0.0, 0.025), (0.2195, 0.0, -0.021), (0.2800, 0.0, 0.020), (0.368, 0.0, 0.0))
"""Reference length and offset across (y, z of the section) of each marker [m]; the last one is 8 mm beyond the end."""
FOOT_M = (-0.03, -0.013, 0.0)
"""From the base's marker to the middle of the base, in axes of the motion capture."""
BOTH = {
    "00050010": (0.05, 0.10),
    "00100005": (0.10, 0.05),
    "001": (0.10, 0.10),
    "001002": (0.10, 0.20),
    "002001": (0.20, 0.10),
    "0015002": (0.15, 0.20),
    "0020015": (0.20, 0.15),
    "002": (0.20, 0.20),
}
"""Torques of both motors [N m], by what follows m12_u in a file's name."""
TERMS = 4
_MOST_STEPS = 200
SOURCE_MM = (11.0, 36.0)
"""Errors that the source reports for its model, by case."""


class Pose(NamedTuple):
    """A recording: torques of the two motors [N m], four markers in B (4, 3) [m]."""

    name: str
    torques: Array
    markers: Array


def torques_of(name: str) -> Array:
    """Return the torques of both motors [N m] that a file's name tells: m1_u015 is 0.15 on the first alone."""
    motors, digits = name.removeprefix("m").split("_u")
    if motors == "12":
        return np.array(BOTH[digits])
    one = int(digits) / 10 ** (len(digits) - 1)
    return np.array([one, 0.0] if motors == "1" else [0.0, one])


def read(folder: Path) -> list[Pose]:
    """Return the recordings of a folder, by name."""
    found = []
    for file in sorted(folder.glob("m*_u*.csv")):
        points = np.atleast_2d(np.loadtxt(file, delimiter=","))[:, 2:17].mean(axis=0).reshape(5, 3)
        base = int(np.argmin(points[:, 1]))  # the motion capture's y points down
        others = [i for i in range(5) if i != base]

        def way(order: tuple[int, ...], points: Array = points, base: int = base) -> float:
            return float(np.sum(np.linalg.norm(np.diff(points[[base, *order]], axis=0), axis=1)))

        order = min(itertools.permutations(others), key=way)
        x, y, z = (points[list(order)] - points[base] - np.array(FOOT_M)).T
        found.append(Pose(file.stem, torques_of(file.stem), np.stack([y, z, x], axis=1)))
    return found


def arm(young_modulus: jax.Array) -> tuple[Rod, Rod]:
    """Return (the rod that tapers, its numbers given at the nodes; one of the same length, for poses)."""
    plain = space_from_rig(load_rig("paper")).rod
    length = BODY_M + TIP_M
    places = 0.5 * length * (1 + np.polynomial.legendre.leggauss(NODES)[0])
    radius = np.interp(places, [0, BODY_M, length], RADII_M)
    area, moment, modulus = np.pi * radius**2, np.pi * radius**4 / 4, young_modulus / 3
    poses = plain._replace(joint=plain.joint._replace(length=jnp.asarray(length)))
    joint = poses.joint._replace(
        torsional_rigidity=2 * modulus * moment,
        axial_rigidity=modulus * area,
        warping_rigidity=jnp.zeros(()),
    )
    bending = modulus * moment
    line = jnp.asarray(DENSITY * area)
    return poses._replace(
        joint=joint, bending=(bending, bending), shear=SHEAR_FACTOR * modulus * area, line_mass=line
    ), poses


def _until(share: float) -> Array:
    """Return the matrix from coefficients on the rod to those on its beginning, a share of it (term, term)."""
    points = np.polynomial.legendre.leggauss(TERMS)[0]
    inside = np.polynomial.legendre.legvander(share * (points + 1) - 1, TERMS - 1)
    return np.asarray(np.linalg.solve(np.polynomial.legendre.legvander(points, TERMS - 1), inside), dtype=float)


def markers_of(q: jax.Array, poses: Rod) -> jax.Array:
    """Return where the markers are in B (4, 3) [m]."""
    length = BODY_M + TIP_M
    placed = []
    for s, across, aside in MARKERS:
        share = min(s / length, 1.0)
        scale = jnp.array([share] * 3 + [1.0] * 3)[:, None]
        part = poses._replace(joint=poses.joint._replace(length=jnp.asarray(share * length)))
        rotations, positions = rod_poses(scale * (q @ _until(share).T), part)
        offset = jnp.array([max(s - length, 0.0), across, aside])
        placed.append(positions[-1] + rotations[-1] @ offset)
    return jnp.stack(placed)


def _routes(q: jax.Array) -> jax.Array:
    """Return the lengths of the tendons in the body (2,) [m]: of a curve that keeps its place in the section."""
    length = BODY_M + TIP_M
    points, weights = np.polynomial.legendre.leggauss(8)
    s = 0.5 * BODY_M * (1 + points)
    strains = np.polynomial.legendre.legvander(2 * s / length - 1, TERMS - 1) @ q.T
    lengths = []
    for angle in np.radians(ROUTE_DEG):
        out = np.array([0.0, np.cos(angle), np.sin(angle)])
        place = (ROUTE_M + ROUTE_SLOPE * s)[:, None] * out
        tangent = strains[:, 3:] + np.array([1.0, 0.0, 0.0]) + ROUTE_SLOPE * out
        tangent = tangent + jnp.cross(strains[:, :3] / length, place)
        lengths.append(0.5 * BODY_M * jnp.sum(weights * jnp.sqrt(jnp.sum(tangent**2, axis=1))))
    return jnp.stack(lengths)


def _energy(flat: jax.Array, torques: jax.Array, young_modulus: jax.Array) -> jax.Array:
    q = flat.reshape(6, TERMS)
    tapered, poses = arm(young_modulus)
    _, positions = rod_poses(q, poses)
    weights = grid(TERMS).weights
    hanging = STANDARD_GRAVITY * (BODY_M + TIP_M) * jnp.sum(weights * tapered.line_mass * positions[:-1, 0])
    return rod_energy(q, tapered) - hanging + torques / PULLEY_M @ _routes(q)


@jax.jit
def _around(flat: jax.Array, torques: jax.Array, young_modulus: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    slope = jax.grad(_energy)
    return slope(flat, torques, young_modulus), jax.jacfwd(slope)(flat, torques, young_modulus), _markers(flat)


def _markers(flat: jax.Array) -> jax.Array:
    return markers_of(flat.reshape(6, TERMS), arm(jnp.asarray(1.0))[1])


def resting(torques: Array, young_modulus: float, flat: Array) -> tuple[Array, Array]:
    """Return (coordinates at rest, markers there in B (4, 3) [m]) from a guess.

    Raises RuntimeError where none is found.
    """
    for _ in range(_MOST_STEPS):
        slope, bend, markers = (np.asarray(x) for x in _around(flat, torques, np.float64(young_modulus)))
        values, vectors = np.linalg.eigh(bend)
        move = -vectors @ ((vectors.T @ slope) / np.maximum(np.abs(values), 1e-6 * values[-1]))
        largest = float(np.max(np.abs(move)))
        if largest < 1e-9:
            return flat, markers
        flat = flat + move * min(1.0, 0.3 / largest)
    raise RuntimeError(f"no rest after {_MOST_STEPS} steps of Newton's method; the last was {largest:.1e}")


def missed(poses: Sequence[Pose], young_modulus: float, starts: dict[str, Array]) -> Array:
    """Return by how much each recording is missed [m], root mean square over markers. starts: guesses, kept up."""
    errors = []
    for pose in poses:
        flat, markers = resting(pose.torques, young_modulus, starts.get(pose.name, np.zeros(6 * TERMS)))
        starts[pose.name] = flat
        errors.append(np.sqrt(np.mean(np.sum((markers - pose.markers) ** 2, axis=1))))
    return np.array(errors)


def fitted(poses: Sequence[Pose], starts: dict[str, Array]) -> float:
    """Return Young's modulus with which recordings are missed least [Pa]."""

    def cost(log_modulus: float) -> float:
        return float(np.sum(missed(poses, float(np.exp(log_modulus)), starts) ** 2))

    low, high = np.log([1e5, 1e6]).tolist()
    found = scipy.optimize.minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 1e-3})
    return float(np.exp(found.x))


def main(arguments: Sequence[str] = ()) -> None:
    """Fit the stiffness to half of the recordings, predict the other half, and the other way round."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks arm")
    parser.add_argument("--data", type=Path, help="folder of the recordings, m*_u*.csv")
    folder = parser.parse_args(list(arguments)).data
    if folder is None:
        print("a real arm: skipped, its recordings are not here; name their folder with --data (see benchmarks/arm.py)")
        return
    configure()
    poses = read(folder)
    if len(poses) < 4:
        raise SystemExit(f"found {len(poses)} recordings in {folder}, expected at least 4 files m*_u*.csv")
    print(f"a real arm on two tendons, {len(poses)} recordings; the source's model misses by "
          f"{SOURCE_MM[0]:g} to {SOURCE_MM[1]:g} mm, by case")  # fmt: skip
    starts: dict[str, Array] = {}
    for known, other in ((poses[::2], poses[1::2]), (poses[1::2], poses[::2])):
        modulus = fitted(known, starts)
        told, fit = 1e3 * missed(other, modulus, starts), 1e3 * missed(known, modulus, starts)
        whole, own = (float(np.sqrt(np.mean(x**2))) for x in (told, fit))
        print(f"  E = {1e-6 * modulus:.4f} MPa from {len(known)} recordings, missed by {own:.1f} mm; the other "
              f"{len(other)} by {whole:.1f} mm, each {told.min():.1f} to {told.max():.1f}, "
              f"half of them within {np.median(told):.1f} mm")  # fmt: skip
        print("   ", ", ".join(f"{p.name} {x:.0f}" for p, x in zip(other, told, strict=True)))


if __name__ == "__main__":
    main()
