"""The joint linear about its rest: the equations of `sinew.mechanics.joint`, differentiated there.

Two systems per pretension. `drive` has the lever on its servo: from the command, and from a torque on the head, to
torsion and lever. `lever` has the lever moved as lines: from its angle, and from a torque on the head, to torsion.

What is not smooth at rest is not linearised tacitly:

- Guide friction: at small angles the bristle follows the torsion, z = φ/φ_s, so it is a spring of stiffness μ ΣT/φ_s.
  Its loss grows with the amplitude and is nothing to first order; the bristle's state is replaced by that relation.
- Coulomb friction of the gear turns round over a small speed. A lever slower than that creeps, as on a damper; one
  that is faster slides against a constant, which has no part in a linear response. `Gear` says which is meant.
- The duty is taken below its limit, tendons as they are at rest.

Shortening moves the torsion only to second order (tendons lengthen either way), so it leaves both systems.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy import io
from scipy.linalg import null_space

from sinew.measure.arrays import Array, Complexes
from sinew.measure.errors import SpecError
from sinew.measure.estimate import number
from sinew.measure.result import Column, Field, Result, Rows, plain
from sinew.measure.validation import write_atomically
from sinew.mechanics.joint import State, derivative, free_lever_acceleration, rate, state_at_rest
from sinew.mechanics.parameters import Parameters
from sinew.mechanics.silicone import BRANCHES
from sinew.mechanics.tendons import tendon_stretch, tendon_tension, total_tension
from sinew.plan.plan import Group, TendonMode
from sinew.plan.rig import RigSpec
from sinew.predict.oscillator import Oscillator
from sinew.solve.branch import Branch
from sinew.solve.programs import program
from sinew.twin.parameters import Effects
from sinew.twin.simulate import lane_parameters

# A linear system is kept as a state space, and asked for poles, zeros, gains and frequency response.
#
#     ẋ = A x + B u,        y = C x + D u,        G(s) = C (s - A)⁻¹ B + D
#
# Plain arrays: `control.ss` of python-control and `ss` of MATLAB read (A, B, C, D) as they are.


_NO_GAIN = 1e-12
_ORIGIN = 1e-6
"""A double root at the origin comes out of the eigenvalues as far from it as the root of their rounding."""


@dataclass(frozen=True, repr=False)
class Pole(Result):
    """A pole or zero s [1/s]; frequency |s|/2π and damping ratio -Re s/|s|, which is one on the negative real axis and
    zero at the origin."""

    real_per_s: Annotated[float, Field("real")]
    imag_per_s: Annotated[float, Field("imaginary")]
    frequency_hz: Annotated[float, Field("undamped frequency")]
    damping_ratio: Annotated[float, Field("damping ratio")]

    @classmethod
    def at(cls, s: complex) -> "Pole":
        """Return the pole at a place of the complex plane."""
        return cls(s.real, s.imag, abs(s) / (2 * np.pi), -s.real / abs(s) if s != 0 else 0.0)

    @property
    def s(self) -> complex:
        """Return its place [1/s]."""
        return complex(self.real_per_s, self.imag_per_s)

    def cell(self) -> str:
        """Return it in words."""
        return f"{number(self.frequency_hz, unit='Hz')}, D {number(self.damping_ratio, 3)}"


@dataclass(frozen=True, repr=False)
class Channel(Result):
    """One input and one output: G(s) = gain Π(s - zeros)/Π(s - poles); static_gain: G(0)."""

    input: Annotated[str, Field("input")]
    output: Annotated[str, Field("output")]
    zeros: Annotated[Rows[Pole], Field("", "detail")]
    gain: Annotated[float, Field("gain")]
    static_gain: Annotated[float, Field("static gain")]


@dataclass(frozen=True, repr=False)
class StateSpace(Result):
    """A linear system in SI. a (n, n), b (n, i), c (o, n), d (o, i); states (n), inputs (i), outputs (o): names with
    their units."""

    a: Column
    b: Column
    c: Column
    d: Column
    states: Annotated[tuple[str, ...], Field("", "detail")]
    inputs: Annotated[tuple[str, ...], Field("", "detail")]
    outputs: Annotated[tuple[str, ...], Field("", "detail")]

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON holds it, with its poles, and zeros and gains of its channels."""
        channels = Rows(self.channel(output, source) for source in self.inputs for output in self.outputs)
        return super().to_dict() | {"poles": plain(self.poles()), "channels": plain(channels)}

    def cell(self) -> str:
        """Return the poles that swing."""
        return "; ".join(pole.cell() for pole in self.poles() if pole.imag_per_s > 0) or "none"

    def poles(self) -> tuple[Pole, ...]:
        """Return the poles, the slowest first."""
        return _sorted(np.linalg.eigvals(self.a).astype(complex))

    def static(self) -> Array:
        """Return G(0), (o, i)."""
        return np.asarray(self.d - self.c @ np.linalg.solve(self.a, self.b))

    def response(self, frequency_hz: Array | list[float]) -> Complexes:
        """Return G(jω) at frequencies [Hz], shape (f, o, i)."""
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=float)
        matrix = s[:, None, None] * np.eye(len(self.a)) - self.a
        inner = np.linalg.solve(matrix, np.broadcast_to(self.b.astype(complex), (s.size, *self.b.shape)))
        return np.asarray(self.c @ inner + self.d)

    def channel(self, output: str, source: str) -> Channel:
        """Return zeros and gains from an input, by name, to an output."""
        i, o = self.inputs.index(source), self.outputs.index(output)
        b, c, d = self.b[:, i], self.c[o], float(self.d[o, i])
        zeros, gain = _zeros(self.a, b, c, d)
        static = float(d - c @ np.linalg.solve(self.a, b))
        return Channel(source, output, Rows(_sorted(zeros)), gain, static)


