"""Multibody: a rig's joint as rigid bodies on springs, for MuJoCo (MJCF).

The silicone is a chain of pieces. Between two of them sits a joint with the six strains of `sinew.mechanics.rod`: three
slides, three hinges, on springs that are the slopes of its energy at rest, so every number comes from the mechanics and
none from a measured resonance. Bodies are where they rest at a pretension, and springs are loaded so that they do rest
there. Head, lever, guides and weight are those of `sinew.mechanics.space`; tendons follow the law of
`sinew.mechanics.tendons` exactly, slack and limit with it.

The silicone's memory is one Maxwell element for each coordinate of the rod, which simulators have no word for: a small
mass on a damper, tied to the coordinate by a spring. A pose that is held relaxes, and storage and loss are those of the
twin's four branches at the frequency of the mode. What springs and dampers cannot do is taken where it matters and said
in the file: the guides' friction, and how the silicone hardens, in a swing of one amplitude.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from sinew import __version__
from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.measure.units import STANDARD_GRAVITY
from sinew.measure.validation import as_path, write_text
from sinew.mechanics.parameters import CURRENT, POSITION, Parameters
from sinew.mechanics.rod import STRAINS, TERMS, section_springs
from sinew.mechanics.silicone import axial_stiffness, branch_stiffness, relaxation_times, twist_rigidity
from sinew.mechanics.space import Space
from sinew.plan.plan import Group, TendonMode
from sinew.plan.rig import RigSpec, moments_of
from sinew.predict.modes import Finder, ModesRequest
from sinew.predict.pose import guides_of, sections_at, strains_at
from sinew.predict.predicted import refuse_pretensions
from sinew.solve.rest import FreeSwing, SwingSprings, swing_springs
from sinew.twin.parameters import from_rig
from sinew.twin.simulate import lane_parameters

PIECES = 6
"""Joints of the silicone's chain; see docs/how-to/simulators.md for what fewer and more of them are worth."""

_MOST_PIECES = 40
_LIGHT = 1e-3  # a memory's mass over what its damper holds in the time it takes to forget
_NOTHING = 1e-14  # what rounding leaves, in SI
_SMALL = 1e-3  # a swing in which guides hold [rad]
_MOST_N = 1e4  # a motor that holds a position is not limited; MuJoCo's range wants a number
_STEPS_S = (1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5, 1e-5)
_MOST_PHASE = 0.6  # of the fastest vibration in one time step [rad]
ENDINGS = (".xml", ".mjcf")


class Link(NamedTuple):
    """One piece of the chain: a joint and the body above it, at rest.

    place, turned: of the joint in frame B (3,) [m], (3, 3). strains: which of `STRAINS` it has. stiffness: along them,
    relaxed, [N m/rad] and [N/m]; stress: at rest [N m], [N]. mass, centre [m] in B, tensor about its own axes (3,): of
    the body.
    """

    position: Array
    turned: Array
    strains: tuple[str, ...]
    stiffness: Array
    stress: Array
    mass: float
    centre: Array
    tensor: Array


class Memory(NamedTuple):
    """A Maxwell element of one coordinate of the rod: Σ weight·strain over the links (link,). stiffness [N m/rad] or
    [N/m]; time: after which it forgets [s]."""

    strain: str
    order: int
    weights: Array
    stiffness: float
    time: float


class Bodies(NamedTuple):
    """A joint as bodies on springs, in SI and frame B: what the model is written from.

    links: from the foot up; memory: of their strains. plate, turned: where the head's plate rests (3,), (3, 3). joint:
    numbers of tendons and drive. feet, guides: of the tendons in B and H (tendon, 3). cable_end, tension: of each at
    rest (tendon,). guide_spring, guide_damping: on the head's torsion, of guides and viscous damper. head, lever:
    (mass, height above the plate, tensor (3,)). radius: of the silicone. torsion_hz, sway_hz: at which its memory is
    taken; swing: [rad]. modes: (frequency [Hz], damping ratio) of the sways and the torsion; none in a bent pose.
    """

    links: tuple[Link, ...]
    memory: tuple[Memory, ...]
    plate: Array
    turned: Array
    joint: Parameters
    feet: Array
    guides: Array
    cable_end: Array
    tension: Array
    guide_spring: float
    guide_damping: float
    head: tuple[float, float, Array]
    lever: tuple[float, float, Array]
    radius: float
    channel: bool
    torsion_hz: float
    sway_hz: float
    swing: float
    modes: dict[str, tuple[float, float]]


