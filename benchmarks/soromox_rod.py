"""A rod as SoRoMoX has it, in an interpreter of its own: `make peers` makes it.

It runs without Sinew: `.venv-peers/bin/python benchmarks/soromox_rod.py '{...}'` prints one JSON document. Asked:
length [m], radius [m], density [kg/m³], shear_modulus [Pa], order of the Legendre polynomials, heads: a list of {mass
[kg], height [m] of its centre above the tip, tensor [kg m²] about its centre, three moments}, accelerations [m/s²]
across the rod. Told for each head: frequencies_hz of small motion without weight, and tips: where the tip rests [m]
and the rotation about z [rad] at each acceleration.

The peer's material is linear, E = 3 G, shear unreduced. A head is added to its matrices by its own Jacobian and poses.
"""

import json
import sys
import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
import scipy.optimize
from soromox.systems import GVS, GVSSegment, JointSpec, LinkSpec, StrainBasisSpec

jax.config.update("jax_enable_x64", True)


def rod(asked: dict[str, Any]) -> GVS:
    """Return the rod with all six strains, its weight 1 m/s² towards -y."""
    link = LinkSpec.circular(
        length=asked["length"],
        radius=asked["radius"],
        density=asked["density"],
        young_modulus=3 * asked["shear_modulus"],
        shear_modulus=asked["shear_modulus"],
        reference_strain=[0, 0, 0, 1, 0, 0],
    )
    basis = StrainBasisSpec(type="legendre", strain_selector=[1] * 6, basis_order=asked["order"])
    segment = GVSSegment(link=link, joint=JointSpec(type="fixed"), basis=basis, num_gauss_points=8)
    return GVS.from_segments(
        [segment],
        gravity=jnp.array([0.0, -1.0, 0.0]),
        base_pose=jnp.array([1.0, 0, 0, 0, 0, 0, 0]),
        scale_rotational_basis_by_length=True,
    )


def head_inertia(head: dict[str, Any]) -> np.ndarray:
    """Return the head's inertia about the tip (6, 6), rotations first: centre on the axis at a height."""
    arm = np.array([[0, 0, 0], [0, 0, -head["height"]], [0, head["height"], 0]])  # cross product with (height, 0, 0)
    mass = head["mass"] * np.eye(3)
    rotation = np.diag(head["tensor"]) - head["mass"] * arm @ arm
    return np.block([[rotation, head["mass"] * arm], [-head["mass"] * arm, mass]])


def main() -> None:
    """Print what is asked for in the first argument."""
    asked = json.loads(sys.argv[1])
    begin = time.perf_counter()
    robot = rod(asked)
    straight, end = jnp.zeros(6 * (asked["order"] + 1)), jnp.asarray(asked["length"])
    mass, stiffness = np.asarray(robot.inertia_matrix(straight)), np.asarray(robot.stiffness_matrix())
    along = np.asarray(robot.jacobian_bodyframe(straight, end))
    tip = jax.jit(lambda q: robot.forward_kinematics(q, end))
    weight = jax.jit(lambda q: robot.gravitational_force(q))  # noqa: PLW0108 -- its own method cannot be hashed
    jacobian = jax.jit(lambda q: robot.jacobian_bodyframe(q, end))
    told = []
    for head in asked["heads"]:
        squares = scipy.linalg.eigh(stiffness, mass + along.T @ head_inertia(head) @ along, eigvals_only=True)
        tips = []
        for acceleration in asked["accelerations"]:

            def lacking(q: np.ndarray, head: dict[str, Any] = head, a: float = acceleration) -> np.ndarray:
                pulled = np.asarray(tip(q))[:3, :3].T @ np.array([0.0, -a * head["mass"], 0.0])
                turned = np.cross([head["height"], 0.0, 0.0], pulled)
                hung = np.asarray(jacobian(q)).T @ np.concatenate([turned, pulled])
                return np.asarray(stiffness @ q + a * np.asarray(weight(q)) - hung)

            found = scipy.optimize.root(lacking, np.zeros(straight.size), tol=1e-13)
            pose = np.asarray(tip(found.x))
            tips.append([*pose[:3, 3].tolist(), float(np.arctan2(pose[1, 0], pose[0, 0]))])
        told.append({"frequencies_hz": (np.sqrt(squares) / (2 * np.pi)).tolist(), "tips": tips})
    print(json.dumps({"heads": told, "whole_s": time.perf_counter() - begin}))


if __name__ == "__main__":
    main()
