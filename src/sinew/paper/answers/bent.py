"""What the paper did not investigate of a bent joint: pulls, load, resonance, what moves with the torsion, engine.

Predicted for a rig from `sinew.predict.modes` and `sinew.predict.bent`: there is no recording of a bent joint. The
intervals are of what is assumed of head and lever, drawn as there; numbers of the bench in the answers' last sentences.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import minimize_scalar

from sinew.measure.arrays import Array
from sinew.measure.estimate import Estimate, number
from sinew.paper.answers.answer import Answer, Cell, in_words
from sinew.plan.rig import RigSpec, Spatial
from sinew.predict.band import estimate_of_deviations
from sinew.predict.bent import SLOW_HZ, Engine, response, servo_speed, spinal_engine
from sinew.predict.modes import Asked, Finder, across_of, draw_spatial, out_of_plane
from sinew.predict.workspace import (
    PAYLOAD_HEIGHT,
    at_least_zero,
    carried_by_bounds,
    carried_mass,
    pulls_over_bend,
    tilt_stiffness,
    with_bounds,
)

RESONANCE = "bent-resonance"
COUPLING = "bent-coupling"
ENGINE = "spinal-engine"

_PRETENSION_MM = (6.0, 12.0)
_BEND_DEG = (0.0, 10.0, 20.0, 30.0)
_SWING_DEG = 10.0
_CURVED_DEG = 30.0
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
    asked = Asked(_PRETENSION_MM, _BEND_DEG, azimuth_deg, swing_deg=_SWING_DEG)
    nominal = Finder(rig, asked)
    rigs, names, _ = draw_spatial(rig, draws, seed)
    drawn = [(one, Finder(one, asked, nominal)) for one in rigs]
    shifts = [_shifts(nominal)]
    couplings = [_couplings(nominal)]
    engines = [_engines(rig, nominal)]
    progress(1, len(drawn) + 1)
    for done, (one, finder) in enumerate(drawn):
        shifts.append(_shifts(finder))
        couplings.append(_couplings(finder))
        engines.append(_engines(one, finder))
        progress(done + 2, len(drawn) + 1)
    recast = _recast(rig, azimuth_deg)
    aside = Finder(rig, asked._replace(azimuth_deg=azimuth_deg + (90 if azimuth_deg < 90 else -90)))
    return [
        _resonance(nominal, shifts, names),
        _coupling(nominal, aside, couplings, names),
        _engine(rig, nominal, aside, engines, recast, names),
    ]


def _recast(rig: RigSpec, azimuth_deg: float) -> RigSpec:
    """Return a straight joint's rig cast curved towards the azimuth, and a curved one's cast straight."""
    assert rig.space is not None
    straight = rig.space.rest_bend_deg == 0
    update = {"rest_bend_deg": _CURVED_DEG if straight else 0.0, "rest_azimuth_deg": azimuth_deg}
    return rig.model_copy(update={"space": rig.space.model_copy(update=update)})


def _poses() -> list[tuple[float, float]]:
    return [(p, b) for p in _PRETENSION_MM for b in _BEND_DEG]


def _over(values: Sequence[Array], index: int) -> Estimate:
    """Return an entry of the first of some arrays, with the interval that the others give it."""
    off = np.array([one[index] - values[0][index] for one in values[1:]])
    found = estimate_of_deviations(float(values[0][index]), off[np.isfinite(off)])
    # A few draws may all lie on one side of the value.
    return Estimate(found.value, found.std, min(found.low, found.value), max(found.high, found.value))


# Does the resonance move?


def _shifts(finder: Finder) -> Array:
    """Return the torsion's frequency over that of the straight joint, less one, at each pose."""
    return np.array([finder.at(p, b).torsion_hz() / finder.at(p, 0.0).torsion_hz() - 1 for p, b in _poses()])


