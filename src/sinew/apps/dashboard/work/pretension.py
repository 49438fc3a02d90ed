"""This is where a pretension is suggested for a wanted resonance."""

from collections.abc import Mapping
from typing import Any

from sinew.measure.errors import SpecError

__all__ = ["suggest_pretension"]

_DRAWS = 40


def suggest_pretension(
    rig: str,
    changes: Mapping[str, float | str | None],
    wanted_hz: float,
    amplitude_deg: float | None = None,
    yaw_deg: float | None = None,
    draws: int = _DRAWS,
) -> dict[str, Any]:
    """Return the pretension at which a joint resonates at a wanted frequency, or why there is none.

    rig, changes: as for `design_curves`. amplitude_deg: of the command, 20 where neither is given; yaw_deg: of the
    torsion instead. draws: for the intervals, where something is known of the rig's uncertainty; 0 for none.

    `pretension_mm` and `frequency_hz`: `{"value", "std", "interval90"}`, None where it is out of reach; `sentence`: in
    words, also why not; `range`: pretensions, frequencies and what limits them; `remarks`: sentences on the intervals;
    and what else `sinew tune --json` says of one setting. Raises SpecError where a number cannot be meant.
    """
    from sinew.apps.dashboard.work.design import base_rig, changed_rig
    from sinew.apps.tune import tuning_document
    from sinew.predict.draws import draw_rigs
    from sinew.tune.pretension import tune_pretension
    from sinew.tune.resonance import Swing
    from sinew.twin.cache import configure

    if amplitude_deg is not None and yaw_deg is not None:
        raise SpecError("found an amplitude of the command and one of the torsion, expected one of them")
    configure()
    made = changed_rig(base_rig(rig), changes)
    command_deg = 20.0 if amplitude_deg is None else float(amplitude_deg)
    swing = Swing(yaw_deg=float(yaw_deg)) if yaw_deg is not None else Swing(command_deg=command_deg)
    known = made.calibration is not None or any(one.interval90 is not None for _, one in made.parameters())
    drawn = draw_rigs(made, draws, 0) if draws > 1 and known else None
    document = tuning_document(tune_pretension(made, [float(wanted_hz)], swing, draws=drawn))
    remarks = list(document["remarks"])
    if not known:
        remarks.append(f"the rig {made.name} holds no intervals, so nothing is known of how far this can be off")
    none: dict[str, Any] = {"pretension_mm": None, "frequency_hz": None}
    return {**none, **document["settings"][0], "range": document["range"], "remarks": remarks}