def _sorted(roots: Complexes) -> tuple[Pole, ...]:
    """Return roots, the smallest first; those that rounding has moved away from the origin are put back."""
    small = _ORIGIN * np.max(np.abs(roots), initial=0.0)
    clean = [complex(root) if abs(root) > small else 0j for root in roots]
    return tuple(Pole.at(s) for s in sorted(clean, key=lambda s: (round(abs(s), 9), s.imag)))


def _zeros(a: Array, b: Array, c: Array, d: float) -> tuple[Complexes, float]:
    """Return (finite zeros, gain) of one channel.

    With r the first number for which h = C Aʳ⁻¹ B is not zero, feedback u = -C Aʳ x / h keeps the output at zero for
    ever on the space where C, C A, ... C Aʳ⁻¹ vanish; the zeros are the poles of what goes on there. No root at
    infinity has to be told from a large one, as it would in the pencil of the system matrix.
    """
    rows: list[Array] = []
    row, gain = c, d
    scale = float(np.linalg.norm(c) * np.linalg.norm(b)) + abs(d)
    while abs(gain) <= _NO_GAIN * scale:
        if len(rows) == len(a):
            return np.zeros(0, dtype=complex), 0.0
        rows.append(row)
        gain = float(row @ b)
        row = row @ a
        scale = float(np.linalg.norm(rows[-1]) * np.linalg.norm(b))
    inner = a - np.outer(b, row) / gain
    if not rows:
        return np.linalg.eigvals(inner).astype(complex), gain
    unit = np.stack([one / np.linalg.norm(one) for one in rows])
    rest = null_space(unit)
    return np.linalg.eigvals(rest.T @ inner @ rest).astype(complex), gain


Gear = Literal["sliding", "creeping"]

GEARS: tuple[Gear, ...] = ("sliding", "creeping")
"""How the gear's Coulomb friction is taken: as a constant that the moving lever slides against, or as the damper that
it is to a lever that hardly moves."""

_NAMES = (
    *("torsion_rad", "torsion_rate_rad_s", "shortening_m", "shortening_rate_m_s", "lever_rad", "lever_rate_rad_s"),
    *(f"memory_{i + 1}_rad" for i in range(BRANCHES)),
    *(f"axial_memory_{i + 1}_m" for i in range(BRANCHES)),
)
"""States of the twin, without those of the gyroscope's low-pass, which acts on nothing, and after it the bristles."""

_LOW_PASS = 2

_PLACE = {name: i for i, name in enumerate(_NAMES)}
_MEMORY = tuple(name for name in _NAMES if name.startswith("memory"))
_COUPLING = 1e-9


@dataclass(frozen=True, repr=False)
class LinearJoint(Result):
    """One joint at one pretension, linear. tension_n: of each tendon at rest. guide_stiffness_n_m_rad: of the guides
    before they slip, μ ΣT/φ_s. notes: sentences on what is not in it. drive, lever: the two systems. error_limit: error
    of angle at which the duty is at its limit [rad]."""

    error_limit: float
    pretension_mm: Annotated[float, Field("pretension")]
    tension_n: Annotated[float, Field("tension")]
    guide_stiffness_n_m_rad: Annotated[float, Field("guides", unit="N m/rad")]
    notes: Annotated[tuple[str, ...], Field("", "detail")]
    lever: Annotated[StateSpace, Field("lever as told", unit="")]
    drive: Annotated[StateSpace, Field("on its servo", unit="")]


