"""The bent joint linear: from lever and tendons to torsion, pitch, roll and axial motion, and the spinal engine.

With x the 18 coordinates of `sinew.solve.spatial` about a rest pose, z_i those of the silicone's dashpots,

    M x¨ + m θ¨ + d t tᵀ x˙ + (K + k_g t tᵀ) x + Σ g_i K_0 (x - z_i) = P u + t τ,        z˙_i = (x - z_i)/τ_i,

θ the lever's angle against the head, u what motors take up of the tendons in patterns P, t the slope of the torsion by
the coordinates, τ a torque on the head about its torsion, k_g of guides that hold. Tendon motors keep to their mode: in
current mode they do not feel what they take up, so u does nothing.

The state space keeps a few shapes: the slowest modes, and what each input brings about when it comes slowly, so that
statics are exact; `cut` says how far the response is off from that of all coordinates.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg

from sinew.measure.arrays import Array, Complexes
from sinew.measure.errors import SpecError
from sinew.measure.result import Column, Field, Result, Rows, plain
from sinew.mechanics.drive import holding_stiffness
from sinew.mechanics.rod import rod_poses
from sinew.mechanics.silicone import glassy_factor, relaxation_times
from sinew.mechanics.space import Space
from sinew.plan.check import Finding
from sinew.plan.plan import Group, TendonMode
from sinew.plan.rig import RigSpec
from sinew.plan.servo import PAPER_TENDON, SERVOS
from sinew.predict.linear import Gear, LinearJoint, StateSpace, linear_joints
from sinew.predict.modes import Finder, ModesRequest, across_of, out_of_plane
from sinew.predict.predicted import refuse_pretensions
from sinew.solve.programs import program
from sinew.solve.spatial import Linear, Rest, linear_equations, patterns
from sinew.twin.parameters import Effects

INPUTS = ("lever_rad", "pitch_take_up_m", "roll_take_up_m", "common_take_up_m", "torque_n_m")
"""The lever's angle against the head; how much of its tendons each motor takes up, cosine-like about y and about z, and
all alike; a torque on the head."""

OUTPUTS = ("torsion_rad", "pitch_rad", "roll_rad", "axial_m")
"""Of the head: torsion, tilt about y and z of frame B by swing and twist, and rise of the plate along x of B."""

SHAPES = 8
"""Modes that a state space keeps, beside the shapes of its inputs: those below some 40 Hz."""

CHECKED_HZ = (0.3, 12.0)


@program()
def _reach(q: jax.Array, space: Space) -> jax.Array:
    """Return the slope of the plate's place along x by the coordinates, (18,)."""

    def rise(flat: jax.Array) -> jax.Array:
        return rod_poses(flat.reshape(q.shape), space.rod)[1][-1, 0]

    return jnp.asarray(jax.grad(rise)(q.ravel()))


class _Seen(NamedTuple):
    """Slopes of the outputs by the coordinates (4, 18); forces of the inputs but the lever's (18, 4); the force of the
    lever's acceleration (18,)."""

    outputs: Array
    forces: Array
    lever: Array


def _seen(linear: Linear, space: Space, q: Array) -> _Seen:
    at = linear.around
    outputs = np.vstack([at.by_torsion, at.by_tilt, np.asarray(_reach(q, space))])
    common, pitch, roll = patterns(space)
    # Taking up shortens the cable between its ends: the slack length falls.
    pulled = [at.by_end @ pattern for pattern in (pitch, roll, common)]
    return _Seen(outputs, np.stack([*pulled, at.by_torsion], axis=1), -linear.lever_row)


