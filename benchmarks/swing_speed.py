"""Simulated seconds per second of the joint in space and of its peers: `python -m benchmarks swing`.

One joint for all: the paper's rod, elastic, with a head that is a cylinder of the paper's mass and inertia, and no
tendons. It begins straight, at a rate of twist and of bend. Ours goes through the twin's own march: six strains of
order 2, RK4 at 1.25 ms, stiff modes slowed; it carries memory, drive, friction and gyroscope with it, which the peers
do not have. SoRoMoX has the same strains; MuJoCo has rigid pieces on six springs each, PyElastica elements. Each peer
takes the largest step of a few with which it is stable. How fast the head swings to and fro in torsion tells that it
is the same joint.

Seconds are those of a core, added up over what a process uses, so that a busy computer is no fault of the code; each
is timed once it is compiled. XLA has one thread, SoRoMoX's as ours: with more both take longer.
"""

import importlib.util
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.peers import PeerSilentError, told_by
from benchmarks.table import Row
from sinew.measure.arrays import Array
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.rod import straight
from sinew.mechanics.space import Space, space_at_rest
from sinew.plan.toml import load_rig
from sinew.solve import march
from sinew.solve.march import STEPS_PER_SAMPLE
from sinew.solve.programs import configure
from sinew.solve.spatial import linear_equations, slow_down
from sinew.twin.parameters import space_from_rig

SAMPLE_S = 0.005
SECONDS = 1.0
SPIN, SWAY = 5.4, 2.0
"""Rates at which the rod begins to twist and to bend [rad/s]: swings of about 20° and 7°."""
HEAD_LENGTH_M = 0.06
PIECES = 8
STEPS_S = (2.5e-3, 1.25e-3, 1e-3, 5e-4)
"""Of which SoRoMoX takes the longest in which it is stable [s]."""


class Bare(NamedTuple):
    """A rod without tendons, of plain numbers, and what sits on it."""

    space: Space
    shear_modulus: float
    radius: float
    density: float


def bare() -> Bare:
    """Return the paper's rod, elastic, shear unreduced as the peer's, without weight."""
    rig = load_rig("paper")
    space = space_from_rig(rig)
    joint = space.rod.joint
    radius = float(np.sqrt(2 * joint.torsional_rigidity / joint.axial_rigidity))
    shear_modulus = float(joint.axial_rigidity) / (np.pi * radius**2)
    density = float(space.rod.line_mass) / (np.pi * radius**2)
    elastic = joint._replace(prony_shares=tuple(0.0 * g for g in joint.prony_shares))
    rod = space.rod._replace(joint=elastic, shear=joint.axial_rigidity)
    space = space._replace(rod=rod, weight=jnp.zeros(3))
    return Bare(jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float), space), shear_modulus, radius, density)


class Swung(NamedTuple):
    """How fast a simulation was. speed: simulated seconds per second of a core, of all lanes together; torsion: of the
    head at the samples [rad]."""

    speed: float
    torsion: Array

    @property
    def frequency_hz(self) -> float:
        """Frequency of the torsion, from its first two ways through zero after the start [Hz]."""
        x = self.torsion
        down = [i for i in range(1, x.size - 1) if x[i] * x[i + 1] <= 0][:2]
        at = [i + x[i] / (x[i] - x[i + 1]) for i in down]
        return float(0.5 / ((at[1] - at[0]) * SAMPLE_S))


def cylinder_head(space: Space) -> dict[str, float]:
    """Return the cylinder that stands for head and lever: mass [kg], radius [m], length [m]."""
    mass = float(space.head_mass + space.lever_mass)
    axial = float(space.head_tensor[0] + space.lever_tensor[0])
    return {"mass": mass, "radius": float(np.sqrt(2 * axial / mass)), "length": HEAD_LENGTH_M}


def joint_of(space: Space, head: dict[str, float]) -> Space:
    """Return the joint with that cylinder on it, its lever locked and without mass."""
    axial = 0.5 * head["mass"] * head["radius"] ** 2
    across = 0.5 * axial + head["mass"] * head["length"] ** 2 / 12
    still: Parameters = space.rod.joint._replace(prescribed=1.0, amplitude=0.0)  # type: ignore[arg-type]
    own = space._replace(
        rod=space.rod._replace(joint=still),
        head_mass=head["mass"],  # type: ignore[arg-type]
        head_height=0.5 * head["length"],  # type: ignore[arg-type]
        head_tensor=np.array([axial, across, across]),  # type: ignore[arg-type]
        lever_mass=0.0,  # type: ignore[arg-type]
        lever_tensor=np.zeros(3),  # type: ignore[arg-type]
    )
    own = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float), own)
    return slow_down(linear_equations(np.asarray(straight()), own), own)


def ours(space: Space, lanes: int) -> Swung:
    """Return how fast lanes go through the twin's march, once it is compiled."""
    many = jax.tree.map(lambda leaf: np.repeat(np.asarray(leaf)[None], lanes, axis=0), space)
    q = np.repeat(np.asarray(straight())[None], lanes, axis=0)

    def run() -> tuple[float, Array]:
        states = jax.vmap(space_at_rest)(jax.numpy.asarray(q), many)
        rate = np.zeros_like(q)
        rate[:, 0, 0], rate[:, 2, 0] = SPIN, SWAY
        states = states._replace(q_rate=jax.numpy.asarray(rate))
        torsion, begin = [], time.process_time()
        for first in range(0, round(SECONDS / SAMPLE_S), march.CHUNK):
            count = min(march.CHUNK, round(SECONDS / SAMPLE_S) - first)
            times = np.float64(first * SAMPLE_S), np.float64(SAMPLE_S)
            states, seen = march._chunk(many, states, *times, np.int64(count), np.int64(STEPS_PER_SAMPLE))
            columns = np.asarray(seen)[:count, 0, :9]
            torsion.append(np.arctan2(columns[:, 5] - columns[:, 7], columns[:, 4] + columns[:, 8]))
        return time.process_time() - begin, np.concatenate(torsion)

    run()  # compiles
    seconds, torsion = run()
    return Swung(lanes * SECONDS / seconds, torsion)