@program()
def _slopes(shortening: jax.Array, p: Parameters) -> tuple[jax.Array, ...]:
    """Return the derivatives of the rates at rest: by the states, by the command, by a torque on the head and by the
    lever's acceleration."""

    def one(shortening: jax.Array, p: Parameters) -> tuple[jax.Array, ...]:
        idle = p._replace(amplitude=jnp.zeros(()), omega=jnp.ones(()), stop_s=jnp.full((), jnp.inf))
        rest, unravel = jax.flatten_util.ravel_pytree(state_at_rest(shortening, idle))
        top = jnp.asarray(0.5 * jnp.pi)  # where a command A sin t is A

        def flat(state: State) -> jax.Array:
            return jax.flatten_util.ravel_pytree(state)[0]

        def by_state(y: jax.Array) -> jax.Array:
            return flat(rate(jnp.zeros(()), unravel(y), idle))

        def by_command(angle: jax.Array) -> jax.Array:
            return flat(rate(top, unravel(rest), idle._replace(amplitude=angle)))

        def by_torque(torque: jax.Array) -> jax.Array:
            turned = free_lever_acceleration(torque, jnp.zeros(()), idle)
            lever = jnp.where(idle.prescribed > 0, 0.0, turned)
            return flat(derivative(unravel(rest), torque, jnp.zeros(()), lever, idle))

        def by_lever(acceleration: jax.Array) -> jax.Array:
            return flat(derivative(unravel(rest), jnp.zeros(()), jnp.zeros(()), acceleration, idle))

        zero = jnp.zeros(())
        inputs = [jax.jacfwd(column)(zero) for column in (by_command, by_torque, by_lever)]
        return jax.jacfwd(by_state)(rest), *inputs

    return jax.vmap(one)(shortening, p)


@program()
def _rest(shortening: jax.Array, p: Parameters) -> tuple[jax.Array, jax.Array]:
    def one(shortening: jax.Array, p: Parameters) -> tuple[jax.Array, jax.Array]:
        zero = jnp.zeros(())
        stretch = tendon_stretch(zero, shortening, p)[0]
        spring = p.guides.stiffness(total_tension(zero, shortening, p))
        return tendon_tension(stretch, p), spring

    return jax.vmap(one)(shortening, p)


def _torsional(a: Array, names: tuple[str, ...]) -> tuple[Array, tuple[str, ...]]:
    """Return (A of the named states and the memory that acts on them, their names).

    A bristle bends with the torsion: its slope by the torsion's rate over that of the torsion (1/φ_s of Dahl's) is its
    deflection by the torsion. What is left out must not act on what stays.
    """
    torsion, speed = _PLACE["torsion_rad"], _PLACE["torsion_rate_rad_s"]
    a = a.copy()
    for bristle in range(len(_PLACE) + _LOW_PASS, len(a)):
        a[:, torsion] += a[:, bristle] * a[bristle, speed]
    names += tuple(name for name in _MEMORY if a[speed, _PLACE[name]] != 0)
    columns = [_PLACE[name] for name in names]
    axial = [i for name, i in _PLACE.items() if name.startswith(("shortening", "axial"))]
    assert np.abs(a[np.ix_(columns, axial)]).max() <= _COUPLING * np.abs(a[columns]).max()
    return a[np.ix_(columns, columns)], names


def _drive(a: Array, by_command: Array, by_torque: Array) -> StateSpace:
    part, names = _torsional(a, ("torsion_rad", "torsion_rate_rad_s", "lever_rad", "lever_rate_rad_s"))
    columns = [_PLACE[name] for name in names]
    seen = np.eye(len(names))[[0, 2]]
    inputs, outputs = ("command_rad", "torque_n_m"), ("torsion_rad", "lever_rad")
    return StateSpace(
        part, np.stack([by_command, by_torque], axis=1)[columns], seen, np.zeros((2, 2)), names, inputs, outputs
    )