@dataclass(frozen=True, repr=False)
class BentJoint(StateSpace):
    """One joint at one pose, linear. cut: largest deviation of its response from that of all coordinates, over
    `CHECKED_HZ`, of the largest response from the same input to the same output."""

    pretension_mm: Annotated[float, Field("pretension")]
    bend_deg: Annotated[float, Field("bend")]
    azimuth_deg: Annotated[float, Field("azimuth")]
    tension_n: Column
    taut: Annotated[bool, Field("taut")]
    guide_stiffness_n_m_rad: Annotated[float, Field("guides", unit="N m/rad")]
    cut: Annotated[float, Field("cut", unit="%")]
    static_gain: Annotated[Mapping[str, Mapping[str, float]], Field("", "detail")]

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON holds it, with its poles; of so many states rounding leaves no zeros of the channels."""
        return Result.to_dict(self) | {"poles": plain(self.poles())}

    def slowest(self) -> str:
        """Return the three slowest poles that swing."""
        swung = [pole.cell() for pole in self.poles() if pole.imag_per_s > 0 and pole.damping_ratio < 1]
        return "; ".join(swung[:3])


def response(
    linear: Linear,
    space: Space,
    q: Array,
    frequency_hz: Array | Sequence[float],
    swing: float | None = None,
) -> Complexes:
    """Return outputs by inputs of all coordinates at frequencies [Hz], (f, output, input), the lever locked.

    swing: amplitude of the torsion [rad] at which the guides slip, with spring and loss of their fundamental; where
    None they hold.
    """
    seen = _seen(linear, space, q)
    found = []
    for hz in np.atleast_1d(frequency_hz):
        omega = math.tau * float(hz)
        dynamic = _held(linear, space, omega) + _given(linear, space, omega, swing, None)
        forces = np.column_stack([-(omega**2) * seen.lever, seen.forces])
        found.append(seen.outputs @ np.linalg.solve(dynamic, forces))
    return np.array(found)


def _held(linear: Linear, space: Space, omega: float) -> Complexes:
    """Return the dynamic stiffness (18, 18) of guides that hold and a lever that is locked, at ω [rad/s]."""
    storage, loss = linear.stiffness(omega, space)
    return np.asarray(storage + 1j * loss - omega**2 * linear.mass, dtype=np.complex128)


def _given(linear: Linear, space: Space, omega: float, swing: float | None, give: float | None) -> Complexes:
    """Return what guides that slip and a lever that gives way add to the dynamic stiffness (18, 18).

    swing: as of `response`. give: amplitude [rad] by which the lever gives way where its motor holds it, beside what
    the input moves; where None it is locked.
    """
    at = linear.around
    more = np.zeros_like(linear.mass, dtype=np.complex128)
    if swing is not None:
        spring, loss = space.rod.joint.guides.fundamental(float(at.tension.sum()), np.asarray(swing))
        more += complex(float(spring) - linear.guides, float(loss)) * np.outer(at.by_torsion, at.by_torsion)
    if give is not None:
        more -= omega**2 * np.outer(linear.lever_row, _lever_yield(linear, space, omega, give))
    return more


def _lever_yield(linear: Linear, space: Space, omega: float, give: float) -> Complexes:
    """Return the lever's angle by the coordinates (18,) where its motor holds it in a command that stands still.

    Of the lever and the rotor, I_s θ¨ + m·x¨ = -Z θ with the motor's stiffness Z at an amplitude [rad].
    """
    joint = space.rod.joint
    inertia = float(space.lever_tensor[0]) + float(joint.armature)
    stiffness = holding_stiffness(give, omega, joint)
    return np.asarray(omega**2 * linear.lever_row / (stiffness - omega**2 * inertia), dtype=np.complex128)


_MOST_STEPS, _ENOUGH = 100, 1e-6


class Driven(NamedTuple):
    """What a drive moves: outputs (output,), and the lever's angle where its motor holds it [rad]."""

    moved: Complexes
    lever: complex


def driven(
    linear: Linear,
    space: Space,
    q: Array,
    frequency_hz: float,
    drive: Array,
    *,
    held: bool = False,
) -> Driven:
    """Return what moves at a frequency where the guides slip in the very torsion that comes of the drive.

    drive: amplitude of each of `INPUTS`, (5,). held: the lever is held by its motor, which gives way by what its own
    torque line and its gear's friction make of that amplitude; else locked.
    """
    omega, seen = math.tau * frequency_hz, _seen(linear, space, q)
    holding = _held(linear, space, omega)
    force = np.column_stack([-(omega**2) * seen.lever, seen.forces]) @ drive
    torsion, give = 0.0, 0.0
    for _ in range(_MOST_STEPS):
        given = give if held else None
        x = np.linalg.solve(holding + _given(linear, space, omega, torsion, given), force)
        lever = complex(_lever_yield(linear, space, omega, give) @ x) if held else 0j
        before, torsion, give = (torsion, give), float(abs(seen.outputs[0] @ x)), abs(lever)
        if math.hypot(torsion - before[0], give - before[1]) <= _ENOUGH * torsion:
            break
    return Driven(seen.outputs @ x, lever)


