"""What the paper did not investigate of a bent joint: pulls, load, resonance, what moves with the torsion, engine.

Predicted for a rig from `sinew.predict.modes` and `sinew.predict.bent`: there is no recording of a bent joint. The
intervals are of what is assumed of head and lever, drawn as there; the second sentence of an answer says how a bench
would test it.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import minimize_scalar

from sinew.measure.arrays import Array
from sinew.measure.estimate import Estimate, number
from sinew.paper.answer import Answer, in_words, rows_of
from sinew.plan.rig import RigSpec
from sinew.predict.band import estimate_of_deviations
from sinew.predict.bent import SLOW_HZ, Engine, response, spinal_engine
from sinew.predict.modes import Finder, ModesRequest, across_of, draw_spatial, out_of_plane
from sinew.predict.workspace import (
    PAYLOAD_HEIGHT,
    at_least_zero,
    carried_by_bounds,
    carried_mass,
    pulls_over_bend,
    tilt_stiffness,
    with_bounds,
)

_PRETENSION_MM = (6.0, 12.0)
_BEND_DEG = (0.0, 10.0, 20.0, 30.0)
_SWING_DEG = 10.0
_MOVES = 0.05
_FEELS = 0.1  # degrees of twist a degree of tilt, from which on it is said to be an engine
_NOTHING = 1e-9  # what rounding makes of a direction in which the head does not move

Progress = Callable[[float, float], None]


def answer_bent(
    rig: RigSpec,
    *,
    azimuth_deg: float = 0.0,
    draws: int = 12,
    seed: int = 0,
    progress: Progress = lambda _done, _total: None,
) -> list[Answer]:
    """Return the answers on resonance, coupling and spinal engine of a rig's bent joint.

    azimuth_deg: direction of the bend, from y towards z. draws: of what is assumed, for the intervals; at least 2.
    progress: called with (done, total) rigs.
    Raises SpecError for a rig that does not tell its masses.
    """
    request = ModesRequest(_PRETENSION_MM, _BEND_DEG, azimuth_deg, swing_deg=_SWING_DEG)
    nominal = Finder(rig, request)
    rigs, _, _ = draw_spatial(rig, draws, seed)
    shifts, couplings, engines = [], [], []
    for done, one in enumerate([rig, *rigs]):
        finder = nominal if done == 0 else Finder(one, request, nominal)
        shifts.append(_shifts(finder))
        couplings.append(_couplings(finder))
        engines.append(_engines(one, finder))
        progress(done + 1, len(rigs) + 1)
    aside = Finder(rig, request._replace(azimuth_deg=azimuth_deg + (90 if azimuth_deg < 90 else -90)))
    return [_resonance(nominal, shifts), _coupling(nominal, couplings), _engine(rig, nominal, aside, engines)]


_POSES = [(p, b) for p in _PRETENSION_MM for b in _BEND_DEG]


def _over(values: Sequence[Array], index: int) -> Estimate:
    """Return an entry of the first of some arrays, with the interval that the others give it."""
    off = np.array([one[index] - values[0][index] for one in values[1:]])
    found = estimate_of_deviations(float(values[0][index]), off[np.isfinite(off)])
    # A few draws may all lie on one side of the value.
    return Estimate(found.value, found.std, min(found.low, found.value), max(found.high, found.value))


# Does the resonance move?


def _shifts(finder: Finder) -> Array:
    """Return the torsion's frequency over that of the straight joint, less one, at each pose."""
    return np.array([finder.at(p, b).torsion_hz() / finder.at(p, 0.0).torsion_hz() - 1 for p, b in _POSES])