def _resonance(nominal: Finder, shifts: Sequence[Array], names: Sequence[str]) -> Answer:
    found = {pose: _over(shifts, i) for i, pose in enumerate(_poses())}
    rows: list[dict[str, Cell]] = [
        {
            "pretension_mm": p,
            "bend_deg": b,
            "torsion_hz": nominal.at(p, b).torsion_hz(),
            "relative_shift": found[p, b],
            "slack_tendons": float(np.count_nonzero(nominal.at(p, b).tension_n <= 0)),
        }
        for p, b in _poses()
    ]
    taut = {pose: one for pose, one in found.items() if nominal.at(*pose).taut and pose[1] > 0}
    place, most = max(taut.items(), key=lambda item: _furthest(item[1]))
    moves = _furthest(most) > _MOVES
    first = (
        f"Of the poses with all tendons taut, bending moves the torsion's resonance most at {place[0]:g} mm and "
        f"{place[1]:g}°: by {in_words(most, 100, '%')}, {'more' if moves else 'less'} than a twentieth."
    )
    slack = [pose for pose in found if not nominal.at(*pose).taut]
    sentences = [first]
    if slack:
        p, b = max(slack, key=lambda pose: abs(found[pose].value))
        sentences.append(
            f"Where a tendon goes slack it is another joint: {in_words(found[p, b], 100, '%')} at {p:g} mm and {b:g}°, "
            "and at lower pretension torsion and sway mix into two peaks."
        )
    sentences += [
        "Small swings; guides hold, silicone at the mode's own frequency. Large swings soften the guides and stiffen "
        "the tendons as in the straight joint.",
        _rests(names),
        "To test it: plans/bent.toml sweeps the lever at one bend; sweep at several (bend_deg), and at none, at the "
        "same pretensions, and compare the resonances of each with their intervals.",
    ]
    return Answer(
        RESONANCE,
        "Does the resonance move when the joint bends? (sections 5.2.2 and 5.3)",
        "it moves" if moves else "it hardly moves",
        tuple(sentences),
        {"relative_shift": most},
        tuple(rows),
    )


def _furthest(one: Estimate) -> float:
    return max(abs(one.low), abs(one.high)) if math.isfinite(one.low) else abs(one.value)


# What else moves?


def _couplings(finder: Finder) -> Array:
    """Return at each pose (tilt across per torsion, its phase against the torsion [rad], tilt in the plane per torsion)
    where a lever that is driven makes the torsion largest, (3, pose)."""
    rows = []
    for p, b in _poses():
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


def _coupling(nominal: Finder, aside: Finder, couplings: Sequence[Array], names: Sequence[str]) -> Answer:
    rows: list[dict[str, Cell]] = []
    ratios = {}
    for i, (p, b) in enumerate(_poses()):
        ratios[p, b] = _over([one[0] for one in couplings], i)
        rows.append(
            {
                "pretension_mm": p,
                "bend_deg": b,
                "tilt_across_per_torsion": ratios[p, b],
                "phase_deg": math.degrees(couplings[0][1][i]) if b > 0 else math.nan,
                "half_sine_of_bend": 0.5 * math.sin(math.radians(b)),
                "tilt_in_plane_per_torsion": float(couplings[0][2][i]),
                "gyro_factor": 1 - 0.5 * (1 - math.cos(math.radians(b))),
            }
        )
    top = max(_PRETENSION_MM), max(b for p, b in _poses() if p == max(_PRETENSION_MM) and nominal.at(p, b).taut)
    at = _poses().index(top)
    mode = aside.at(*top).of("torsion")
    other = math.nan if mode is None else mode.tilt_across_per_torsion
    quasi, less = 0.5 * math.sin(math.radians(top[1])), 50 * (1 - math.cos(math.radians(top[1])))
    return Answer(
        COUPLING,
        "What else moves with the torsion of a bent joint? (sections 5.2.2 and 5.3)",
        "the head tilts across the bend",
        (
            f"At {top[0]:g} mm and {top[1]:g}° the head tilts across the plane of the bend by "
            f"{in_words(ratios[top])} of its torsion, {math.degrees(couplings[0][1][at]):.2g}° off its phase; a rod "
            f"that is twisted slowly has ½ sin β = {quasi:.3g}.",
            f"The difference is inertia, and hangs on how the lever lies: bent towards {aside.asked.azimuth_deg:g}° "
            f"from y, along which its arms are, instead of {nominal.asked.azimuth_deg:g}°, it is {other:.3g}.",
            "In the plane of the bend nothing moves to first order; to second order the head nods at twice the "
            "frequency, which is not in these numbers, and more where that sway is at 2:1 (sinew modes tells where).",
            f"A gyroscope on the head under-reads the torsion's rate by {less:.2g} % there, for its axis leans.",
            _rests(names),
            "To test it: plans/bent.toml; the table coupling of sinew analyse has tilt across over torsion with its "
            "interval at each frequency, and its lag.",
        ),
        {"tilt_across_per_torsion": ratios[top]},
        tuple(rows),
    )


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


