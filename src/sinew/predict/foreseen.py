"""What a plan will bring about on a rig, as it was foreseen before: a run starts without the twin where it was asked.

The dashboard tries a plan before it may start, and `sinew run` tries it again before anything moves: the same numbers
of the same texts. They are kept (`sinew.measure.kept`); the limits are looked at each time.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from sinew.measure.estimate import finite
from sinew.measure.kept import keep, key_of, recall
from sinew.plan.check import Preview, check_plan
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_plan, dump_rig

_KIND = "foreseen"


class Foretold(NamedTuple):
    """What the sweep should give at a pretension [mm] and a frequency [Hz].

    drive: amplitude of the drive's motion, the lever's against the swinging head [deg] or of the tendons [mm].
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


def foresee_plan(plan: Plan, rig: RigSpec) -> tuple[Preview, str]:
    """Return what `sinew.predict.preview.foresee_plan` does, from the disk where it was asked before."""
    kept = recall(_KIND, _key(plan, rig))
    if kept is None:
        from sinew.predict import preview  # takes some seconds to load

        return preview.foresee_plan(plan, rig)
    return check_plan(plan, rig, kept["tension_n"], kept["torsion_deg"]), str(kept["expected"])


def keep_foreseen(
    plan: Plan, rig: RigSpec, tension_n: Sequence[float], torsion_deg: Sequence[float], expected: str
) -> None:
    """Keep what was foreseen. Arguments as of `check_plan`; expected: of the recording."""
    found: dict[str, Any] = {"tension_n": list(tension_n), "torsion_deg": list(torsion_deg), "expected": expected}
    keep(_KIND, _key(plan, rig), found)


def _key(plan: Plan, rig: RigSpec) -> str:
    return key_of(dump_plan(plan), dump_rig(rig))  # with its intervals, which a model's JSON leaves out


def told_preview(plan: Plan, rig: RigSpec, preview: Preview, expected: tuple[Foretold, ...] = ()) -> dict[str, Any]:
    """Return the preview of a plan on a rig as JSON holds it. expected: of `expected_of`."""
    drive = zip(preview.frequency_hz, preview.drive_amplitude_deg, preview.drive_current_a, strict=True)
    tension = zip(plan.pretension.pretension_mm, preview.tension_n, strict=False)  # empty where not previewed
    torsion = zip(plan.pretension.pretension_mm, preview.torsion_deg, strict=False)
    pose = {} if plan.rest_pose.is_straight else {"pose": plan.rest_pose.to_json()}
    return {
        "plan": plan.name,
        "rig": rig.name,
        **pose,
        "ok": not preview.refusals,
        "duration_s": preview.duration_s,
        "longest_s": preview.longest_s,
        "bench_s": preview.bench_s,
        "groups": preview.groups,
        "samples": preview.samples,
        "full_amplitude_hz": preview.full_amplitude_hz,
        "drive": [{"frequency_hz": f, "amplitude_deg": a, "current_a": c} for f, a, c in drive],
        "tension": [{"pretension_mm": p, "tension_n": finite(t)} for p, t in tension],
        "torsion": [{"pretension_mm": p, "torsion_deg": t} for p, t in torsion],
        **({"expected": [row._asdict() for row in expected]} if expected else {}),
        "findings": [{"severity": f.severity, "sentence": f.sentence} for f in preview.findings],
    }
