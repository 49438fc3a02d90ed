"""The joint in space at rest and near it: rest poses, take-ups that bend it, its linear equations and modes."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg

from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.mechanics.parameters import CURRENT, POSITION
from sinew.mechanics.rod import STRAINS, memory_energy, rod_energy, straight
from sinew.mechanics.silicone import branch_stiffness, glassy_factor, relaxation_times
from sinew.mechanics.space import Space, head_motion, motion_of, tendon_spans, weight_energy
from sinew.mechanics.tendons import tendon_energy, tendon_tension
from sinew.solve.balance import QUICK_COMPILE
from sinew.solve.programs import program

FASTEST_OMEGA = 1200.0
"""Angular frequency [rad/s] above which modes of the rod are slowed to it, so that steps of 1.25 ms are stable."""

_LARGEST_MOVE = 0.2  # of a coordinate in one step of Newton's method [rad, strain]
_MOST_STEPS = 200
_TOLERANCE = 1e-11  # of forces, over the silicone's own stiffness against each coordinate


class Around(NamedTuple):
    """A pose and what small motion about it feels, the lever locked to the head; 18 coordinates.

    energy V [J], slope ∂V/∂q, stiffness ∂²V/∂q²: relaxed. spans, tension (tendon,). by_end (18, tendon): slope by the
    length at which each cable goes slack [J/m]; by_span (tendon, 18): ∂span/∂q [m], so the slope by each held tension.
    torsion, tilt (2,) [rad]; by_torsion (18,), by_tilt (2, 18).
    """

    energy: Any
    slope: Any
    stiffness: Any
    spans: Any
    tension: Any
    by_end: Any
    by_span: Any
    torsion: Any
    tilt: Any
    by_torsion: Any
    by_tilt: Any


@program(options=QUICK_COMPILE)  # 11 s of CPU instead of 19
def around(q: jax.Array, space: Space) -> Around:
    """Return what the joint is like at coordinates q (6, term), with the motors as they are set.

    The one compiled function of statics; Newton's method, and all that is asked of a pose, call it.
    """
    joint = space.joint
    tendons = space.cable_end.shape[0]

    def values(flat: jax.Array) -> jax.Array:
        at = flat.reshape(q.shape)
        torsion, tilt = head_motion(at, space)
        body = rod_energy(at, space.rod) + weight_energy(at, space)
        return jnp.concatenate([tendon_spans(at, space), body[None], torsion[None], tilt])

    def slopes(flat: jax.Array) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        now, push = jax.linearize(values, flat)
        each = jax.vmap(push)(jnp.eye(flat.size)).T
        return each, (now, each)

    second, (now, first) = jax.jacfwd(slopes, has_aux=True)(q.ravel())
    spans, by_span = now[:tendons], first[:tendons]
    stretch = spans - space.cable_end
    tension = tendon_tension(stretch, joint)
    grip = jax.jvp(lambda s: tendon_tension(s, joint), (stretch,), (jnp.ones_like(stretch),))[1]
    stiffness = second[tendons] + jnp.tensordot(tension, second[:tendons], 1)
    return Around(
        energy=now[tendons] + jnp.sum(tendon_energy(stretch, joint)),
        slope=first[tendons] + tension @ by_span,
        stiffness=stiffness + (by_span.T * grip) @ by_span,
        spans=spans,
        tension=tension,
        by_end=-by_span.T * grip,
        by_span=by_span,
        torsion=now[tendons + 1],
        tilt=now[tendons + 2 :],
        by_torsion=first[tendons + 1],
        by_tilt=first[tendons + 2 :],
    )


class Rest(NamedTuple):
    """A rest pose. q: coordinates (6, term). at: what it is like there. take_up: of each tendon from first contact
    (tendon,) [m]. residual: largest force that is left, over the silicone's stiffness. softest: least eigenvalue of the
    stiffness over the unloaded silicone's; at most zero where the pose is not stable. reached: the tilt asked for."""

    q: Array
    at: Around
    take_up: Array
    residual: float
    softest: float
    reached: bool

    @property
    def found(self) -> bool:
        """Whether it is a stable equilibrium with the tilt that was asked for."""
        return self.reached and self.residual < 1e-7 and self.softest > 0

    @property
    def taut(self) -> bool:
        """Whether all tendons are under tension."""
        return bool(np.all(self.at.tension > 0))