def _engine(
    rig: RigSpec, nominal: Finder, aside: Finder, engines: Sequence[Array], recast: RigSpec, names: Sequence[str]
) -> Answer:
    p = max(_PRETENSION_MM)
    rows: list[dict[str, Cell]] = []
    bent = _engines(recast, Finder(recast, nominal.asked))
    assert recast.space is not None
    for i, b in enumerate(_ENGINE_BENDS):
        best, locked = _best(nominal, rig, p, b), _best(nominal, rig, p, b, locked=True)
        found = [_over([one[k] for one in engines], i) for k in range(4)]
        rows.append(
            {
                "pretension_mm": p,
                "bend_deg": b,
                "twist_deg": found[0],
                "frequency_hz": found[1],
                "twist_per_tilt": found[2],
                "twist_per_tilt_slow": found[3],
                "take_up_mm": 1e3 * best.take_up,
                "tilt_deg": math.degrees(best.tilt),
                "lag_deg": math.degrees(best.lag),
                "lever_deg": math.degrees(best.give),
                "locked_twist_deg": math.degrees(locked.torsion),
                "recast_twist_deg": float(bent[0][i]),
                "recast_frequency_hz": float(bent[1][i]),
                "recast_twist_per_tilt": float(bent[2][i]),
                "recast_twist_per_tilt_slow": float(bent[3][i]),
            }
        )
    last = rows[-1]
    other = _best(aside, rig, p, _ENGINE_BENDS[-1])
    twist, hz, per, slow = (_over([one[k] for one in engines], len(_ENGINE_BENDS) - 1) for k in range(4))
    speed = servo_speed(rig, float(nominal.at(p, _ENGINE_BENDS[-1]).tension_n.mean()))
    there = "at the torsion's resonance, not below it" if per.value > _FEELS else "hardly"
    twists = math.degrees(other.torsion), twist.value
    if max(twists) > 2 * min(twists):
        there += "; how much hangs on how the lever lies"
    drive = "pitch" if abs(across_of(nominal.direction)[0]) > 0.7 else "roll"
    return Answer(
        ENGINE,
        "Is there a spinal engine, and how much twist does it give? (section 5.1)",
        there,
        (
            f"Tendons that drive a head sideways, bent by {_ENGINE_BENDS[-1]:g}° at {p:g} mm, twist it by "
            f"{in_words(twist)} degrees at {in_words(hz, 1, 'Hz')}, as far as their motors' speed lets them.",
            f"Slowly, at {SLOW_HZ:g} Hz, a tilt of one degree across twists it by {in_words(slow)} degrees only: the "
            f"rod's geometry gives nothing. At resonance it twists by {in_words(per)} degrees a degree: the head turns "
            "with the tilt about an axis that leans, its inertia twists the rod, and the torsion amplifies that by its "
            "1/(2D).",
            f"The lever's motor holds it and gives way by {last['lever_deg']:.2g}° there, which takes energy; a gear "
            f"that sticks would leave {last['locked_twist_deg']:.2g}° of twist. Which of the two a gear does that "
            "moves so slowly nobody has measured.",
            f"The motors take up {1e3 * speed:.3g} mm/s under the tendons' tension, by the torque line at 12 V; "
            f"that is {last['take_up_mm']:.2g} mm at the resonance. The guides' friction is in it at that twist; the "
            "losses of tendons that run through guides while the head tilts are not known and not in it.",
            f"How the lever lies decides: bent towards {aside.asked.azimuth_deg:g}° from y, along which its arms are, "
            f"instead of {nominal.asked.azimuth_deg:g}°, it is {math.degrees(other.torsion):.2g}° at "
            f"{other.frequency_hz:.4g} Hz, {other.per_tilt:.2g} degrees a degree.",
            f"The same joint cast {_cast_words(recast.space.rest_bend_deg)} and held at {_ENGINE_BENDS[-1]:g}° gives "
            f"{last['recast_twist_deg']:.2g}° at {last['recast_frequency_hz']:.4g} Hz, and slowly "
            f"{last['recast_twist_per_tilt_slow']:.2g}° a degree: a curve at rest couples side bend and yaw more when "
            "slow, but still by far less than inertia does.",
            _rests(names),
            "To test it: plans/engine.toml drives the tendons across a bend towards 90° through the torsion's "
            f'resonance, the lever held; towards {nominal.asked.azimuth_deg:g}° that is drive = "{drive}".',
        ),
        {"twist_deg": twist, "twist_per_tilt": per, "twist_per_tilt_slow": slow},
        tuple(rows),
    )