def state_space(linear: Linear, space: Space, q: Array, shapes: int = SHAPES) -> StateSpace:
    """Return the state space of a pose. shapes: how many modes it keeps; 18 keeps all coordinates.

    States: amplitudes of the shapes less what the lever moves of them at once, their rates, and those of the dashpots.
    """
    seen, at = _seen(linear, space, q), linear.around
    twist = np.outer(at.by_torsion, at.by_torsion)
    held = at.stiffness + linear.guides * twist
    glassy = held + (float(glassy_factor(space.rod.joint)) - 1) * linear.memory
    basis = _basis(glassy, held, linear.mass, np.column_stack([seen.lever, seen.forces]), shapes)
    n = basis.shape[1]
    p = space.rod.joint
    shares = np.array([float(g) for g in p.prony_shares])
    times = relaxation_times()
    memory = basis.T @ linear.memory @ basis
    # Shapes are orthonormal by the mass, so their mass matrix is one.
    a = np.zeros(((2 + times.size) * n, (2 + times.size) * n))
    a[:n, n : 2 * n] = np.eye(n)
    a[n : 2 * n, :n] = -(basis.T @ held @ basis + shares.sum() * memory)
    a[n : 2 * n, n : 2 * n] = -float(p.viscous) * (basis.T @ twist @ basis)
    for i, (share, time) in enumerate(zip(shares, times, strict=True)):
        mine = slice((2 + i) * n, (3 + i) * n)
        a[n : 2 * n, mine] = share * memory
        a[mine, :n] = np.eye(n) / time
        a[mine, mine] = -np.eye(n) / time
    c = np.zeros((len(OUTPUTS), len(a)))
    c[:, :n] = seen.outputs @ basis
    forces = np.zeros((len(a), len(INPUTS) - 1))
    forces[n : 2 * n] = basis.T @ seen.forces
    e = np.zeros(len(a))
    e[n : 2 * n] = basis.T @ seen.lever
    # The lever acts by its acceleration; see `sinew.predict.linear` for how its angle becomes the input.
    b = np.column_stack([a @ a @ e, forces])
    d = np.column_stack([c @ a @ e, np.zeros((len(OUTPUTS), forces.shape[1]))])
    names = (
        *(f"shape_{i + 1}_less_lever" for i in range(n)),
        *(f"shape_{i + 1}_rate_less_lever" for i in range(n)),
        *(f"memory_{k + 1}_of_shape_{i + 1}" for k in range(times.size) for i in range(n)),
    )
    return StateSpace(a, b, c, d, names, INPUTS, OUTPUTS)


def _basis(glassy: Array, held: Array, mass: Array, forces: Array, shapes: int) -> Array:
    """Return shapes (18, n), orthonormal by the mass: the slowest modes and the static shapes of forces."""
    slow = scipy.linalg.eigh(glassy, mass)[1]
    if shapes >= len(mass):
        return np.asarray(slow)
    few = np.column_stack([slow[:, :shapes], np.linalg.solve(held, forces)])
    size = few / np.sqrt(np.einsum("ij,ik,kj->j", few, mass, few))
    left, singular, _ = np.linalg.svd(scipy.linalg.cholesky(mass) @ size, full_matrices=False)
    good = left[:, singular > 1e-9 * singular[0]]
    spanned = np.linalg.solve(scipy.linalg.cholesky(mass), good)
    turned = scipy.linalg.eigh(spanned.T @ glassy @ spanned)[1]
    return np.asarray(spanned @ turned)


def bent_joints(
    rig: RigSpec,
    pretension_mm: Sequence[float],
    bend_deg: float,
    *,
    azimuth_deg: float = 0.0,
    mode: TendonMode = "position",
    shapes: int = SHAPES,
) -> tuple[BentJoint, ...]:
    """Return the linear joint at each pretension [mm], its head bent. Raises SpecError where there is no such pose."""
    refuse_pretensions(rig, pretension_mm)
    finder = Finder(rig, ModesRequest(tuple(pretension_mm), (bend_deg,), azimuth_deg, mode))
    joints = []
    at = np.geomspace(*CHECKED_HZ, 60)
    for mm in pretension_mm:
        linear, space = finder.linear(mm, bend_deg)
        q = finder.at(mm, bend_deg).coordinates
        system = state_space(linear, space, q, shapes)
        whole, cut = response(linear, space, q, at), system.response(at)
        largest = np.abs(whole).max(axis=0)
        heard = largest > 1e-9 * largest.max(axis=0)
        off = np.abs(cut - whole).max(axis=0)[heard] / largest[heard]
        tension = linear.around.tension
        static = system.static().T.tolist()
        joints.append(
            BentJoint(
                **vars(system),
                pretension_mm=mm,
                bend_deg=bend_deg,
                azimuth_deg=azimuth_deg,
                tension_n=tension,
                taut=bool(np.all(tension > 0)),
                guide_stiffness_n_m_rad=linear.guides,
                cut=float(off.max(initial=0.0)),
                static_gain={
                    name: dict(zip(OUTPUTS, row, strict=True)) for name, row in zip(INPUTS, static, strict=True)
                },
            )
        )
    return tuple(joints)


