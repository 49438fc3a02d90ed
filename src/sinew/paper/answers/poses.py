"""Are the tendons stressed unequally where the joint bends, and what does it carry? Asked of a rig, not a recording."""

import math
from collections.abc import Sequence

import numpy as np

from sinew.measure.arrays import Array
from sinew.measure.estimate import Estimate, number
from sinew.paper.answers.answer import Answer, Cell, in_words
from sinew.plan.rig import RigSpec, Spatial
from sinew.predict.poses.load import (
    PAYLOAD_HEIGHT,
    at_least_zero,
    carried_by_bounds,
    carried_mass,
    pulls_over_bend,
    tilt_stiffness,
    with_bounds,
)

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