def joint_bodies(rig: RigSpec, request: ModesRequest, pieces: int = PIECES, *, sway: bool = True) -> Bodies:
    """Return a rig's joint as bodies on springs, at the first pretension and bend that are asked; see `export_model`
    for the others."""
    (pretension_mm, *_), (bend_deg, *_), _, mode, swing_deg = request
    refuse_pretensions(rig, [pretension_mm])
    if not 1 <= pieces <= _MOST_PIECES:
        raise SpecError(f"found {pieces} pieces of silicone, expected 1 to {_MOST_PIECES}")
    if not 0 < swing_deg <= 90:
        raise SpecError(f"found a swing of {swing_deg:g}°, expected more than 0 and at most 90°")
    if sway:
        return _in_space(rig, request, pieces)
    if bend_deg:
        raise SpecError(f"found a bend of {bend_deg:g}° of a joint that does not sway, expected none; leave one out")
    return _upright(rig, pretension_mm, mode, math.radians(swing_deg))


def _element(joint: Parameters, hz: float) -> tuple[float, float]:
    """Return (stiffness over the relaxed one, time [s]) of a Maxwell element with the branches' storage and loss at a
    frequency [Hz]: g (ωτ)²/(1 + (ωτ)²) and g ωτ/(1 + (ωτ)²)."""
    omega = math.tau * hz
    shares = np.array([float(g) for g in joint.prony_shares])
    storage, loss = (float(part.sum()) for part in branch_stiffness(shares, omega * relaxation_times()))
    return (storage + loss**2 / storage, storage / loss / omega) if storage > 0 else (0.0, 1 / omega)


def _memories(strains: Sequence[str], remembered: Array, hz: Sequence[float], joint: Parameters) -> tuple[Memory, ...]:
    """Return the elements of a chain. remembered: what strains have shares of, by link (link, strain); hz: of the mode
    that each strain swings in. Coordinates are polynomials along the chain, orthonormal over its links."""
    count = len(remembered)
    vander = np.polynomial.legendre.legvander((2 * np.arange(count) + 1) / count - 1, min(TERMS, count) - 1)
    weights = np.linalg.qr(vander)[0]
    weights *= np.sign(weights[-1])
    found = []
    for k, strain in enumerate(strains):
        share, time = _element(joint, hz[k])
        stiffness = share * float(remembered[:, k].mean())
        if stiffness > 0:
            found += [Memory(strain, order, row, stiffness, time) for order, row in enumerate(weights.T)]
    return tuple(found)


def _free(rig: RigSpec, pretension_mm: float, mode: float, swing: float) -> tuple[FreeSwing, SwingSprings]:
    """Return what the upright joint is like in a swing of the torsion [rad]."""
    return swing_springs(from_rig(rig), rig.tendons.first_contact_tension.value, pretension_mm, mode, swing)