# Linear joints of a rig together: what is written for python-control and MATLAB.


@dataclass(frozen=True, repr=False)
class TransferFunctions(Result):
    """A rig's linear joints. space: of the bent joint, where asked for."""

    rig: Annotated[str, Field("", "detail")]
    gear: Annotated[str, Field("", "detail")]
    mode: Annotated[str, Field("", "detail")]
    effects_off: Annotated[tuple[str, ...], Field("", "detail")]
    joints: Annotated[
        Rows[LinearJoint],
        Field("linear at rest: undamped frequency and damping ratio of the poles that swing"),
    ]
    space: Annotated[
        Rows[BentJoint] | None, Field("in space: lever and tendons to torsion, pitch, roll and axial motion")
    ] = None

    def closing(self) -> list[str]:
        """Return the slowest poles in space, and what is left out."""
        lines = [
            f"in space, at {one.pretension_mm:g} mm the slowest poles are {one.slowest()}" for one in self.space or ()
        ]
        first = self.joints[0]
        return [f"- {one}" for one in (*lines, *(f"at {first.pretension_mm:g} mm {note}" for note in first.notes))]


def transfer_functions(
    rig: RigSpec,
    pretension_mm: Sequence[float],
    *,
    gear: Gear = "sliding",
    mode: TendonMode = "position",
    effects: Effects | None = None,
    pose_deg: tuple[float, float] | None = None,
) -> TransferFunctions:
    """Return the linear joints of a rig at pretensions [mm].

    gear, mode, effects: as of `linear_joints`. pose_deg: bend and azimuth of the head, for the joint in space. Raises
    SpecError for a pretension that the rig does not allow, or without such a pose.
    """
    refuse_pretensions(rig, pretension_mm)
    effects = effects or Effects()
    joints = linear_joints(rig, list(pretension_mm), gear=gear, mode=mode, effects=effects)
    space = None
    if pose_deg is not None:
        space = Rows(bent_joints(rig, pretension_mm, pose_deg[0], azimuth_deg=pose_deg[1], mode=mode))
    off = tuple(name for name in Effects.names() if not getattr(effects, name))
    return TransferFunctions(rig.name, gear, mode, off, Rows(joints), space)


# The spinal engine: tendons drive a bent head sideways, and it twists.

SLOW_HZ = 0.1
"""What is called slow of the engine [Hz]: a period of ten seconds. A joint that is cast straight twists a sixth as far
yet when it is driven over hours; at 0.1 Hz most of the little that it does is the silicone's memory."""


class Engine(NamedTuple):
    """What sideways drive of the tendons gives at one frequency. take_up: of each tendon, largest amplitude that the
    motors' speed allows [m]; torsion, tilt: amplitudes of the head's torsion and of its tilt across [rad]; per_tilt:
    torsion over tilt; lag: of the torsion behind the tilt [rad]; give: amplitude of the lever, which its motor holds
    [rad]."""

    frequency_hz: float
    take_up: float
    torsion: float
    tilt: float
    per_tilt: float
    lag: float
    give: float


def servo_speed(rig: RigSpec, tension: float) -> float:
    """Return how fast a tendon's motor takes up cable under a tension [N] [m/s]: its torque line at 12 V."""
    servo = SERVOS.get(rig.wiring.tendon_model, SERVOS[PAPER_TENDON])
    radius = rig.tendons.pulley_radius.value
    return max(0.0, servo.no_load_speed * (1 - tension * radius / servo.stall_torque)) * radius


