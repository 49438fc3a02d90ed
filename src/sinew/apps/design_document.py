"""This is where designed joints become the JSON document of `sinew design`."""

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sinew.tune.confirmation import Confirmed
    from sinew.tune.design import Designed, Effort
    from sinew.tune.design_target import DesignTarget
    from sinew.tune.proposal import Proposal

__all__ = ["design_document"]


def design_document(found: "Designed", target: "DesignTarget", base: str, effort: "Effort") -> dict[str, Any]:
    """Return what a search found, as JSON holds it."""
    proposals = [
        {**_joint(found.evaluated[i], bool(found.front[i])), **_proposal(found.evaluated[i], confirmed)}
        for i, confirmed in zip(found.chosen, found.confirmed, strict=True)
    ]
    return {
        "base": base,
        "target": {
            "stride_band_hz": list(target.band_hz),
            "yaw_deg": target.yaw_deg,
            "inertia_kg_m2": target.inertia,
            "envelope_mm": [1e3 * target.diameter, 1e3 * target.length],
            "torso_kg": None if target.torso is None else target.torso.mass,
            "torso_centre_mm": None if target.torso is None else 1e3 * target.torso.centre,
        },
        "assumptions": _assumptions(target),
        "effort": {**effort.__dict__},
        "candidates": found.candidates,
        "feasible": found.feasible,
        "evaluated": [_joint(one, bool(on)) for one, on in zip(found.evaluated, found.front, strict=True)],
        "proposals": proposals,
        "sentences": [*_sentences(found, proposals), *_assumptions(target)],
        "wall_s": {"search": found.search_s, "exact": found.exact_s, "confirm": found.confirm_s},
    }


def _joint(one: "Proposal", on_front: bool) -> dict[str, Any]:
    return {
        "name": one.rig.name,
        "shape": one.draft.shape,
        "material": one.draft.material,
        "feasible": not one.faults,
        "faults": list(one.faults),
        "on_front": on_front,
        "energy_j": one.energy,
        "volume_cm3": 1e6 * one.volume,
        "tension_n": one.tension,
        "diameter_mm": 1e3 * one.diameter,
        "envelope_length_mm": 1e3 * one.length,
    }


def _proposal(one: "Proposal", confirmed: "tuple[Confirmed, ...]") -> dict[str, Any]:
    from sinew.predict.joints.design import section_of
    from sinew.tune.confirmation import ENOUGH

    rig = one.rig
    rows = [_confirmed(found) for found in confirmed]
    return {
        "section": section_of(rig).shape,
        "length_mm": 1e3 * rig.silicone.length.value,
        "tendon_circle_mm": 1e3 * rig.tendons.head_radius.value,
        "lever_inertia_kg_m2": rig.inertia.lever.value,
        "holding_a": one.holding_a,
        "ends": [_end(one, i) for i in range(2)],
        "validity": [
            {"check": c.name, "value": c.value, "limit": c.limit, "holds": c.holds, "sentence": c.sentence}
            for c in one.checks
        ],
        "confirmed": rows,
        "is_confirmed": all(row["error"] is not None and abs(row["error"]) <= ENOUGH for row in rows),
        "rig": None,
        "plan": None,
    }


def _end(one: "Proposal", i: int) -> dict[str, float]:
    at, load = one.ends[i], one.loads[i]
    return {
        "wanted_hz": one.draft.target.band_hz[i],
        "frequency_hz": at.frequency_hz,
        "pretension_mm": at.pretension_mm,
        "command_deg": math.degrees(at.command),
        "lever_deg": math.degrees(abs(at.lever)),
        "torsion_deg": math.degrees(at.torsion),
        "damping_ratio": one.damping_ratio[i],
        "rest_tension_n": at.rest_tension,
        "tension_n": at.tension,
        "torque_n_m": load.torque,
        "speed_rad_s": load.speed,
        "duty": load.duty,
        "current_a": load.current,
        "work_j": load.work,
        "energy_j": load.energy,
    }


def _confirmed(found: "Confirmed") -> dict[str, Any]:
    def number(x: float) -> float | None:
        return x if math.isfinite(x) else None

    return {
        "pretension_mm": found.pretension_mm,
        "predicted_hz": number(found.predicted_hz),
        "measured_hz": found.measured_hz.to_json(),
        "peak_hz": found.peak_hz.to_json(),
        "yaw_deg": number(found.yaw_deg),
        "error": number(found.error),
    }


def _assumptions(target: "DesignTarget") -> list[str]:
    """Return what is taken for granted of the torso, a sentence each."""
    if target.torso is None:
        return [
            "assumed: nothing presses on the joint but its tendons; the weight of what sits on it is left out, for no "
            "mass was given. Give it with --torso-kg, and buckling, strain, tension and tipping are checked under it"
        ]
    torso = target.torso
    return [
        f"assumed: {torso.mass:g} kg stand upright on the joint with their centre {1e3 * torso.centre:g} mm above the "
        f"head plate and press with {torso.weight:.0f} N; pretension counts from the first contact under that weight; "
        f"the head tilts no further than the rig allows. Candidates that fail under it are refused after the search, "
        "which does not know of it; the swing's resonance is that without weight"
    ]


def _sentences(found: "Designed", proposals: list[dict[str, Any]]) -> list[str]:
    told = [f"{found.feasible} of {found.candidates} candidates of the search keep every limit"]
    fit = sum(not one.faults for one in found.evaluated)
    told.append(f"{fit} of {len(found.evaluated)} that were computed exactly do, {int(found.front.sum())} undominated")
    if not proposals:
        told.append("no joint within these limits was found; allow a larger envelope, a narrower band or less yaw")
        return told
    sure = sum(one["is_confirmed"] for one in proposals)
    told.append(f"{sure} of {len(proposals)} proposals resonate on the full twin within 3 % of what was predicted")
    held = max(one["holding_a"] for one in proposals)
    told.append(
        f"holding the tendons takes up to {held:.2f} A of each tendon motor if its gear holds nothing; that is not in "
        "the drive's energy"
    )
    return told