def _upright(rig: RigSpec, pretension_mm: float, mode: TendonMode, swing: float) -> Bodies:
    """Return the torsional joint: one piece that twists and sinks, as `sinew.mechanics.joint` has it."""
    lanes, shortening = lane_parameters([Group("idle", pretension_mm, math.nan, math.nan, 0, 0.0, 1.0)], rig, mode=mode)
    p = jax.tree.map(lambda leaf: np.float64(leaf[0]), lanes)
    sunk, length = float(shortening[0]), float(p.length)
    found, springs = _free(rig, pretension_mm, float(p.mode), swing)
    hz = float(found.natural_frequency_hz)
    total = float(found.tension_n) * rig.tendons.count
    stretch = 1 - sunk / length
    twist, axial = (
        float(twist_rigidity(jnp.asarray(stretch), p)) / length,
        float(p.axial_rigidity) * (1 + 2 * stretch**-3) / length,
    )
    grip = float(p.mode != CURRENT) * rig.tendons.count * float(p.stiffness)
    bounce_hz = math.sqrt((axial + grip) / float(p.head_mass)) / math.tau
    memory = _memories(("twist", "stretch"), np.array([[twist, float(axial_stiffness(p))]]), (hz, bounce_hz), p)
    plate = np.array([length - sunk, 0.0, 0.0])
    space = rig.space
    lever_mass = float(p.head_mass) / 2 if space is None else space.lever_mass.value
    heights = (0.0, 0.0) if space is None else (space.head_height.value, space.lever_height.value)
    moments = moments_of(rig)
    directions = np.array([[0.0, float(c), float(s)] for c, s in p.guide_directions])
    gap = np.array([float(p.free_span) - length, 0.0, 0.0])
    link = Link(
        position=plate,
        turned=np.eye(3),
        strains=("twist", "stretch"),
        stiffness=np.array([float(springs.silicone), axial]),
        # The torsional joint has no weight; what it weighs here is taken by the spring.
        stress=np.array([0.0, -total * _upward(plate, directions, gap, p) - float(p.head_mass) * STANDARD_GRAVITY]),
        mass=0.0,
        centre=plate,
        tensor=np.zeros(3),
    )
    return Bodies(
        links=(link,),
        memory=memory,
        plate=plate,
        turned=np.eye(3),
        joint=p,
        feet=float(p.base_radius) * directions,
        guides=float(p.head_radius) * directions + gap,
        cable_end=np.full(len(directions), float(p.cable_end)),
        tension=np.full(len(directions), total / len(directions)),
        guide_spring=float(springs.guides),
        guide_damping=float(springs.guides_loss) / (math.tau * hz) + float(p.viscous),
        head=(float(p.head_mass) - lever_mass, heights[0], moments.head),
        lever=(lever_mass, heights[1], moments.lever),
        radius=rig.silicone.diameter.value / 2,
        channel=False,
        torsion_hz=hz,
        sway_hz=math.nan,
        swing=swing,
        modes={"torsion": (hz, float(found.damping_ratio))},
    )


def _upward(plate: Array, directions: Array, gap: Array, p: Parameters) -> float:
    """Return the share of the tendons' tension that presses the silicone: the cosine of their slope."""
    offset = plate + gap + (float(p.head_radius) - float(p.base_radius)) * directions[0]
    return float(offset[0] / np.linalg.norm(offset))


def _in_space(rig: RigSpec, request: ModesRequest, pieces: int) -> Bodies:
    """Return the joint that twists, bends, shears and sinks, cut into pieces, at a rest pose."""
    finder = Finder(rig, request)
    pretension_mm, bend_deg = request.pretension_mm[0], request.bend_deg[0]
    linear, space = finder.linear(pretension_mm, bend_deg)
    found = finder.at(pretension_mm, bend_deg)
    q, joint, tension = found.coordinates, space.rod.joint, np.asarray(found.tension_n)
    torsion = found.of("torsion")
    if torsion is None:
        raise SpecError(
            f"no torsional mode was found at {pretension_mm:g} mm and {bend_deg:g}°, expected one; {found.why_not}"
        )
    sways = [mode for group in ("in_plane", "across") if (mode := found.of(group)) is not None]
    swing = math.radians(request.swing_deg)
    straight, swung = _free(rig, pretension_mm, float(joint.mode), swing)
    small, still = _free(rig, pretension_mm, float(joint.mode), _SMALL)
    torsion_hz = torsion.frequency_hz * float(straight.natural_frequency_hz / small.natural_frequency_hz)
    sway_hz = float(np.mean([mode.frequency_hz for mode in sways])) if sways else torsion_hz
    share = float(tension.sum()) / (rig.tendons.count * float(straight.tension_n))
    feet, guides = guides_of(space)
    places, turns = sections_at(q, space, np.array([1.0]))
    harder = float(swung.silicone / still.silicone)
    links, memory = _chain(q, space, pieces, torsion_hz, sway_hz, harder)
    bodies = Bodies(
        links=links,
        memory=memory,
        plate=places[0],
        turned=turns[0],
        joint=joint,
        feet=feet,
        guides=guides,
        cable_end=np.asarray(space.cable_end, dtype=float),
        tension=tension,
        guide_spring=share * float(swung.guides),
        guide_damping=share * float(swung.guides_loss) / (math.tau * torsion_hz) + float(joint.viscous),
        head=(float(space.head_mass), float(space.head_height), np.asarray(space.head_tensor)),
        lever=(float(space.lever_mass), float(space.lever_height), np.asarray(space.lever_tensor)),
        radius=rig.silicone.diameter.value / 2,
        channel=float(space.channel) > 0,
        torsion_hz=torsion_hz,
        sway_hz=sway_hz,
        swing=swing,
        modes={}
        if bend_deg
        else {f"sway_{mode.group}": (mode.frequency_hz, mode.damping) for mode in sways}
        | {"torsion": (torsion_hz, float(straight.damping_ratio))},
    )
    # A tendon's length in the chain differs from the rod's where it runs in a channel: its end goes with it.
    longer = _tendon_lengths(bodies) - np.asarray(linear.around.spans)
    return bodies._replace(cable_end=bodies.cable_end + longer)