def _lever(a: Array, by_torque: Array, by_acceleration: Array) -> StateSpace:
    """Return the system whose lever moves as told, by angle.

    The lever acts by its acceleration: ẋ = A x + e θ̈. With x = ξ + A e θ + e θ̇ this is ξ̇ = A ξ + A² e θ, and the
    torsion, whose own row of e is zero, is that of ξ + A e θ: no derivative of the input is left.
    """
    part, names = _torsional(a, ("torsion_rad", "torsion_rate_rad_s"))
    columns = [_PLACE[name] for name in names]
    e = by_acceleration[columns]
    shifted = tuple(f"{name}_less_lever" if i < 2 else name for i, name in enumerate(names))
    seen = np.eye(len(names))[:1]
    b = np.stack([part @ part @ e, by_torque[columns]], axis=1)
    d = np.concatenate([seen @ part @ e, [0.0]])[None]
    return StateSpace(part, b, seen, d, shifted, ("lever_rad", "torque_n_m"), ("torsion_rad",))


def _notes(p: Parameters, tension: float, spring: float, gear: Gear) -> tuple[str, ...]:
    notes = []
    if spring > 0:
        turn = np.degrees(float(p.guides.reach))
        notes.append(
            f"the guides' friction is a spring of {spring:.3g} N m/rad without loss, right for torsions far below "
            f"{turn:.3g}°; its loss grows with the amplitude"
        )
    if float(p.drive_friction) > 0:
        sticks = np.degrees(float(p.drive_friction / (p.duty_torque * p.position_gain)))
        slides = f"commands far above {sticks:.2g}°" if gear == "sliding" else f"commands far below {sticks:.2g}°"
        does = "slides against a constant friction" if gear == "sliding" else "creeps"
        notes.append(f"the gear {does}: right for {slides}")
    limit = np.degrees(float(p.duty_limit / p.position_gain))
    if limit < 360:
        notes.append(f"the duty limit is not in it: the drive saturates where lever and command are {limit:.3g}° apart")
    if tension <= 0:
        notes.append("the tendons carry no load at rest: they act only at larger torsions, which is not in it")
    return tuple(notes)


def linear_joints(
    rig: RigSpec,
    pretension_mm: NDArray[np.float64] | list[float],
    *,
    gear: Gear = "sliding",
    mode: TendonMode = "position",
    effects: Effects | None = None,
) -> tuple[LinearJoint, ...]:
    """Return the linear joint at each pretension [mm], for motions so small that the stiffness does not change.

    gear: how the friction of the drive's gear is taken, see `GEARS`. mode: of the tendon motors.
    effects: of the twin; without `drive_dynamics` the lever follows its command, so use `LinearJoint.lever`.
    """
    effects = effects or Effects()
    groups = [Group("steady", float(mm), 1.0, 1.0, 0, 1.0, 1.0) for mm in np.atleast_1d(pretension_mm)]
    lanes, shortening = lane_parameters(groups, rig, mode=mode, effects=effects)
    lanes = lanes._replace(prescribed=np.zeros_like(shortening))  # type: ignore[arg-type]
    if gear == "sliding":
        lanes = lanes._replace(drive_friction=np.zeros_like(shortening))  # type: ignore[arg-type]
    held = lanes._replace(prescribed=np.ones_like(shortening))  # type: ignore[arg-type]
    free = [np.asarray(leaf) for leaf in _slopes(shortening, lanes)]
    slopes = [np.asarray(leaf) for leaf in _slopes(shortening, held)]
    tension, spring = (np.asarray(leaf) for leaf in _rest(shortening, lanes))
    own = float(rig.drive.friction.value)
    joints = []
    for i, group in enumerate(groups):
        p = jax.tree.map(lambda leaf, i=i: np.asarray(leaf)[i], lanes)._replace(drive_friction=np.asarray(own))
        joints.append(
            LinearJoint(
                float(p.duty_limit / p.position_gain),
                group.pretension_mm,
                float(tension[i]),
                float(spring[i]),
                _notes(p, float(tension[i]), float(spring[i]), gear),
                _lever(slopes[0][i], slopes[2][i], slopes[3][i]),
                _drive(free[0][i], free[1][i], free[2][i]),
            )
        )
    return tuple(joints)


# Linear joints become files: JSON for python-control and everybody else, MAT for MATLAB.

_SYSTEMS = ("drive", "lever")


def _cells(values: Sequence[Any]) -> Any:
    cells = np.empty((len(values), 1), dtype=object)
    cells[:, 0] = values
    return cells