def _cast_words(rest_bend_deg: float) -> str:
    return f"with a bend of {rest_bend_deg:g}°" if rest_bend_deg else "straight"


def _rests(names: Sequence[str]) -> str:
    """Return what the intervals rest on. names: of the parameters that were drawn."""
    return (
        f"The intervals are of what was drawn between bounds or as calibrated: {', '.join(names)}; all else is held at "
        "the rig's values."
    )


# ---- are the tendons stressed unequally where the joint bends, and what does it carry? Asked of a rig, not a recording


PRETENSIONS_MM = (0.0, 6.0, 12.0)
BENDS_DEG = (0.0, 10.0, 20.0, 30.0)
CARRIED_DEG = 20.0
ASYMMETRY = "asymmetry"
CARRYING = "carrying"

_ASSUMED = (
    "Intervals hold what the bounds of the assumed masses of head, lever and silicone make of the numbers, each by "
    "itself and along a straight line; the paper gives none of them. What is calibrated is not in them, the tension "
    "above all: the paper leaves that of a tendon at 12 mm between 63 and 112 N."
)


def answer_asymmetry(rig: RigSpec, pretension_mm: Sequence[float] = PRETENSIONS_MM, azimuth_deg: float = 0.0) -> Answer:
    """Return how unequal the tendons' tensions get over the bend (paper 5.2.1), the joint held by position.

    azimuth_deg: direction of the bend, from y towards z. Rows: for each pretension and bend the tension of the tendon
    that pulls most and of the one that pulls least; a slack one has none.
    """
    rows: list[dict[str, Cell]] = []
    for mm in pretension_mm:

        def ends(one: RigSpec, mm: float = mm) -> Array:
            pull = pulls_over_bend(one, mm, BENDS_DEG, azimuth_deg)
            return np.concatenate([pull.max(axis=1), pull.min(axis=1)])

        found = [at_least_zero(one) for one in with_bounds(rig, ends)]
        half = len(BENDS_DEG)
        for i, bend in enumerate(BENDS_DEG):
            pulls = {"highest_n": found[i], "lowest_n": found[half + i]}
            rows.append({"pretension_mm": mm, "bend_deg": bend, **pulls})
    last = [row for row in rows if row["pretension_mm"] == pretension_mm[-1]][-1]
    high, low = last["highest_n"], last["lowest_n"]
    assert isinstance(high, Estimate)
    assert isinstance(low, Estimate)
    slack = [
        f"{row['pretension_mm']:g} mm from {row['bend_deg']:g}°"
        for row, before in zip(rows, [None, *rows], strict=False)
        if _is_slack(row)
        and (before is None or before["pretension_mm"] != row["pretension_mm"] or not _is_slack(before))
    ]
    first = (
        f"Bent by {last['bend_deg']:g}° at {last['pretension_mm']:g} mm the tendon on the inside pulls "
        f"{in_words(high, unit='N')} and the one on the outside {in_words(low, unit='N')}."
    )
    slackly = (
        f"A tendon is slack at {', '.join(slack)} on (of the bends that were asked)." if slack else "None is slack."
    )
    other = rig.model_copy(update={"space": _other_routing(rig)})
    routed = np.maximum(pulls_over_bend(other, float(pretension_mm[-1]), BENDS_DEG[-1:], azimuth_deg)[0], 0.0)
    assert other.space is not None
    by_routing = (
        f"It rests on the routing, {rig.space.routing if rig.space else ''}: by {other.space.routing} they would pull "
        f"{number(float(routed.max()))} and {number(float(routed.min()))} N. Motor currents of a bent pose tell which."
    )
    return Answer(
        ASYMMETRY,
        "How unequal do the tendons' tensions get where the joint bends? (section 5.2.1)",
        f"{number(high.value, 3)} against {number(low.value, 3)} N at {last['bend_deg']:g}° and "
        f"{last['pretension_mm']:g} mm",
        (first, slackly, by_routing, _ASSUMED, _test_of_tensions(rig)),
        {"highest_n": high, "lowest_n": low},
        tuple(rows),
    )