def _chain(
    q: Array, space: Space, pieces: int, torsion_hz: float, sway_hz: float, harder: float
) -> tuple[tuple[Link, ...], tuple[Memory, ...]]:
    """Return (links, memory) of a rod at rest.

    Each piece has its joint in its middle; a body reaches from one joint to the next, so that the one above the last
    joint is half a piece long and carries the head.

    A hinge in the middle of a piece bends as the piece does under a moment; under a force across it gives way too
    little, by length³/(12 B), which its slide across has besides the shear. harder: the relaxed twist spring in the
    swing over that at rest.
    """
    joint, length = space.rod.joint, float(space.rod.joint.length)
    middle = (np.arange(pieces) + 0.5) / pieces
    tops = np.append(np.arange(1, pieces) / pieces, 1 - 0.25 / pieces)
    shares = np.append(np.full(pieces - 1, 1 / pieces), 0.5 / pieces)
    strains = strains_at(q, space, middle)
    stretch = strains[:, 3]
    own = strains - strains_at(np.zeros_like(q), space, middle)
    own[:, :3] /= length
    springs = section_springs(jnp.asarray(own), space.rod)
    piece = length / pieces
    load = float(space.head_mass) + float(space.lever_mass)
    stiff_axial = float(np.asarray(springs.stiffness)[:, 3].mean()) / length
    bounce_hz = math.sqrt((stiff_axial + len(space.cable_end) * float(joint.stiffness)) / load) / math.tau
    hz = (torsion_hz, sway_hz, sway_hz, bounce_hz, sway_hz, sway_hz)
    remembered = np.asarray(springs.remembered) / piece
    stiffness = np.asarray(springs.stiffness) / piece
    for shear, bend in ((4, 2), (5, 1)):  # across y goes with the bend about z, across z with that about y
        softer = 1 + stiffness[:, shear] * (piece * stretch) ** 2 / (12 * stiffness[:, bend])
        stiffness[:, shear], remembered[:, shear] = stiffness[:, shear] / softer, remembered[:, shear] / softer
    stiffness[:, 0] *= harder
    places, turns = sections_at(q, space, middle)
    centres, _ = sections_at(q, space, tops)
    inertia = np.array([float(x) for x in space.rod.line_inertia])
    links = []
    for i, share in enumerate(shares):
        line = share * length
        mass = float(space.rod.line_mass) * line
        slender = mass * (line * stretch[i]) ** 2 / 12
        links.append(
            Link(
                places[i],
                Rotation.from_matrix(turns[i]).as_matrix(),
                STRAINS,
                stiffness[i],
                np.asarray(springs.stress)[i],
                mass,
                centres[i],
                inertia * line + np.array([0.0, slender, slender]),
            )
        )
    return tuple(links), _memories(STRAINS, remembered, hz, joint)