def _metric(space: Space, terms: int) -> Array:
    """Return the unloaded silicone's stiffness against each coordinate [J], (18,), without its memory."""
    p = space.rod.joint
    length = float(p.length)
    bends = [3 * float(b) / length for b in space.rod.bending]
    axial, shear = 3 * float(p.axial_rigidity) * length, float(space.rod.shear) * length
    rows = np.array([float(p.torsional_rigidity) / length, *bends, axial, shear, shear])
    return np.asarray((rows[:, None] / (2 * np.arange(terms) + 1)).ravel())


def settle(q: Array, space: Space) -> tuple[Array, Around]:
    """Return (coordinates (6, term), what they are like) where the joint rests, found downhill from q.

    Newton's method on the energy; where the stiffness is not positive, or the energy would rise, the step is shortened
    by the unloaded silicone's stiffness (Levenberg and Marquardt). Ends at a least energy, so at a stable pose, unless
    it starts just on a ridge.
    """
    scale = _metric(space, q.shape[1])
    root = np.sqrt(scale)
    space = jax.tree.map(jnp.asarray, space)  # moved once: three quarters of a call went into it
    here, damping = _numbers(q, space), 0.0
    for _ in range(_MOST_STEPS):
        if np.max(np.abs(here.slope) / root) < _TOLERANCE * np.sqrt(scale.max()):
            break
        lowest = _softest(here, scale)
        held = max(damping, 1e-2 - lowest if lowest < 1e-3 else 0.0)
        move = -np.linalg.solve(here.stiffness + held * np.diag(scale), here.slope)
        move *= min(1.0, _LARGEST_MOVE / np.max(np.abs(move)))
        moved = q + move.reshape(q.shape)
        after = _numbers(moved, space) if np.all(moved[3] > -0.6) else None
        if after is not None and after.energy <= here.energy + 1e-12 * max(abs(float(here.energy)), 1e-3):
            q, here, damping = moved, after, damping / 8 if damping > 1e-6 else 0.0
        else:
            damping = max(8 * held, 1e-3)
    return q, here


def _numbers(q: Array, space: Space) -> Around:
    return jax.tree.map(np.asarray, around(q, space))  # type: ignore[no-any-return]


def _softest(here: Around, scale: Array) -> float:
    root = np.sqrt(scale)
    return float(np.linalg.eigvalsh(here.stiffness / np.outer(root, root))[0])


