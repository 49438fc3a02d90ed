"""A swinging rod with a head as SoRoMoX or PyElastica have it, in an interpreter of its own: `make peers` makes it.

It runs without Sinew: `.venv-peers/bin/python benchmarks/peer_swing.py '{...}'` prints one JSON document. Asked: peer,
length [m], radius [m], density [kg/m³], shear_modulus [Pa], head: {mass [kg], radius [m], length [m]} of a cylinder on
the rod's end, spin and sway: rates at which the rod begins to twist and to bend [rad/s], seconds, sample_s, and of
SoRoMoX order (of its polynomials), lanes and steps_s, of which it takes the longest in which it stays below a radian;
of PyElastica elements and step_s. Told: seconds of a core that the swing took, once compiled, compiled_s with it, and
torsion [rad] of the head at each sample of the first lane; of SoRoMoX step_s.

In their favour nothing is lost or driven and no tendon pulls. PyElastica's head has its mass on the last node and its
inertia, about the plate, on the last element: right in torsion, its height left out in bending.
"""

import json
import sys
import time
from typing import Any

import numpy as np


def _soromox(asked: dict[str, Any]) -> dict[str, Any]:
    import jax
    import jax.numpy as jnp
    from soromox.systems import GVS, GVSSegment, JointSpec, LinkSpec, StrainBasisSpec, SystemState

    jax.config.update("jax_enable_x64", True)

    def segment(length: float, radius: float, density: float, moves: int) -> Any:
        link = LinkSpec.circular(
            length=length,
            radius=radius,
            density=density,
            young_modulus=3 * asked["shear_modulus"],
            shear_modulus=asked["shear_modulus"],
            reference_strain=[0, 0, 0, 1, 0, 0],
        )
        basis = StrainBasisSpec(type="legendre", strain_selector=[moves] * 6, basis_order=asked["order"])
        return GVSSegment(link=link, joint=JointSpec(type="fixed"), basis=basis, num_gauss_points=6 if moves else 5)

    head = asked["head"]
    volume = np.pi * head["radius"] ** 2 * head["length"]
    robot = GVS.from_segments(
        [
            segment(asked["length"], asked["radius"], asked["density"], 1),
            segment(head["length"], head["radius"], head["mass"] / volume, 0),
        ],
        gravity=jnp.zeros(3),
        base_pose=jnp.array([1.0, 0, 0, 0, 0, 0, 0]),
        scale_rotational_basis_by_length=True,
    )
    terms = asked["order"] + 1
    start = np.zeros((asked["lanes"], 12 * terms))
    start[:, 6 * terms] = asked["spin"] * (1 - 0.01 * np.arange(asked["lanes"]))
    start[:, 8 * terms] = asked["sway"]

    steps_s = sorted(asked["steps_s"], reverse=True)

    @jax.jit
    def swing(states: jax.Array, step_s: jax.Array) -> jax.Array:
        def one(state: jax.Array) -> jax.Array:
            rolled = robot.rollout_to(
                SystemState(t=jnp.zeros(()), y=state),
                t1=asked["seconds"],
                solver_dt=step_s,
                save_ts=jnp.arange(0.0, asked["seconds"], asked["sample_s"]),
                max_steps=2 * round(asked["seconds"] / steps_s[-1]),
            )
            torsion: jax.Array = rolled.y[:, 0]  # the mean twist: the head's torsion while the rod bends little
            return torsion

        return jax.vmap(one)(states)

    begin = time.process_time()
    swing(jnp.asarray(start), jnp.asarray(steps_s[-1])).block_until_ready()
    first = time.process_time() - begin
    for step_s in steps_s:
        begin = time.process_time()
        torsion = np.asarray(swing(jnp.asarray(0.99 * start), jnp.asarray(step_s)))
        seconds = time.process_time() - begin
        if np.all(np.abs(torsion) < 1.0):
            break
    return {"seconds": seconds, "compiled_s": first, "step_s": step_s, "torsion": torsion[0].tolist()}


def _elastica(asked: dict[str, Any]) -> dict[str, Any]:
    import elastica as ea

    class Joint(ea.BaseSystemCollection, ea.Constraints, ea.CallBacks):
        pass

    count, length, head = asked["elements"], asked["length"], asked["head"]
    rod = ea.CosseratRod.straight_rod(
        count,
        np.zeros(3),
        np.array([1.0, 0, 0]),
        np.array([0.0, 1, 0]),
        length,
        asked["radius"],
        asked["density"],
        youngs_modulus=3 * asked["shear_modulus"],
        shear_modulus=asked["shear_modulus"],
    )
    axial = 0.5 * head["mass"] * head["radius"] ** 2
    across = 0.5 * axial + head["mass"] * head["length"] ** 2 / 3  # about the plate, at the foot of the cylinder
    rod.mass[-1] += head["mass"]
    rod.mass_second_moment_of_inertia[..., -1] += np.diag([across, across, axial])
    inertia = np.linalg.inv(rod.mass_second_moment_of_inertia[..., -1])
    rod.inv_mass_second_moment_of_inertia[..., -1] = inertia
    nodes = rod.position_collection[0]
    middles = 0.5 * (nodes[1:] + nodes[:-1])
    bent = np.array([[0.0], [0.0], [asked["sway"]]])
    spun = np.array([[asked["spin"]], [0.0], [0.0]])
    rod.omega_collection[:] = np.einsum("ijn,jn->in", rod.director_collection, (bent + spun) * middles / length)
    rod.velocity_collection[1] = 0.5 * asked["sway"] * nodes**2 / length
    joint = Joint()
    joint.append(rod)
    joint.constrain(rod).using(ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,))
    kept: list[float] = []

    class Watch(ea.CallBackBaseClass):
        def make_callback(self, system: Any, time: float, current_step: int) -> None:
            if current_step % round(asked["sample_s"] / asked["step_s"]) == 0:
                base, tip = system.director_collection[..., 0], system.director_collection[..., -1]
                matrix = base @ tip.T  # from the foot's axes to the tip's; their third is along the rod
                twisted = float(np.arctan2(matrix[1, 0] - matrix[0, 1], matrix[0, 0] + matrix[1, 1]))
                kept.append(twisted * count / (count - 1))  # between the middles of the outer elements

    joint.collect_diagnostics(rod).using(Watch)
    joint.finalize()
    stepper = ea.PositionVerlet()
    at, steps = np.float64(0.0), round(asked["seconds"] / asked["step_s"])
    begin = time.process_time()
    at = stepper.step(joint, at, np.float64(asked["step_s"]))
    first, begin = time.process_time() - begin, time.process_time()
    for _ in range(steps - 1):
        at = stepper.step(joint, at, np.float64(asked["step_s"]))
    return {"seconds": time.process_time() - begin, "compiled_s": first, "torsion": kept}


def main() -> None:
    """Print what is asked for in the first argument."""
    asked = json.loads(sys.argv[1])
    print(json.dumps({"soromox": _soromox, "elastica": _elastica}[asked["peer"]](asked)))


if __name__ == "__main__":
    main()