def _waypoints(bodies: Bodies) -> list[Array]:
    """Return the points of the chain's bodies that tendons in channels pass, in B, a (tendon, 3) for each body but the
    last, which has the head's guides; none where tendons are chords."""
    if not bodies.channel:
        return []
    arms = 0.5 * (bodies.feet + bodies.guides) * np.array([0.0, 1.0, 1.0])
    return [link.position + arms @ link.turned.T for link in bodies.links]


def _tendon_lengths(bodies: Bodies) -> Array:
    points = [bodies.feet, *_waypoints(bodies), bodies.plate + bodies.guides @ bodies.turned.T]
    return np.asarray(np.linalg.norm(np.diff(np.stack(points), axis=0), axis=2).sum(axis=0))


# ---- writing


def _text(*values: Any) -> str:
    return " ".join(f"{float(value) if abs(value) > _NOTHING else 0.0:.9g}" for value in values)


def _exact(*values: float) -> str:
    """Return numbers with all their digits: rounded, the moments of a flat body may break A + B >= C."""
    return " ".join(repr(float(value)) for value in values)


def _quaternion(matrix: Array) -> str:
    x, y, z, w = Rotation.from_matrix(matrix).as_quat(canonical=True)
    return _text(w, x, y, z)


def _remark(sentence: str) -> str:
    # XML allows no two hyphens in a row within a comment, which the name of a rig may have.
    return f"<!-- {sentence.replace('--', '- -').replace('--', '- -')} -->"


def _sites(name: str, points: Array) -> str:
    return "".join(f'<site name="{name}{i + 1}" pos="{_text(*point)}"/>' for i, point in enumerate(points))


def _inertial(position: Sequence[float] | Array, mass: float, moments: str) -> str:
    return f'<inertial pos="{_text(*position)}" mass="{_text(mass)}" diaginertia="{moments}"/>'


def _joint(strain: str, index: int, stiffness: float, stress: float) -> str:
    """Return the joint of a strain: a hinge for curvatures, else a slide, sprung back from its stress at rest."""
    at = STRAINS.index(strain)
    axis, kind = ("1 0 0", "0 1 0", "0 0 1")[at % 3], "hinge" if at < 3 else "slide"
    spring = f'stiffness="{_text(stiffness)}" springref="{_text(-stress / stiffness)}"'
    return f'<joint name="{strain}{index}" type="{kind}" axis="{axis}" {spring}/>'


def time_step(bodies: Bodies) -> float:
    """Return a time step [s] that resolves the chain's fastest vibration: a piece between its two neighbours."""
    fastest = 0.0
    for link in bodies.links:
        mass = link.mass + (bodies.head[0] + bodies.lever[0] if link is bodies.links[-1] else 0.0)
        slides = [k for strain, k in zip(link.strains, link.stiffness, strict=True) if STRAINS.index(strain) >= 3]
        fastest = max(fastest, *(2 * math.sqrt(k / mass) for k in slides))
    return next((step for step in _STEPS_S if fastest * step < _MOST_PHASE), _STEPS_S[-1])


