"""The twin in space: a plan whose head is bent, or moved by its tendons or a blow.

Each pretension and repeat rests in its own pose, found once; from there every group is a lane. What a rig loses while
its head tilts, beside the silicone's loss, is not known and left out: guides rub, and the damper acts, on the torsion.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sinew.measure.arrays import Array
from sinew.measure.attitude import torsion_of
from sinew.measure.errors import SpecError
from sinew.mechanics.parameters import CURRENT, TENDON_MODES
from sinew.mechanics.rod import straight
from sinew.mechanics.space import Space
from sinew.plan.plan import Group, Pose, TendonMode
from sinew.plan.rig import LIMIT_RESERVE_N, Imu, RigSpec
from sinew.solve.march import Progress, Swing, swing
from sinew.solve.programs import configure
from sinew.solve.spatial import Rest, bend, bend_by_tension, hold, linear_equations, patterns, settle, slow_down
from sinew.twin.parameters import Effects, space_from_rig
from sinew.twin.sensors import Moved

_RIGID = 1e3
"""Inertia against stretch [kg m²] of a rod whose length is locked; that of the head is a thousandth of one."""


class SpaceLanes(NamedTuple):
    """The groups of a plan as lanes. space: parameters with a lane axis; q: coordinates at rest (lane, 6, term);
    take_up: of each tendon then, from first contact (lane, tendon) [m]; rests: the poses, by pretension [mm] and
    repeat."""

    space: Space
    q: Array
    take_up: Array
    rests: dict[tuple[float, int], Rest]


def space_lanes(
    groups: Sequence[Group],
    rig: RigSpec,
    *,
    mode: TendonMode = "position",
    effects: Effects | None = None,
    rng: np.random.Generator | None = None,
) -> SpaceLanes:
    """Return the lanes of groups that bend or sway, at rest in their pose.

    rng: draws the scatter of pretension and friction, one draw for each pair of pretension and repeat. Effects act as
    in the torsional twin; `axial_motion` off keeps the rod's length.
    Raises SpecError for a pose that the joint does not take, and for tendons that are to be driven while their motors
    hold a tension.
    """
    configure()
    effects = effects or Effects()
    held = TENDON_MODES[mode] if effects.length_locking else CURRENT
    if held == CURRENT and any(g.excitation in _PATTERN for g in groups):
        raise SpecError(
            "found tendons that are to be driven while their motors hold a tension, expected motors that hold "
            "positions; set pretension.mode to position"
        )
    pairs = {pair: i for i, pair in enumerate(dict.fromkeys((g.pretension_mm, g.repeat) for g in groups))}
    scatter = np.zeros((2, len(pairs)))
    if rng is not None and effects.repeatability:
        widths = (rig.repeatability.pretension.value, rig.repeatability.guide_friction.value)
        scatter = np.array(widths)[:, None] * rng.standard_normal(scatter.shape)

    own = space_from_rig(rig)
    own = own._replace(rod=own.rod._replace(joint=effects.applied(own.rod.joint)))
    own = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float), own)
    rests: dict[tuple[float, int], Rest] = {}
    at_rest: dict[tuple[float, int], Space] = {}
    for pair, index in pairs.items():
        pose = next(g.pose for g in groups if (g.pretension_mm, g.repeat) == pair)
        friction = own.rod.joint.guides.scaled(max(0.0, 1 + scatter[1, index]))
        here = own._replace(rod=own.rod._replace(joint=own.rod.joint._replace(guides=friction)))
        pretension = max(0.0, pair[0] * 1e-3 + scatter[0, index])
        nearby = [found for (p, _), found in rests.items() if p == pair[0]][-1:]
        posed, rests[pair] = _pose(here, rig, pretension, pose, effects, *nearby, by_current=mode == "current")
        if effects.tendons:
            posed = hold(posed, rests[pair], held, LIMIT_RESERVE_N)
        slowed = slow_down(linear_equations(rests[pair].q, posed), posed)
        at_rest[pair] = slowed if effects.axial_motion else _of_one_length(slowed)
    lanes = [_driven(at_rest[g.pretension_mm, g.repeat], g) for g in groups]
    mine = [rests[g.pretension_mm, g.repeat] for g in groups]
    return SpaceLanes(
        space=jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf, dtype=float) for leaf in leaves]), *lanes),
        q=np.stack([pose.q for pose in mine]),
        take_up=np.stack([pose.take_up for pose in mine]),
        rests=rests,
    )


def _pose(
    space: Space,
    rig: RigSpec,
    pretension: float,
    pose: Pose,
    effects: Effects,
    nearby: Rest | None = None,
    *,
    by_current: bool = False,
) -> tuple[Space, Rest]:
    """Return the joint at rest in a pose at a pretension [m]; nearby: the same pose at nearly this pretension.

    by_current: with the tensions that hold a bend as motors are told them, whose mean is that of the straight joint;
    those of motors that hold positions have a lower one, by 4 % at 20° and 6 mm.
    """
    if not effects.tendons:
        if not pose.is_straight:
            raise SpecError(f"without tendons nothing holds {pose.words()}; leave the pose out, or the tendons in")
        q, here = settle(np.asarray(straight()), space)
        return space, Rest(q, here, np.zeros(here.spans.size), 0.0, 1.0, True)
    contact = rig.tendons.first_contact_tension.value
    tilt = np.array(pose.swing_rad)
    found: Rest | None
    if by_current and not pose.is_straight:
        there, found = bend_by_tension(space, contact, pretension, tilt)
    else:
        there, found = bend(space, contact, pretension, tilt, nearby)
    if found is None or not found.found or (by_current and not found.taut):
        why = "is not reached" if found is None or not found.reached else "is not stable"
        why = "needs tendons that push" if found is not None and found.found else why
        raise SpecError(
            f"at {1e3 * pretension:.3g} mm {pose.words()} {why} with the tendons of rig {rig.name}; bend less, or "
            "change the pretension"
        )
    return there, found


def _of_one_length(space: Space) -> Space:
    rigid = np.array(space.added)
    terms = rigid.shape[0] // 6
    stretch = np.arange(3 * terms, 4 * terms)
    rigid[stretch, stretch] += _RIGID
    return space._replace(added=rigid)


_PATTERN = {"pitch": 1, "roll": 2}
"""Which of `solve.spatial.patterns` the tendons are driven in."""


def _driven(space: Space, group: Group) -> Space:
    """Return the parameters of a joint that a group moves."""
    moves = group.kind != "idle"
    by_lever = moves and group.excitation == "lever"
    joint = space.rod.joint._replace(
        amplitude=np.radians(group.amplitude_deg) if by_lever else 0.0,  # type: ignore[arg-type]
        omega=2 * np.pi * (group.frequency_hz if math.isfinite(group.frequency_hz) else 1.0),  # type: ignore[arg-type]
        stop_s=group.settle_s if group.kind == "ring-down" else np.inf,  # type: ignore[arg-type]
    )
    space = space._replace(rod=space.rod._replace(joint=joint))
    if moves and group.excitation in _PATTERN:
        return space._replace(pulls=1e-3 * group.amplitude_mm * patterns(space)[_PATTERN[group.excitation]])
    if moves and group.excitation.startswith("impulse"):
        return space._replace(blow=group.impulse_n_m_s * _blow_axis(group))  # type: ignore[arg-type]
    return space


def _blow_axis(group: Group) -> Array:
    """Return the axis of a blow in B: that of the head at rest for torsion, else y or z."""
    if group.excitation == "impulse-torsion":
        bend, azimuth = group.pose.bend_rad, group.pose.azimuth_rad
        return np.array([np.cos(bend), np.sin(bend) * np.cos(azimuth), np.sin(bend) * np.sin(azimuth)])
    return np.array([0.0, 1.0, 0.0] if group.excitation == "impulse-pitch" else [0.0, 0.0, 1.0])


def swing_lanes(
    lanes: SpaceLanes,
    groups: Sequence[Group],
    sample_hz: float,
    steps: int | None = None,
    progress: Progress | None = None,
) -> list[Swing]:
    """Return the true motion of every group, sampled at `sample_hz`; see `sinew.solve.march`."""
    samples = [sum(g.sample_counts(sample_hz)) for g in groups]
    return swing(lanes.space, lanes.q, samples, 1 / sample_hz, steps=steps, progress=progress)


def join_swings(swings: Sequence[Swing], lanes: SpaceLanes, imu: Imu) -> Moved:
    """Return the true motion of lanes, one after the other, with what a chip at (0, r, 0) of frame H feels.

    Its specific force, in axes of H: Rᵀ(a - g) + ω̇ × r + ω × (ω × r), a of the plate's centre.
    """
    counts = np.array([one.lever.size for one in swings])
    joined = Swing(*(np.concatenate([getattr(s, name) for s in swings], axis=-1) for name in Swing._fields))
    rotations, spin = joined.rotations, joined.spin.T
    weight = np.repeat(np.asarray(lanes.space.weight), counts, axis=0)
    arm = np.array([0.0, imu.mount_radius.value, 0.0])
    felt = np.einsum("nji,nj->ni", rotations, joined.acceleration.T - weight)
    felt += np.cross(joined.spin_rate.T, arm) + np.cross(spin, np.cross(spin, arm))
    orientation = Rotation.from_matrix(rotations).as_quat(scalar_first=True)
    edges = np.cumsum(counts)[:-1]
    return Moved(
        counts=counts,
        torsion=np.concatenate([torsion_of(part) for part in np.split(orientation, edges)]),
        lever=joined.lever,
        lever_rate=joined.lever_rate,
        duty=joined.duty,
        stretch=joined.stretch.T,
        driven=joined.take_up.T,
        at_rest=lanes.take_up,
        gyro=joined.gyro.T,
        gyro_rate=joined.gyro_rate.T,
        spin=spin,
        force=felt,
        orientation=_continuous(orientation, edges),
    )


def _continuous(orientation: Array, edges: NDArray[np.intp]) -> Array:
    """Return quaternions (n, 4) without jumps of sign inside a group; each begins with w ≥ 0."""
    parts = []
    for part in np.split(orientation, edges):
        flips = np.where(np.sum(part[1:] * part[:-1], axis=1) < 0, -1.0, 1.0)
        sign = np.concatenate([[1.0 if part[0, 0] >= 0 else -1.0], flips])
        parts.append(part * np.cumprod(sign)[:, None])
    return np.concatenate(parts)