def chain_xml(asked: dict[str, Any], step_s: float) -> str:
    """Return the MJCF of a rod in rigid pieces, each on three slides and three hinges in its middle, and the head."""
    length, radius, modulus = asked["length"] / PIECES, asked["radius"], asked["shear_modulus"]
    area, moment = np.pi * radius**2, np.pi * radius**4 / 4
    slides = np.array([3 * modulus * area, modulus * area, modulus * area]) / length
    hinges = np.array([2 * modulus * moment, 3 * modulus * moment, 3 * modulus * moment]) / length
    axes = ("1 0 0", "0 1 0", "0 0 1")
    joints = "".join(
        f'<joint type="{kind}" axis="{axis}" pos="{length / 2} 0 0" stiffness="{k}"/>'
        for kind, stiffnesses in (("slide", slides), ("hinge", hinges))
        for axis, k in zip(axes, stiffnesses, strict=True)
    )
    mass, line = asked["density"] * area * length, asked["density"] * length
    across = line * moment + mass * length**2 / 12
    piece = f'<inertial pos="{length / 2} 0 0" mass="{mass}" diaginertia="{2 * line * moment} {across} {across}"/>'
    head = asked["head"]
    axial = 0.5 * head["mass"] * head["radius"] ** 2
    tilting = 0.5 * axial + head["mass"] * head["length"] ** 2 / 12
    bodies = (f'<body name="head" pos="{length} 0 0"><inertial pos="{head["length"] / 2} 0 0" mass="{head["mass"]}" '
              f'diaginertia="{axial} {tilting} {tilting}"/></body>')  # fmt: skip
    for index in range(PIECES):
        bodies = f'<body pos="{length if index < PIECES - 1 else 0} 0 0">{joints}{piece}{bodies}</body>'
    return f"""<mujoco><option timestep="{step_s}" integrator="RK4" gravity="0 0 0"><flag contact="disable"/></option>
    <worldbody>{bodies}</worldbody></mujoco>"""


def mujocos(asked: dict[str, Any], step_s: float) -> Swung:
    """Return how fast MuJoCo is with a chain of pieces."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(chain_xml(asked, step_s))
    data = mujoco.MjData(model)
    for index in range(PIECES):
        data.qvel[6 * index + 3] = asked["spin"] / PIECES
        data.qvel[6 * index + 5] = asked["sway"] / PIECES
    head = model.body("head").id
    torsion: list[float] = []
    begin = time.process_time()
    for _ in range(round(SECONDS / SAMPLE_S)):
        matrix = data.xmat[head].reshape(3, 3) if torsion else np.eye(3)
        torsion.append(float(np.arctan2(matrix[2, 1] - matrix[1, 2], matrix[1, 1] + matrix[2, 2])))
        mujoco.mj_step(model, data, nstep=round(SAMPLE_S / step_s))
    return Swung(SECONDS / (time.process_time() - begin), np.array(torsion))


def rows() -> Iterator[Row]:
    """Yield the seconds of a core for a simulated second of a lane, beside the peers'."""
    configure()
    mine = bare()
    head = cylinder_head(mine.space)
    asked = {
        "length": float(mine.space.rod.joint.length),
        "radius": mine.radius,
        "density": mine.density,
        "shear_modulus": mine.shear_modulus,
        "head": head,
        "spin": SPIN,
        "sway": SWAY,
        "seconds": SECONDS,
        "sample_s": SAMPLE_S,
    }
    space = joint_of(mine.space, head)
    one, many = (ours(space, lanes) for lanes in (1, march.SPACE_LANES))
    work = "a rod with a head, a simulated second"
    peers: list[tuple[str, dict[str, Any]]] = [
        ("SoRoMoX, the same strains", {"peer": "soromox", "order": 2, "lanes": 1, "steps_s": STEPS_S}),
        ("PyElastica, 10 elements", {"peer": "elastica", "elements": 10, "step_s": 1e-4}),
        ("PyElastica, 20 elements", {"peer": "elastica", "elements": 20, "step_s": 5e-5}),
    ]
    for name, more in peers:
        try:
            told = told_by("peer_swing.py", {**asked, **more}, timeout_s=580)
        except PeerSilentError as error:
            yield Row(work, 1 / one.speed, name, None, "s", f"skipped: {error}")
            continue
        yield _beside(work, one, name, Swung(SECONDS / told["seconds"], np.array(told["torsion"])))
    if importlib.util.find_spec("mujoco") is None:
        yield Row(work, 1 / one.speed, "MuJoCo", None, "s", "skipped: not installed")
        return
    chain = mujocos(asked, 5e-4)
    yield _beside(work, one, f"MuJoCo, {PIECES} pieces, RK4 0.5 ms", chain)
    yield _beside(f"{work} of one of {march.SPACE_LANES} lanes", many, f"MuJoCo, {PIECES} pieces, RK4 0.5 ms", chain)


def _beside(work: str, one: Swung, name: str, other: Swung) -> Row:
    note = f"torsion at {one.frequency_hz:.4f} and {other.frequency_hz:.4f} Hz"
    return Row(work, 1 / one.speed, name, 1 / other.speed, "s", note)