def write_mjcf(bodies: Bodies, heading: Sequence[str]) -> str:
    """Return the MJCF of a joint. heading: sentences of what it is, for the comment at its top."""
    sway = "" if math.isnan(bodies.sway_hz) else f", of bend and shear at {bodies.sway_hz:.4g} Hz"
    head, lines = "\n  ".join(["", *heading, *_lacks(bodies)]) + "\n", range(1, len(bodies.feet) + 1)
    friction = f'stiffness="{_text(bodies.guide_spring)}" damping="{_text(bodies.guide_damping)}"'
    root = ET.XML(
        f"""<mujoco model="sinew">{_remark(head)}
<compiler angle="radian" autolimits="true"/>
<option timestep="{_text(time_step(bodies))}" integrator="implicitfast" gravity="0 0 -9.80665"/>
<default>
  <geom contype="0" conaffinity="0" mass="0" rgba="0.85 0.83 0.75 1"/>
  <site size="0.0025" rgba="0.2 0.2 0.2 1"/>
</default>
<worldbody>
  <light pos="0.3 -0.3 0.8" dir="-0.3 0.3 -0.8"/>
  {_remark("Frame B of the rig: x along the unloaded silicone, here upwards; y where the lever's arms rest.")}
  <body name="base" xyaxes="0 0 1 1 0 0">
    <geom type="cylinder" fromto="-0.008 0 0 0 0 0" size="{_text(1.2 * bodies.radius)}" rgba="0.3 0.3 0.3 1"/>
    {_sites("base", bodies.feet)}
    {_remark(_OF_SILICONE)}
    {_chain_text(bodies)}
  </body>
  {_remark(f"{_OF_MEMORY} {bodies.torsion_hz:.4g} Hz{sway}. {_OF_MASSES}")}
  {"".join(map(_memory_body, bodies.memory))}
</worldbody>
<tendon>
  {_remark("Cables between their guides; what pulls them are the actuators, one for each.")}
  {"".join(_cable(bodies, i) for i in lines)}
  {_remark(f"{_OF_GUIDES} {math.degrees(bodies.swing):.3g}°; the real one is a hysteresis.")}
  <fixed name="guides" {friction} springlength="0">
    {"".join(f'<joint joint="twist{i}" coef="1"/>' for i in range(len(bodies.links)))}
  </fixed>
  {"".join(map(_memory_spring, bodies.memory))}
</tendon>
{_actuators(bodies)}
<sensor>
  <tendonpos name="torsion" tendon="guides"/>
  <jointpos name="lever_angle" joint="lever"/>
  <gyro name="gyro" site="imu"/>
  <accelerometer name="accelerometer" site="imu"/>
  {"".join(f'<tendonpos name="span{i}" tendon="tendon{i}"/>{_pull_sensor(i)}' for i in lines)}
</sensor>
</mujoco>""",
        ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)),
    )
    for element in root.iter():
        element.tail = None
        if not (element.text or "").strip():
            element.text = None
    ET.indent(root, "  ")
    return ET.tostring(root, encoding="unicode") + "\n"


_OF_SILICONE = (
    "The silicone: slopes of its relaxed energy per length at rest (neo-Hookean, compressed by the tendons); that of "
    "twist in the swing that the guides have. springref: its stress at rest."
)
_OF_MEMORY = "The silicone's memory: Maxwell elements, storage and loss of the twin's four branches for twist at"
_OF_MASSES = "Each is a mass so small that it only moves with its damper."
_OF_GUIDES = "Friction of the guides on the head's torsion: spring and loss of its fundamental in a swing of"


def _chain_text(bodies: Bodies) -> str:
    """Return the pieces of the silicone within each other, the head on the last."""
    opened, position, turned = [], np.zeros(3), np.eye(3)
    passed = _waypoints(bodies)
    for i, link in enumerate(bodies.links):
        frame = f'pos="{_text(*(turned.T @ (link.position - position)))}" quat="{_quaternion(turned.T @ link.turned)}"'
        parts = [f'<body name="core{i}" {frame}>']
        # Slides in the section below, then hinges.
        springs = sorted(zip(link.strains, link.stiffness, link.stress, strict=True), key=lambda one: _is_hinge(one[0]))
        parts += [_joint(strain, i, stiffness, stress) for strain, stiffness, stress in springs]
        above = bodies.links[i + 1].position if i + 1 < len(bodies.links) else bodies.plate
        if link.mass > 0:
            parts.append(_inertial(link.turned.T @ (link.centre - link.position), link.mass, _exact(*link.tensor)))
            reach = _text(0, 0, 0, *(link.turned.T @ (above - link.position)))
            parts.append(f'<geom type="cylinder" fromto="{reach}" size="{_text(bodies.radius)}"/>')
        if passed:
            parts.append(_sites(f"core{i}_", (passed[i] - link.position) @ link.turned))
        opened.append("".join(parts))
        position, turned = link.position, link.turned
    return "".join(opened) + _head(position, turned, bodies) + "</body>" * len(opened)