def softest_of(here: Around, space: Space) -> float:
    """Return the least eigenvalue of a pose's stiffness over the unloaded silicone's; at most zero where it is not
    stable."""
    return _softest(here, _metric(space, here.slope.size // len(STRAINS)))


def _rest(q: Array, here: Around, space: Space, first_ends: Array, reached: bool = True) -> Rest:
    scale = _metric(space, q.shape[1])
    residual = float(np.max(np.abs(here.slope) / np.sqrt(scale)) / np.sqrt(scale.max()))
    return Rest(q, here, first_ends - np.asarray(space.cable_end), residual, _softest(here, scale), reached)


def first_contact(space: Space, tension: float) -> tuple[Array, Array]:
    """Return (coordinates, cable ends (tendon,) [m]) where every tendon is pulled with a current to a tension [N], from
    which take-ups are counted. A head that falls over under these tensions is held upright, see `stays_upright`."""
    pulled = _pulled(space, tension)
    upright = _held_upright(pulled)
    q, here = settle(np.asarray(straight()), pulled) if upright is None else (upright.q, upright.at)
    return q, here.spans - tension / float(space.rod.joint.stiffness)


def stays_upright(space: Space, tension: float) -> bool:
    """Return whether the joint carries its head while every tendon pulls with a tension [N]. Motors that hold a tension
    give way to a tilt, so that the silicone alone resists it; motors that hold positions resist it too."""
    return _held_upright(_pulled(space, tension)) is None


def _pulled(space: Space, tension: float) -> Space:
    return in_mode(space, CURRENT)._replace(held_tension=np.full(np.shape(space.held_tension), tension))


def _held_upright(pulled: Space) -> "Steered | None":
    """Return the pose at the tilt that tensions alone give, where the weight of the head would make it fall over from
    there; None where it does not."""
    q, bare = settle(np.asarray(straight()), pulled._replace(weight=np.zeros(3)))  # type: ignore[arg-type]
    held = steer(pulled, bare.tilt, q, np.zeros(2))
    return held if held is not None and softest_of(held.at, pulled) <= 0 else None


def in_mode(space: Space, mode: float) -> Space:
    """Return the parameters with the tendon motors in a mode of `mechanics.parameters`."""
    joint = space.rod.joint._replace(mode=np.float64(mode))  # type: ignore[arg-type]
    return space._replace(rod=space.rod._replace(joint=joint))


def patterns(space: Space) -> Array:
    """Return the patterns of take-ups (3, tendon): all alike, and two that bend, towards tilts about y and about z."""
    directions = np.array([[float(x) for x in pair] for pair in space.rod.joint.guide_directions])
    return np.stack([np.ones(len(directions)), -directions[:, 1], directions[:, 0]])


def rest(space: Space, contact: float, take_up: Array, start: Array | None = None) -> tuple[Space, Rest]:
    """Return (parameters, rest pose) of a joint whose motors hold positions: take_up from first contact (tendon,) [m].

    contact: tension of each tendon at first contact [N]. start: coordinates to go downhill from, else first contact.
    """
    q, ends = first_contact(space, contact)
    there = in_mode(space, POSITION)._replace(cable_end=ends - take_up)
    return there, _rest(*settle(q if start is None else start, there), there, ends)


def bend(space: Space, contact: float, pretension: float, tilt: Array, start: Rest | None = None) -> tuple[Space, Rest]:
    """Return (parameters with motors that hold positions, the rest pose) of a joint whose head is tilted.

    contact: tension of every tendon at first contact [N]. pretension: mean take-up from there [m]. tilt: of the head,
    rotation vector about y and z of B (2,) [rad]. The tendons are taken up alike and by two patterns across, the
    cosine and the sine of their direction. The pose is followed, stable or not, from a rest pose nearby (start), else
    from the straight one. Where the tilt cannot be reached, or the joint does not stay, the rest is not `found`;
    whether tendons are taut is the caller's to ask.
    """
    there, straight = rest(space, contact, np.full(np.shape(space.cable_end), pretension))
    ends = straight.take_up + np.asarray(there.cable_end)
    bent, pose = there, straight._replace(reached=False)
    for begin in (start, straight):
        if begin is not None and not pose.found:
            across = np.asarray(np.linalg.lstsq(patterns(space).T, begin.take_up, rcond=None)[0][1:])
            if (found := _followed(there, tilt, begin, across)) is not None:
                bent = set_across(there, found.across)
                pose = rest_at(bent, found.q, ends)
    return bent, pose


class Steered(NamedTuple):
    """A pose that was steered to. q: coordinates (6, term); across: how much of each pattern across (2,), [m] of cable
    where motors hold positions, [N] where they hold currents. at: what it is like there; move: the last step of
    Newton's method, by which q was moved after `at` was told (18,)."""

    q: Array
    across: Array
    at: Around
    move: Array


def set_across(space: Space, across: Array) -> Space:
    """Return the parameters with the motors set across: two patterns added to what each tendon has, see `patterns`."""
    pattern = across @ patterns(space)[1:]
    if float(space.rod.joint.mode) == CURRENT:
        return space._replace(held_tension=space.held_tension + pattern)
    return space._replace(cable_end=space.cable_end - pattern)


def steer(
    space: Space, tilt: Array, q: Array, across: Array, *, enough: float = 1e-9, most_steps: int = 12
) -> Steered | None:
    """Return the pose with a tilt (2,) [rad] beside one that is known (q, across); None where no way led there.

    space: with the motors as they are set for no tilt. Newton's method on rest and tilt together, 18 coordinates and
    two patterns of cable or tension: also where the pose is not stable, which is the caller's to ask (`Rest.softest`).
    enough: size of the step [rad, strain] below which it is the last one; the error left is about its square.
    """
    pattern, by_current = patterns(space)[1:], float(space.rod.joint.mode) == CURRENT
    size = q.size
    for _ in range(most_steps):
        here = _numbers(q, set_across(space, across))
        matrix = np.zeros((size + 2, size + 2))
        matrix[:size, :size] = here.stiffness
        matrix[:size, size:] = here.by_span.T @ pattern.T if by_current else -here.by_end @ pattern.T
        matrix[size:, :size] = here.by_tilt
        # Of tendons that are slack no take-up tells: the least of all steps.
        step = -np.linalg.lstsq(matrix, np.concatenate([here.slope, here.tilt - tilt]), rcond=1e-11)[0]
        largest = float(np.max(np.abs(step[:size])))
        step *= min(1.0, _LARGEST_MOVE / max(largest, 1e-30))
        q, across = q + step[:size].reshape(q.shape), across + step[size:]
        if not np.all(np.isfinite(q)) or np.any(q[3] < -0.6):
            return None
        if largest < enough:
            return Steered(q, across, here, step[:size])
    return None


def _followed(space: Space, tilt: Array, begin: Rest, across: Array) -> Steered | None:
    """Return the pose of `steer`, followed in steps of 2° from one nearby (begin, across); None where none leads on."""
    found: Steered | None = Steered(begin.q, across, begin.at, np.zeros(0))
    count = max(1, int(np.ceil(np.hypot(*(tilt - begin.at.tilt)) / np.radians(2.0))))
    for i in range(1, count + 1):
        if found is not None:
            found = steer(space, begin.at.tilt + (tilt - begin.at.tilt) * i / count, found.q, found.across)
    return found


def rest_at(space: Space, q: Array, first_ends: Array) -> Rest:
    """Return the rest pose at coordinates where the joint rests, with the motors as they are set.

    first_ends: cable ends at first contact (tendon,) [m]. The take-ups of motors that hold currents are those that
    would hold the same tensions by position.
    """
    found = _rest(q, _numbers(q, space), space, first_ends)
    if float(space.rod.joint.mode) != CURRENT:
        return found
    return found._replace(take_up=first_ends - found.at.spans + found.at.tension / float(space.rod.joint.stiffness))


def rest_by_tension(space: Space, contact: float, tension: Array) -> tuple[Space, Rest]:
    """Return (parameters, rest pose) of a joint whose motors hold currents: tension of each tendon (tendon,) [N].

    contact: tension of each tendon at first contact [N], where the way downhill begins.
    """
    q, ends = first_contact(space, contact)
    pulled = np.asarray(tension, dtype=float)
    there = in_mode(space, CURRENT)._replace(held_tension=pulled)
    return there, rest_at(there, settle(q, there)[0], ends)


def bend_by_tension(space: Space, contact: float, pretension: float, tilt: Array) -> tuple[Space, Rest | None]:
    """Return (parameters with motors that hold currents, the rest pose) of a joint whose head is tilted.

    The tendons pull as they do straight at that pretension [m], and by the two patterns across more or less; None where
    that cannot be found. Followed from the straight pose in steps of 2°, stable or not, so that the rest may not be
    `found`; tensions below zero, which no current can hold, are the caller's to refuse.
    """
    straight_one = rest(space, contact, np.full(np.shape(space.cable_end), pretension))[1]
    held = in_mode(space, CURRENT)._replace(
        held_tension=np.full(np.shape(space.cable_end), straight_one.at.tension.mean())
    )
    found = _followed(held, tilt, straight_one, np.zeros(2))
    if found is None:
        return held, None
    there = set_across(held, found.across)
    return there, rest_at(there, found.q, first_contact(space, contact)[1])


def hold(space: Space, pose: Rest, mode: float, limit: float) -> Space:
    """Return the parameters of a joint at a rest pose whose motors go on in another mode.

    In current mode they hold the tensions of the pose; position with a current limit yields `limit` [N] above them.
    """
    return in_mode(space, mode)._replace(held_tension=pose.at.tension + (0.0 if mode == CURRENT else limit))


class Linear(NamedTuple):
    """The linear equations of small motion about a rest pose, coordinates (18,).

    around: the pose. mass M and lever_row m: of the coordinates and their coupling to the lever's acceleration.
    memory: K_0, of which each Maxwell branch has its share g_i. guides: stiffness of guides that hold [N m/rad].
    """

    around: Around
    mass: Array
    lever_row: Array
    memory: Array
    guides: float

    def stiffness(self, omega: float, space: Space) -> tuple[Array, Array]:
        """Return (storage, loss) of the stiffness at an angular frequency [rad/s], (18, 18), for small swings: guides
        hold, the silicone remembers, the damper is in the loss."""
        p, twist = space.rod.joint, np.outer(self.around.by_torsion, self.around.by_torsion)
        storage, loss = branch_stiffness(np.array([float(g) for g in p.prony_shares]), omega * relaxation_times())
        held = self.around.stiffness + self.guides * twist + storage.sum() * self.memory
        return held, loss.sum() * self.memory + omega * float(p.viscous) * twist


@program()
def _inertia(q: jax.Array, space: Space) -> tuple[jax.Array, jax.Array, jax.Array]:
    zero = jnp.zeros(())
    moved = motion_of(q, jnp.zeros_like(q), zero, zero, space)
    one = tuple(jnp.full((), float(i == 0)) for i in range(len(space.rod.joint.prony_shares)))
    alone = space.rod._replace(joint=space.rod.joint._replace(prony_shares=one))

    def branch(flat: jax.Array) -> jax.Array:
        return memory_energy(flat.reshape(q.shape), jnp.broadcast_to(q, (len(one), *q.shape)), alone)

    return moved.mass, moved.lever_row, jax.hessian(branch)(q.ravel())


def linear_equations(q: Array, space: Space) -> Linear:
    """Return the linear equations about a rest pose q (6, term), the motors in the mode that is set."""
    here = _numbers(q, space)
    mass, row, memory = (np.asarray(a) for a in _inertia(q, space))
    return Linear(here, mass, row, memory, float(space.rod.joint.guides.stiffness(here.tension.sum())))


def slow_down(linear: Linear, space: Space, fastest: float = FASTEST_OMEGA) -> Space:
    """Return the parameters with inertia added to modes above `fastest` [rad/s], which then swing at it.

    Modes of the unrelaxed joint about the pose. What is added acts on those modes alone: Δ = M v (ω²/Ω² - 1) vᵀ M, so
    slower modes keep frequency and shape; far from the pose nearly so.
    """
    stiffness = linear.around.stiffness + (float(glassy_factor(space.rod.joint)) - 1) * linear.memory
    squares, shapes = scipy.linalg.eigh(stiffness, linear.mass)
    momenta = linear.mass @ shapes
    return space._replace(added=(momenta * np.maximum(squares / fastest**2 - 1, 0.0)) @ momenta.T)


class Mode(NamedTuple):
    """A mode of small motion. frequency_hz; damping: Lehr's, of silicone and viscous damper; shape: coordinates (18,)
    of unit modal mass; torsion, tilt (2,): of the head in it [rad]."""

    frequency_hz: float
    damping: float
    shape: Array
    torsion: float
    tilt: Array


def modes(linear: Linear, space: Space, below_hz: float = 40.0) -> list[Mode]:
    """Return the modes below a frequency [Hz], slowest first, the lever locked to the head.

    The silicone's storage is taken at each mode's own frequency. Raises SpecError at a pose that is not stable.
    """
    found: list[Mode] = []
    for index in range(linear.mass.shape[0]):
        omega = 0.0
        for _ in range(50):
            storage, loss = linear.stiffness(omega, space)
            squares, shapes = scipy.linalg.eigh(storage, linear.mass)
            if squares[index] <= 0:
                raise SpecError("the joint does not stay in this pose, expected a stable one; lower the pretension")
            before, omega = omega, float(np.sqrt(squares[index]))
            if abs(omega - before) < 1e-10 * omega:
                break
        if omega > 2 * np.pi * below_hz:
            break
        v = shapes[:, index]
        lost = float(v @ loss @ v)
        at = linear.around
        found.append(Mode(omega / (2 * np.pi), lost / (2 * omega**2), v, float(at.by_torsion @ v), at.by_tilt @ v))
    return found
