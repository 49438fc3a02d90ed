"""What a plan will bring about on a rig, as it was foreseen before: a run starts without the twin where it was asked.

The dashboard tries a plan before it may start, and `sinew run` tries it again before anything moves: the same numbers
of the same texts. They are kept (`sinew.measure.kept`); the limits are looked at each time.
"""

from collections.abc import Sequence
from typing import Any

from sinew.measure.kept import keep, key_of, recall
from sinew.plan.check import Preview, check_plan
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec

_KIND = "foreseen"


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
    return key_of(plan.model_dump_json(), rig.model_dump_json())