def _is_hinge(strain: str) -> bool:
    return STRAINS.index(strain) < 3


def _head(position: Array, turned: Array, bodies: Bodies) -> str:
    """Return the head plate, its board and the lever on it, whose arms lie along y."""
    frame = f'pos="{_text(*(turned.T @ (bodies.plate - position)))}" quat="{_quaternion(turned.T @ bodies.turned)}"'
    joint, (mass, height, tensor) = bodies.joint, bodies.lever
    arm, dark, red = math.sqrt(float(tensor[0]) / mass), 'rgba="0.3 0.3 0.3 1"', 'rgba="0.7 0.35 0.2 1"'
    drive = f'armature="{_text(joint.armature)}" damping="{_text(joint.speed_slope)}"'
    friction = f'frictionloss="{_text(joint.drive_friction)}"'
    return f"""<body name="head" {frame}>
  {_inertial((bodies.head[1], 0, 0), bodies.head[0], _exact(*bodies.head[2]))}
  <geom type="cylinder" fromto="0 0 0 0.008 0 0" size="{_text(1.2 * bodies.radius)}" {dark}/>
  <site name="imu" pos="0 0 0"/>
  {_sites("head", bodies.guides)}
  {_remark("The lever on its drive: reflected armature, back-EMF as a damper, friction of the gear.")}
  <body name="lever" pos="{_text(height, 0, 0)}">
    <joint name="lever" type="hinge" axis="1 0 0" {drive} {friction}/>
    {_inertial((0, 0, 0), mass, _exact(*tensor))}
    <geom type="capsule" fromto="{_text(0, -arm, 0, 0, arm, 0)}" size="0.005" {red}/>
    <geom type="sphere" pos="{_text(0, -arm, 0)}" size="0.018" {red}/>
    <geom type="sphere" pos="{_text(0, arm, 0)}" size="0.018" {red}/>
  </body>
</body>"""


def _memory_body(one: Memory) -> str:
    name, damper = f"memory_{one.strain}_{one.order}", one.stiffness * one.time
    light = _text(_LIGHT * damper * one.time)
    joint = f'<joint name="{name}" type="slide" axis="1 0 0" damping="{_text(damper)}"/>'
    inertial = f'<inertial pos="0 0 0" mass="{light}" diaginertia="{light} {light} {light}"/>'
    return f'<body name="{name}">{joint}{inertial}</body>'


def _memory_spring(one: Memory) -> str:
    name = f"memory_{one.strain}_{one.order}"
    joints = "".join(f'<joint joint="{one.strain}{i}" coef="{_text(w)}"/>' for i, w in enumerate(one.weights))
    spring = f'<fixed name="{name}" stiffness="{_text(one.stiffness)}" springlength="0">'
    return f'{spring}{joints}<joint joint="{name}" coef="-1"/></fixed>'


def _cable(bodies: Bodies, i: int) -> str:
    names = ("base", *(f"core{k}_" for k in range(len(_waypoints(bodies)))), "head")
    sites = "".join(f'<site site="{name}{i}"/>' for name in names)
    return f'<spatial name="tendon{i}" width="0.001" rgba="0.4 0.4 0.45 1">{sites}</spatial>'


def _pull_sensor(i: int) -> str:
    return f'<actuatorfrc name="pull{i}" actuator="motor{i}"/>'


