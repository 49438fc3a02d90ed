"""What a plan with a bent or swaying head is expected to show, by the linear joint.

Small motion about the rest pose: the guides slip in the torsion that comes of it, but tendons do not stiffen in a large
swing, nothing happens at twice the frequency, the drive reaches what it reaches against a held head, and a tendon that
goes slack in the swing is told and not followed. Held against the twin it is a guide, no verdict.
"""

import math
from typing import NamedTuple

import numpy as np

from sinew.measure.arrays import Array
from sinew.measure.errors import SpecError
from sinew.plan.check import Preview
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.predict.bent import INPUTS, driven
from sinew.predict.modes import Asked, Finder, out_of_plane
from sinew.solve.spatial import patterns

_INPUT_OF = {"lever": "lever_rad", "pitch": "pitch_take_up_m", "roll": "roll_take_up_m"}
_NOTHING = 1e-9  # of the motion: what rounding makes of a direction in which the head does not move


class Foretold(NamedTuple):
    """What the sweep should give at a pretension [mm] and a frequency [Hz].

    drive: amplitude of the drive's motion, the lever's against a held head [deg] or of the tendons [mm].
    torsion_deg, across_deg, in_plane_deg: amplitudes of the torsion and of the tilt across the bend and in its plane.
    highest_n, lowest_n: tension of a tendon over the swing; what torsion adds to it grows with its square and is not
    in it.
    """

    pretension_mm: float
    frequency_hz: float
    drive: float
    torsion_deg: float
    across_deg: float
    in_plane_deg: float
    highest_n: float
    lowest_n: float


def foretell(plan: Plan, rig: RigSpec, preview: Preview) -> tuple[Foretold, ...]:
    """Return what the sweep of a plan is expected to show, a row for each pretension and frequency.

    preview: its check, of whose drive the amplitudes are. Nothing of a plan without a sweep, and nothing at a
    pretension without a stable pose.
    """
    if plan.sweep is None:
        return ()
    bend_deg, azimuth_deg = plan.rest_pose.bend_and_azimuth_deg
    finder = Finder(rig, Asked(plan.pretension.pretension_mm, (bend_deg,), azimuth_deg, plan.pretension.mode))
    if plan.sweep.amplitude_mm is None:
        amplitudes = np.radians(preview.drive_amplitude_deg)
    else:
        amplitudes = np.full(len(plan.sweep.frequency_hz), 1e-3 * plan.sweep.amplitude_mm)
    rows = []
    for mm in plan.pretension.pretension_mm:
        try:
            finder.linear(mm, bend_deg)
        except SpecError:  # the check says that there is no pose
            continue
        rows += [
            _at(finder, mm, bend_deg, hz, plan.sweep.drive, float(amplitude))
            for hz, amplitude in zip(plan.sweep.frequency_hz, amplitudes, strict=True)
        ]
    return tuple(rows)


def _at(finder: Finder, mm: float, bend_deg: float, hz: float, drive: str, amplitude: float) -> Foretold:
    """Return the row of one frequency; amplitude: of the drive [rad] or [m]."""
    linear, space = finder.linear(mm, bend_deg)
    at, q = linear.around, finder.rest(mm, bend_deg)[1].q
    stiffness = float(space.rod.joint.stiffness)
    pulled = np.zeros(len(at.tension))
    if drive != "lever":
        pulled = stiffness * patterns(space)[1 if drive == "pitch" else 2]
    rows = np.vstack([at.by_torsion, at.by_tilt, stiffness * at.by_span])
    inputs = amplitude * np.eye(len(INPUTS))[INPUTS.index(_INPUT_OF[drive])]
    moved = driven(linear, space, q, hz, inputs, rows)
    swing: Array = np.abs(moved[3:] + amplitude * pulled)
    out = math.degrees(abs(out_of_plane(finder.direction, bend_deg) @ moved[1:3]))
    within = math.degrees(abs(finder.direction @ moved[1:3]))
    least = _NOTHING * math.degrees(float(np.max(np.abs(moved[:3]))))
    return Foretold(
        mm,
        hz,
        math.degrees(amplitude) if drive == "lever" else 1e3 * amplitude,
        math.degrees(abs(moved[0])),
        out if out > least else 0.0,
        within if within > least else 0.0,
        float(np.max(at.tension + swing)),
        float(np.min(np.where(at.tension > 0, at.tension - swing, 0.0))),
    )


def sentences_of(rows: tuple[Foretold, ...], plan: Plan) -> list[str]:
    """Return for each pretension what is expected where the head twists most; of a drive by tendons their tensions."""
    told = []
    by_tendons = plan.sweep is not None and plan.sweep.amplitude_mm is not None
    for mm in dict.fromkeys(row.pretension_mm for row in rows):
        mine = [row for row in rows if row.pretension_mm == mm]
        top = max(mine, key=lambda row: row.torsion_deg)
        least = min(mine, key=lambda row: row.lowest_n)
        slack = f"; a tendon goes slack in the swing at {least.frequency_hz:g} Hz" if least.lowest_n <= 0 else ""
        pulls = f"; tensions {max(least.lowest_n, 0):.0f} to {max(row.highest_n for row in mine):.0f} N{slack}"
        if not by_tendons:
            pulls = f": {top.torsion_deg / top.drive:.2g}° a degree of the lever, if it reaches {top.drive:.2g}° there"
        told.append(
            f"expected at {mm:g} mm: at most {top.torsion_deg:.2g}° of torsion, at {top.frequency_hz:g} Hz, and there "
            f"a tilt of {top.across_deg:.2g}° across the bend, {top.in_plane_deg:.2g}° in its plane{pulls}"
        )
    linear = (
        "what is expected is linear: right for small swings, too much for large ones; a lever reaches less where the "
        "joint resonates"
    )
    return [*told, linear] if told else []