def _test_of_tensions(rig: RigSpec) -> str:
    per_ampere = float(rig.tendons.tension(1.0))
    return (
        "To test it: run plans/bent.toml and read tendon_current_a at rest, before the lever moves. An ampere is "
        f"{number(per_ampere, 3)} N at the pulley by the rig's motor, less what gears hold back; a load cell in one "
        "tendon tells how much."
    )


def _is_slack(row: dict[str, Cell]) -> bool:
    low = row["lowest_n"]
    return isinstance(low, Estimate) and not low.value > 0


def _other_routing(rig: RigSpec) -> Spatial:
    assert rig.space is not None
    return rig.space.model_copy(update={"routing": "chord" if rig.space.routing == "channel" else "channel"})


def answer_carrying(rig: RigSpec, pretension_mm: Sequence[float] = PRETENSIONS_MM, azimuth_deg: float = 0.0) -> Answer:
    """Return what the joint carries in pitch and roll (paper 5.1, weight compensation), held by position.

    azimuth_deg: direction of the bend in which it carries a mass. Rows: for each pretension the stiffness against a
    moment on the head by position and by current, the moment at which the first tendon goes slack and at which one
    reaches the rig's limit, and the largest mass 100 mm above the plate, upright and bent.
    """
    rows: list[dict[str, Cell]] = []
    ends = []
    for mm in pretension_mm:
        by = with_bounds(rig, lambda one, mm=mm: np.array(tilt_stiffness(one, mm)))  # type: ignore[misc]
        by[2:] = map(at_least_zero, by[2:])  # a moment that needs none is none
        row: dict[str, Cell] = {"pretension_mm": float(mm)}
        names = (
            "tilt_stiffness_n_m_rad",
            "tilt_stiffness_by_current_n_m_rad",
            "slack_moment_n_m",
            "tension_moment_n_m",
        )
        row |= dict(zip(names, by, strict=True))
        for name, bend in (("upright_kg", 0.0), ("bent_kg", CARRIED_DEG)):
            carried = carried_mass(rig, float(mm), bend, azimuth_deg)
            row[name] = carried_by_bounds(rig, carried, float(mm), bend, azimuth_deg)
        ends.append(carried.ends)
        rows.append(row)
    last = rows[-1]
    bent, moment = last["bent_kg"], last["slack_moment_n_m"]
    held, free = last["tilt_stiffness_n_m_rad"], last["tilt_stiffness_by_current_n_m_rad"]
    assert isinstance(bent, Estimate)
    assert isinstance(moment, Estimate)
    assert isinstance(held, Estimate)
    assert isinstance(free, Estimate)
    height = f"{1e3 * PAYLOAD_HEIGHT:g} mm above the plate"
    first = (
        f"At {last['pretension_mm']:g} mm the upright head takes a moment of {in_words(moment, unit='N m')} about "
        f"pitch or roll before a tendon goes slack; bent by {CARRIED_DEG:g}° it carries "
        f"{in_words(bent, unit='kg')} {height}, until {ends[-1]}."
    )
    second = (
        f"Motors that hold positions give it {in_words(held, unit='N m/rad')} in tilt, ones that hold currents "
        f"{in_words(free, unit='N m/rad')}, what is left of the silicone's own less what the tendons press."
    )
    none = [f"{row['pretension_mm']:g}" for row in rows if _nothing(row["bent_kg"])]
    third = f"At {', '.join(none)} mm a tendon is slack in that pose without any load." if none else ""
    return Answer(
        CARRYING,
        "What does the joint carry in pitch and roll? (section 5.1)",
        f"{number(moment.value, 3)} N m upright, {number(bent.value, 3)} kg bent by {CARRIED_DEG:g}°, at "
        f"{last['pretension_mm']:g} mm",
        tuple(sentence for sentence in (first, second, third, _ASSUMED, _TEST_OF_LOAD) if sentence),
        {"slack_moment_n_m": moment, "bent_kg": bent, "tilt_stiffness_n_m_rad": held},
        tuple(rows),
    )


_TEST_OF_LOAD = (
    "To test it: hold the pose of plans/bent.toml, hang a known mass on the head at a known height and read tilt and "
    "motor currents: the tilt gives the stiffness, a current that falls to nothing the load at which a tendon is slack."
)


def _nothing(cell: Cell) -> bool:
    return isinstance(cell, Estimate) and not (math.isfinite(cell.value) and cell.value > 0)