def _resonance(nominal: Finder, shifts: Sequence[Array]) -> Answer:
    found = {pose: _over(shifts, i) for i, pose in enumerate(_POSES)}
    pretension, bend = zip(*_POSES, strict=True)
    rows = rows_of(
        pretension_mm=pretension,
        bend_deg=bend,
        torsion_hz=[nominal.at(*pose).torsion_hz() for pose in _POSES],
        relative_shift=list(found.values()),
        slack_tendons=[float(np.count_nonzero(nominal.at(*pose).tension_n <= 0)) for pose in _POSES],
    )
    taut = {pose: one for pose, one in found.items() if nominal.at(*pose).taut and pose[1] > 0}
    location, most = max(taut.items(), key=lambda item: _furthest(item[1]))
    moves = _furthest(most) > _MOVES
    first = (
        f"Of the poses with all tendons taut, bending moves the torsion's resonance most at {location[0]:g} mm and "
        f"{location[1]:g}°: by {in_words(most, 100, '%')}, {'more' if moves else 'less'} than a twentieth."
    )
    test = (
        "To test it: plans/bent.toml sweeps the lever at one bend; sweep at several (bend_deg), and at none, at the "
        "same pretensions, and compare the resonances of each with their intervals."
    )
    verdict = "it moves" if moves else "it hardly moves"
    return Answer("bent-resonance", verdict, (first, test), {"relative_shift": most}, rows, ("relative_shift",))


def _furthest(one: Estimate) -> float:
    return max(abs(one.low), abs(one.high)) if math.isfinite(one.low) else abs(one.value)


# What else moves?


def _couplings(finder: Finder) -> Array:
    """Return at each pose (tilt across per torsion, its phase against the torsion [rad], tilt in the plane per torsion)
    where a lever that is driven makes the torsion largest, (3, pose)."""
    rows = []
    for p, b in _POSES:
        linear, space = finder.linear(p, b)
        pose = finder.at(p, b)
        mode = pose.of("torsion")
        assert mode is not None
        moved = response(linear, space, pose.coordinates, [mode.swung_hz], math.radians(_SWING_DEG))[0][:, 0]
        tilt = complex(out_of_plane(finder.direction, b) @ moved[1:3]) / moved[0]
        rows.append((abs(tilt), float(np.angle(tilt)), abs(finder.direction @ moved[1:3] / moved[0])))
    found = np.array(rows).T
    found[::2] = np.where(found[::2] > _NOTHING, found[::2], 0.0)
    return found


def _coupling(nominal: Finder, couplings: Sequence[Array]) -> Answer:
    name = "tilt_across_per_torsion"
    ratios = {pose: _over([one[0] for one in couplings], i) for i, pose in enumerate(_POSES)}
    pretension, bend = zip(*_POSES, strict=True)
    phases = dict(zip(_POSES, couplings[0][1], strict=True))
    rows = rows_of(
        pretension_mm=pretension,
        bend_deg=bend,
        tilt_across_per_torsion=list(ratios.values()),
        phase_deg=[math.degrees(phases[p, b]) if b > 0 else math.nan for p, b in _POSES],
        half_sine_of_bend=[0.5 * math.sin(math.radians(b)) for b in bend],
        tilt_in_plane_per_torsion=couplings[0][2].tolist(),
        gyro_factor=[1 - 0.5 * (1 - math.cos(math.radians(b))) for b in bend],
    )
    top = max(_PRETENSION_MM), max(b for p, b in _POSES if p == max(_PRETENSION_MM) and nominal.at(p, b).taut)
    phase, slowly = phases[top], 0.5 * math.sin(math.radians(top[1]))
    first = (
        f"At {top[0]:g} mm and {top[1]:g}° the head tilts across the plane of the bend by {in_words(ratios[top])} of "
        f"its torsion, {math.degrees(phase):.2g}° off its phase; a rod twisted slowly has ½ sin β = {slowly:.3g}."
    )
    test = (
        "To test it: plans/bent.toml; the table coupling of sinew analyse has tilt across over torsion with its "
        "interval at each frequency, and its lag."
    )
    verdict = "the head tilts across the bend"
    return Answer("bent-coupling", verdict, (first, test), {name: ratios[top]}, rows, (name,))


# Is there a spinal engine?


def _best(finder: Finder, rig: RigSpec, p: float, b: float, *, locked: bool = False) -> Engine:
    """Return the engine at the frequency where it twists most."""
    hz = finder.at(p, b).torsion_hz()
    found = minimize_scalar(
        lambda f: -spinal_engine(finder, rig, p, b, float(f), locked=locked).torsion,
        bounds=(0.85 * hz, 1.05 * hz),
        method="bounded",
        options={"xatol": 1e-3 * hz},
    )
    return spinal_engine(finder, rig, p, b, float(found.x), locked=locked)