def driven_findings(
    rig: RigSpec, space: Space, rest: Rest, pretension_mm: float, groups: Sequence[Group], pose: str
) -> Iterator[Finding]:
    """Yield why a bench cannot drive its tendons as groups of a plan ask, about a rest pose: the first reason of each
    kind, of the frequency at which it is worst.

    The joint answers linearly. Refused is a tendon whose least tension within the cycle is not positive, one that
    exceeds the rig's limit, a head that leans further than limits.tilt_deg, and a motor that is to be faster than its
    torque line leaves it under the largest tension of the cycle.
    """
    linear = linear_equations(rest.q, space)
    at, stiffness, limits = linear.around, float(space.rod.joint.stiffness), rig.limits
    _, pitch, roll = patterns(space)
    worst: dict[str, tuple[float, str]] = {}
    for group in groups:
        pattern, omega = (pitch if group.excitation == "pitch" else roll), math.tau * group.frequency_hz
        storage, loss = linear.stiffness(omega, space)
        moved = np.linalg.solve(storage + 1j * loss - omega**2 * linear.mass, at.by_end @ pattern)
        take_up = 1e-3 * group.amplitude_mm
        swing = take_up * np.abs(stiffness * (at.by_span @ moved + pattern))
        tilt = math.degrees(take_up * float(np.linalg.norm(at.by_tilt @ moved)))
        least, most = at.tension - swing, at.tension + swing
        speed = take_up * omega * np.abs(pattern)
        can = np.array([servo_speed(rig, float(tension)) for tension in most])
        loose, tight, slow = int(np.argmin(least)), int(np.argmax(most)), int(np.argmax(speed / np.maximum(can, 1e-9)))
        follows = 1e3 * can[slow] / (omega * abs(pattern[slow])) if speed[slow] > 0 else math.inf
        question = f"{pose} at {pretension_mm:g} mm: {group.amplitude_mm:g} mm of cable at {group.frequency_hz:g} Hz"
        slack = f"leave tendon {loose + 1} {least[loose]:.0f} N of {at.tension[loose]:.0f} N, a bench drives taut ones"
        tense = f"pull tendon {tight + 1} with {most[tight]:.0f} N, the rig allows {limits.tension_n:g} N (tension_n)"
        leans = f"lean the head {tilt:.1f}° out of its pose, the rig allows {limits.tilt_deg:g}° (tilt_deg)"
        late = f"are too fast for the motor of tendon {slow + 1}: it follows {follows:.2g} mm under {most[slow]:.0f} N"
        for kind, excess, sentence in (
            ("slack", -least[loose], f"{slack}; lower amplitude_mm, or raise the pretension"),
            ("tension", most[tight] - limits.tension_n, f"{tense}; lower amplitude_mm"),
            ("tilt", tilt - limits.tilt_deg, f"{leans}; lower amplitude_mm"),
            ("speed", speed[slow] - can[slow], f"{late}; lower amplitude_mm, or the frequency"),
        ):
            if excess > 0 and excess > worst.get(kind, (0.0, ""))[0]:
                worst[kind] = (float(excess), f"{question} {sentence}")
    yield from (Finding("refuse", sentence) for _, sentence in worst.values())


def spinal_engine(
    finder: Finder, rig: RigSpec, pretension_mm: float, bend_deg: float, frequency_hz: float, *, locked: bool = False
) -> Engine:
    """Return what the tendons give that drive a bent head sideways, as fast as their motors can.

    The motors move their cable ends by A sin Ωt in the pattern across the bend; A is that at which the fastest of them
    reaches the speed that its torque line leaves at its rest tension. Guides slip at the torsion that comes of it, and
    the lever's motor, which holds it, gives way; locked: it does not, as if its gear stuck.
    """
    linear, space = finder.linear(pretension_mm, bend_deg)
    q = finder.at(pretension_mm, bend_deg).coordinates
    if finder.request.mode != "position":
        raise SpecError(f"the tendons are in mode {finder.request.mode}, expected position: else they cannot be driven")
    across = across_of(finder.direction)
    pattern = across @ patterns(space)[1:]
    limits = [
        servo_speed(rig, float(tension)) / abs(float(share))
        for tension, share in zip(linear.around.tension, pattern, strict=True)
        if abs(share) > 1e-9
    ]
    take_up = min(limits) / (2 * math.pi * frequency_hz)
    drive = np.zeros(len(INPUTS))
    drive[1:3] = take_up * across
    moved, lever = driven(linear, space, q, frequency_hz, drive, held=not locked)
    tilt = complex(out_of_plane(finder.direction, bend_deg) @ moved[1:3])
    ratio = complex(moved[0]) / tilt
    return Engine(
        frequency_hz, take_up, float(abs(moved[0])), abs(tilt), abs(ratio), float(-np.angle(ratio)), abs(lever)
    )