def _actuators(bodies: Bodies) -> str:
    joint = bodies.joint
    k, held = float(joint.stiffness), np.broadcast_to(np.asarray(joint.held_tension, dtype=float), bodies.tension.shape)
    by_current = float(joint.mode) == CURRENT
    limits = (
        "Motors that hold currents: they pull by a tension, whatever the length. Control: more tension [N]."
        if by_current
        else "Motors that hold positions: cable and servo in series are one spring, slack beyond its rest length. "
        "Control: what the motor takes up beyond this pretension [m]; negative lets go."
    )
    motors = []
    for i, end in enumerate(bodies.cable_end):
        most = _MOST_N if float(joint.mode) in (POSITION, CURRENT) else float(held[i])
        gain, bias = (-1.0, (-bodies.tension[i], 0.0, 0.0)) if by_current else (-k, (k * end, -k, 0.0))
        law = f'gainprm="{_text(gain)}" biastype="affine" biasprm="{_text(*bias)}" forcerange="{_text(-most, 0.0)}"'
        motors.append(f'<general name="motor{i + 1}" tendon="tendon{i + 1}" {law}/>')
    duty = float(joint.duty_torque)
    most = duty * float(joint.duty_limit)
    loop = f'kp="{_text(float(joint.position_gain) * duty)}" forcerange="{_text(-most, most)}"'
    return f"""<actuator>
  {_remark(limits)}
  {"".join(motors)}
  {_remark("The drive's position loop with its limit of duty. Control: angle of the lever [rad].")}
  <position name="drive" joint="lever" {loop}/>
</actuator>"""


def _lacks(bodies: Bodies) -> list[str]:
    """Return sentences on what the model does not have."""
    degrees = math.degrees(bodies.swing)
    return [
        "What it lacks beside Sinew's twin:",
        f"- hysteresis of the guides: in its place spring and damper of a swing of {degrees:.3g} deg; smaller swings",
        "  of the twin are stiffer and less damped, larger ones softer",
        "- the silicone's slower and faster memory: storage and loss are right at the frequencies named below",
        "- the silicone's springs are linear about this rest: further from it they do not harden or soften",
        "- delays, noise and filters of sensors",
    ]


def model_document(bodies: Bodies) -> dict[str, Any]:
    """Return what a model was made of, as JSON holds it."""
    return {
        "pieces": len(bodies.links),
        "time_step_s": time_step(bodies),
        "head_mm": [1e3 * float(x) for x in bodies.plate],
        "tension_n": [float(x) for x in bodies.tension],
        "cable_end_mm": [1e3 * float(x) for x in bodies.cable_end],
        "frequency_hz": {name: float(hz) for name, (hz, _) in bodies.modes.items()},
        "damping_ratio": {name: float(damping) for name, (_, damping) in bodies.modes.items()},
    }


def export_model(
    rig: RigSpec,
    path: Path | str,
    pretension_mm: float = 6.0,
    *,
    bend_deg: float = 0.0,
    azimuth_deg: float = 0.0,
    mode: TendonMode = "position",
    swing_deg: float = 10.0,
    pieces: int = PIECES,
    sway: bool = True,
) -> Bodies:
    """Write a rig's joint as a model for MuJoCo, MJCF (.xml, .mjcf), and return what it was made of.

    pretension_mm: common take-up of the tendons. bend_deg, azimuth_deg: pose in which it rests. mode: of the tendons'
    motors. swing_deg: torsion for which guides have a spring and a damper. pieces: of the silicone. sway: False for a
    joint that twists and sinks only, of rigs that do not tell their masses. Raises SpecError where the rig has no
    such pose, or the name ends otherwise; FileError where it cannot be written.

    >>> import tempfile
    >>> import sinew as sn
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     made = sn.export_model(sn.load_rig("paper"), f"{folder}/joint.xml", 6.0, sway=False)
    >>> round(made.torsion_hz, 1)
    3.6
    """
    file = as_path(path)
    if file.suffix not in ENDINGS:
        raise SpecError(f"the model's name is {file}, expected one that ends with {', '.join(ENDINGS)}")
    request = ModesRequest((pretension_mm,), (bend_deg,), azimuth_deg, mode, swing_deg)
    bodies = joint_bodies(rig, request, pieces, sway=sway)
    pose = f", bent by {bend_deg:g} deg towards {azimuth_deg:g} deg" if bend_deg else ""
    heading = [
        f"Rig {rig.name} at {pretension_mm:g} mm of pretension{pose}, motors in mode {mode}. Sinew {__version__}, SI.",
    ]
    write_text(file, write_mjcf(bodies, heading))
    return bodies