def _matlab(joints: Sequence[LinearJoint], space: Sequence[StateSpace]) -> dict[str, Any]:
    """Return the variables of a MAT file: `pretension_mm`, a column, and for each system a struct with the cells A, B,
    C, D, a row for each pretension, and the names of states, inputs and outputs."""
    content: dict[str, Any] = {"pretension_mm": np.array([[joint.pretension_mm] for joint in joints])}
    kinds: dict[str, Sequence[StateSpace]] = {name: [getattr(one, name) for one in joints] for name in _SYSTEMS}
    for name, systems in (kinds | ({"space": space} if space else {})).items():
        content[name] = {key.upper(): _cells([getattr(s, key) for s in systems]) for key in ("a", "b", "c", "d")}
        content[name] |= {key: _cells(list(getattr(systems[0], key))) for key in ("states", "inputs", "outputs")}
    return content


def write_transfer(
    joints: Sequence[LinearJoint], document: Any, path: Path, space: Sequence[StateSpace] = ()
) -> tuple[Path, ...]:
    """Write linear joints, atomically, and return the files.

    path: ends with .mat or .json for one file; else a folder, for `transfer.json` and `transfer.mat`.
    document: what the JSON file holds. space: systems of the same pretensions in space, where wanted. Raises SpecError
    for another ending, FileError where nothing can be written.
    """
    if path.suffix and path.suffix not in (".mat", ".json"):
        raise SpecError(f"--out is {path}, expected a name that ends with .json or .mat, or a folder")
    files = (path,) if path.suffix else (path / "transfer.json", path / "transfer.mat")

    def write_json(temporary: Path) -> None:
        temporary.write_text(json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n", "utf-8")

    def write_mat(temporary: Path) -> None:
        io.savemat(str(temporary), _matlab(joints, space), appendmat=False, format="5", long_field_names=True)

    for file in files:
        write_atomically(file, write_mat if file.suffix == ".mat" else write_json)
    return files


# ---- the fundamental of a steady motion alone: stiffness and damping over amplitude
#
# With the phasors of the fundamentals, torsion Φ, lever Θ and a torque M from outside, the fundamental of the equation
# of motion of the head is
#
#     (k + jΩd) Φ = Ω² (I Φ + I_l Θ) + M,
#
# so k and d are those of the linear spring and damper that would take the fundamental's place. They change with the
# amplitude; where the torsion lags behind what drives it by 90°, k = I Ω². Harmonics above the first have no part in
# it.


_HIGHEST_SHARE = 5


@dataclass(frozen=True)
class Equivalent:
    """Stiffness k and damping d that take the fundamental's place, (n,); damping_ratio d/(2 sqrt(k I)), not a number
    where k is not positive."""

    stiffness_n_m_rad: Array
    damping_n_m_s_rad: Array
    damping_ratio: Array


def harmonic_shares(branch: Branch) -> dict[int, Array]:
    """Return the amplitudes of the harmonics from the second to the fifth as shares of the fundamental's, (n,) each.

    Orders that the equations' symmetry rules out are not there.
    """
    first = branch.fundamental
    return {
        int(h): np.abs(branch.harmonics[:, i]) / first for i, h in enumerate(branch.orders) if 1 < h <= _HIGHEST_SHARE
    }


def _equivalent(branch: Branch, inertia: float, push: Complexes) -> Equivalent:
    omega = 2 * np.pi * branch.frequency_hz
    dynamic = omega**2 * inertia + push / branch.phasor
    stiffness, damping = dynamic.real, dynamic.imag / omega
    root = np.sqrt(np.where(stiffness > 0, stiffness, np.nan) * inertia)
    return Equivalent(stiffness, damping, damping / (2 * root))


def equivalent_of_rig(branch: Branch, lever: Complexes, rig: RigSpec) -> Equivalent:
    """Return the equivalent spring and damper of a rig's joint. lever: phasor of its fundamental [rad], (n,)."""
    inertia = rig.inertia
    omega = 2 * np.pi * branch.frequency_hz
    push = np.asarray(omega**2 * inertia.lever.value * lever, dtype=complex)
    return _equivalent(branch, inertia.head.value + inertia.lever.value, push)


def equivalent_of_oscillator(branch: Branch, one: Oscillator, share: Array | float = 1.0) -> Equivalent:
    """Return the equivalent spring and damper of an oscillator. share: of its drive that acts, (n,) or one number."""
    omega = 2 * np.pi * branch.frequency_hz
    push = -1j * share * (one.torque + one.inertia * omega**2 * one.base)
    return _equivalent(branch, one.inertia, np.asarray(push, dtype=complex))