_ENGINE_BENDS = _BEND_DEG[1:]


def _engines(rig: RigSpec, finder: Finder) -> Array:
    """Return at each bend, at the largest pretension: (twist [deg], its frequency [Hz], twist per tilt there, twist per
    tilt when slow), (4, bend)."""
    rows = []
    p = max(_PRETENSION_MM)
    for b in _ENGINE_BENDS:
        best, slow = _best(finder, rig, p, b), spinal_engine(finder, rig, p, b, SLOW_HZ)
        rows.append((math.degrees(best.torsion), best.frequency_hz, best.per_tilt, slow.per_tilt))
    return np.array(rows).T


def _engine(rig: RigSpec, nominal: Finder, aside: Finder, engines: Sequence[Array]) -> Answer:
    p = max(_PRETENSION_MM)
    bests = [_best(nominal, rig, p, b) for b in _ENGINE_BENDS]
    columns = [[_over([one[k] for one in engines], i) for i in range(len(_ENGINE_BENDS))] for k in range(4)]
    rows = rows_of(
        pretension_mm=[p] * len(_ENGINE_BENDS),
        bend_deg=_ENGINE_BENDS,
        **dict(zip(("twist_deg", "frequency_hz", "twist_per_tilt", "twist_per_tilt_slow"), columns, strict=True)),
        take_up_mm=[1e3 * best.take_up for best in bests],
        tilt_deg=[math.degrees(best.tilt) for best in bests],
        lag_deg=[math.degrees(best.lag) for best in bests],
        lever_deg=[math.degrees(best.give) for best in bests],
        locked_twist_deg=[math.degrees(_best(nominal, rig, p, b, locked=True).torsion) for b in _ENGINE_BENDS],
    )
    twist, hz, per, slow = (column[-1] for column in columns)
    other = _best(aside, rig, p, _ENGINE_BENDS[-1])
    verdict = "at the torsion's resonance, not below it" if per.value > _FEELS else "hardly"
    twists = math.degrees(other.torsion), twist.value
    if max(twists) > 2 * min(twists):
        verdict += "; how much hangs on how the lever lies"
    first = (
        f"Tendons that drive a head sideways, bent by {_ENGINE_BENDS[-1]:g}° at {p:g} mm, twist it by "
        f"{in_words(twist)} degrees at {in_words(hz, 1, 'Hz')}, as far as their motors' speed lets them, "
        f"{in_words(per)} degrees a degree of tilt; slowly, at {SLOW_HZ:g} Hz, by {in_words(slow)} a degree."
    )
    drive = "pitch" if abs(across_of(nominal.direction)[0]) > 0.7 else "roll"
    test = (
        "To test it: plans/engine.toml drives the tendons across a bend towards 90° through the torsion's resonance, "
        f'the lever held; towards {nominal.request.azimuth_deg:g}° that is drive = "{drive}".'
    )
    numbers = {"twist_deg": twist, "twist_per_tilt": per, "twist_per_tilt_slow": slow}
    return Answer("spinal-engine", verdict, (first, test), numbers, rows, tuple(numbers))


# ---- are the tendons stressed unequally where the joint bends, and what does it carry? Asked of a rig, not a recording


PRETENSIONS_MM = (0.0, 6.0, 12.0)
CARRIED_DEG = 20.0
_CARRYING = (
    "tilt_stiffness_n_m_rad",
    "tilt_stiffness_by_current_n_m_rad",
    "slack_moment_n_m",
    "tension_moment_n_m",
    "upright_kg",
    "bent_kg",
)


def answer_asymmetry(rig: RigSpec, pretension_mm: Sequence[float] = PRETENSIONS_MM, azimuth_deg: float = 0.0) -> Answer:
    """Return how unequal the tendons' tensions get over the bend (paper 5.2.1), the joint held by position.

    azimuth_deg: direction of the bend, from y towards z. Rows: for each pretension and bend the tension of the tendon
    that pulls most and of the one that pulls least; a slack one has none.
    """
    poses = [(mm, bend) for mm in pretension_mm for bend in _BEND_DEG]

    def ends(one: RigSpec) -> Array:
        pull = np.concatenate([pulls_over_bend(one, mm, _BEND_DEG, azimuth_deg) for mm in pretension_mm])
        return np.concatenate([pull.max(axis=1), pull.min(axis=1)])

    found = [at_least_zero(one) for one in with_bounds(rig, ends)]
    highest, lowest = found[: len(poses)], found[len(poses) :]
    pretension, bends = zip(*poses, strict=True)
    rows = rows_of(pretension_mm=pretension, bend_deg=bends, highest_n=highest, lowest_n=lowest)
    high, low = highest[-1], lowest[-1]
    at = f"{bends[-1]:g}° and {pretension[-1]:g} mm"
    first = (
        f"At {at} the tendon on the inside pulls {in_words(high, unit='N')} and the one on the outside "
        f"{in_words(low, unit='N')}."
    )
    test = (
        "To test it: run plans/bent.toml and read tendon_current_a at rest, before the lever moves. An ampere is "
        f"{number(float(rig.tendons.tension(1.0)), 3)} N at the pulley by the rig's motor, less what gears hold back."
    )
    numbers = {"highest_n": high, "lowest_n": low}
    verdict = f"{number(high.value, 3)} against {number(low.value, 3)} N at {at}"
    return Answer("asymmetry", verdict, (first, test), numbers, rows, tuple(numbers))


def answer_carrying(rig: RigSpec, pretension_mm: Sequence[float] = PRETENSIONS_MM, azimuth_deg: float = 0.0) -> Answer:
    """Return what the joint carries in pitch and roll (paper 5.1, weight compensation), held by position.

    azimuth_deg: direction of the bend in which it carries a mass. Rows: for each pretension the stiffness against a
    moment on the head by position and by current, the moment at which the first tendon goes slack and at which one
    reaches the rig's limit, and the largest mass 100 mm above the plate, upright and bent.
    """
    by: list[list[Estimate]] = []
    for mm in pretension_mm:
        stiff = with_bounds(rig, lambda one, mm=mm: np.array(tilt_stiffness(one, mm)))  # type: ignore[misc]
        moments = map(at_least_zero, stiff[2:])  # a moment that needs none is none
        loads = [carried_mass(rig, float(mm), bend, azimuth_deg) for bend in (0.0, CARRIED_DEG)]
        carried = [
            carried_by_bounds(rig, load, float(mm), bend, azimuth_deg)
            for load, bend in zip(loads, (0.0, CARRIED_DEG), strict=True)
        ]
        by.append([*stiff[:2], *moments, *carried])
    ends, last = loads[-1].ends, pretension_mm[-1]
    rows = rows_of(
        pretension_mm=[float(mm) for mm in pretension_mm], **dict(zip(_CARRYING, zip(*by, strict=True), strict=True))
    )
    stiffness, _, moment, _, _, bent = by[-1]
    first = (
        f"At {last:g} mm the upright head takes a moment of {in_words(moment, unit='N m')} about "
        f"pitch or roll before a tendon goes slack; bent by {CARRIED_DEG:g}° it carries {in_words(bent, unit='kg')} "
        f"{1e3 * PAYLOAD_HEIGHT:g} mm above the plate, until {ends}."
    )
    test = (
        "To test it: hold the pose of plans/bent.toml, hang a known mass on the head at a known height and read tilt "
        "and motor currents: the tilt gives the stiffness, a current that falls to nothing the load at which a tendon "
        "is slack."
    )
    numbers = {"slack_moment_n_m": moment, "bent_kg": bent, "tilt_stiffness_n_m_rad": stiffness}
    verdict = (
        f"{number(moment.value, 3)} N m upright, {number(bent.value, 3)} kg bent by {CARRIED_DEG:g}°, at {last:g} mm"
    )
    return Answer("carrying", verdict, (first, test), numbers, rows, tuple(numbers))
