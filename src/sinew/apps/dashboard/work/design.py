"""What is computed before anything moves: the joint that sliders describe, a plan's preview and its prediction."""

import functools
import json
import math
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from sinew.measure.errors import SpecError
from sinew.measure.estimate import all_finite
from sinew.measure.kept import keep, key_of, recall

if TYPE_CHECKING:
    from sinew.plan.plan import Plan
    from sinew.plan.rig import RigSpec
    from sinew.predict.band import Band
    from sinew.predict.joints.validity import Check
    from sinew.solve.branch import Branch, Mark, Prediction


_ROUND, _FLAT = {"outer_mm", "inner_mm"}, {"width_mm", "height_mm"}
_NEAR = 5  # points of a curve about its 90° of lag
_WARM = ((0.0, 20.0), (6.0, 20.0))


def design_curves(
    rig: str,
    changes: Mapping[str, float | str | None],
    pretension_mm: float,
    amplitude_deg: float,
    band_hz: Sequence[float] = (1.0, 6.0),
    fine: bool = False,
) -> dict[str, Any]:
    """Return the predicted response of a joint that is built or not.

    rig: name of a shipped one, or its TOML text. changes: see `changed_rig`; empty for the rig as it is.
    pretension_mm [mm], amplitude_deg: of the drive's command [deg]. band_hz: first and last frequency.
    fine: refined until the error is below 0.5 %, in half a second; else a sketch in a tenth of that, whose amplitudes
    are right to 0.4 % of the curve's height and whose peak to 0.3 % in frequency (`sinew.predict.predicted`).

    Lists over the curve's points, which goes through its folds: `frequency_hz`, `gain` (half of peak to peak of the
    torsion over the command's amplitude, as the analysis' `gain`), `gain_measured_drive` (fundamentals, over the
    lever), `phase_deg` (lag behind the lever), `torsion_deg`, `stable`. `folds`, `peak`, `phase_90`: each with
    `frequency_hz`, `gain`, `phase_deg`. `damping`: Lehr's D by the slope of the lag over frequency where it is 90°,
    D = 1/(f dφ/df), None where it is not passed. `validity`: rows of check, value, limit, holds, sentence; of a sketch
    None. Further `error_estimate`, `harmonics`, `complete`, `message`, `wall_s`, and `base`, `rig`: the names.
    Raises SpecError where a number cannot be meant.
    """
    from sinew.apps.joints.options import rig_asked

    base = base_rig(rig)
    made = changed_rig(base, changes)
    low, high = (float(hertz) for hertz in band_hz)
    rig_asked(repr(float(pretension_mm)), amplitude_deg, "position", None, low, high)
    prediction, checks = _predicted(made, float(pretension_mm), amplitude_deg, (low, high), fine)
    branch = prediction.branches[0]
    found = {
        **curve_document(branch, math.radians(amplitude_deg)),
        "damping": slope_damping(branch),
        "base": base.name,
        "rig": made.name,
        "pretension_mm": pretension_mm,
        "amplitude_deg": amplitude_deg,
        "fine": fine,
        "harmonics": prediction.harmonics,
        "error_estimate": prediction.error_estimate,
        "wall_s": prediction.wall_s,
        "validity": None if checks is None else [c.to_json() for c in checks],
    }
    if fine:
        keep(_CURVES, curves_key(rig, changes, pretension_mm, amplitude_deg, band_hz), found)
    return found


# Refined curves are kept on the disk, so that the page opens with them: to compile what they need takes half a minute
# of a core. That of the rig which is offered first ships with Sinew (`tools/write_first_curve.py`).

_CURVES, _PREDICTED = "curves", "predicted"
FIRST_CURVE = "first-curve.json"


def kept_curves(
    rig: str,
    changes: Mapping[str, float | str | None],
    pretension_mm: float,
    amplitude_deg: float,
    band_hz: Sequence[float] = (1.0, 6.0),
) -> dict[str, Any] | None:
    """Return what `design_curves` said of a joint when it was asked before, refined; None where that is not known.

    Arguments as of `design_curves`. Needs no JAX, and a few milliseconds. `is_shipped`: whether it came with Sinew, of
    the equations as they were then.
    """
    key = curves_key(rig, changes, pretension_mm, amplitude_deg, band_hz)
    if (found := recall(_CURVES, key)) is not None:
        return {**found, "is_shipped": False}
    shipped = json.loads(files("sinew").joinpath("rigs", FIRST_CURVE).read_text(encoding="utf-8"))
    return {**shipped["found"], "is_shipped": True} if shipped["key"] == key else None


def curves_key(
    rig: str,
    changes: Mapping[str, float | str | None],
    pretension_mm: float,
    amplitude_deg: float,
    band_hz: Sequence[float],
) -> str:
    """Return what stands for a joint among those that are kept."""
    meant = {name: value for name, value in changes.items() if value is not None}
    return key_of(rig, meant, float(pretension_mm), float(amplitude_deg), *map(float, band_hz))


def slope_damping(branch: "Branch") -> float | None:
    """Return Lehr's damping of a curve by the slope of its lag at 90°; None where that is not passed.

    An oscillator's lag has the slope dφ/df = 1/(D f) there. Where losses or stiffness change with the swing, so does
    the slope, which is that of motions of a constant command.
    """
    import numpy as np

    mark = branch.phase_90
    if mark is None:
        return None
    # The cotangent of an oscillator's lag is all but straight over frequency, and its slope there is that of the lag.
    near = np.argsort(np.abs(branch.phase - np.pi / 2))[:_NEAR]
    off = branch.frequency_hz[near] / mark.frequency_hz - 1
    if np.ptp(off) == 0:
        return None
    slope = -np.polyfit(off, 1 / np.tan(branch.phase[near]), min(2, near.size - 1))[-2]
    return 1 / float(slope) if slope > 0 else None


sketch_curves = functools.partial(design_curves, fine=False)
"""The sketch of `design_curves`: in a process of its own it need not wait for a refined curve."""


def changed_rig(base: "RigSpec", changes: Mapping[str, float | str | None]) -> "RigSpec":
    """Return the rig that a base becomes with some changes, by the names of the options of `sinew predict`.

    `length_mm`, `outer_mm` (a circle; with `inner_mm` an annulus), `width_mm` with `height_mm` (an ellipse),
    `tendon_circle_mm`, `lever_inertia_kg_m2`, `head_inertia_kg_m2`, `head_mass_kg`, `material`, `shear_modulus_kpa`,
    `loss_factor`, `tendons`, `first_contact_n`; `section` where another shape is meant. None leaves a part as it is.
    Raises SpecError for an unknown name, and where a number cannot be meant.
    """
    from sinew.apps.joints.options import JointOptions, design_of
    from sinew.predict.joints.design import design_rig

    given: dict[str, Any] = {name: value for name, value in changes.items() if value is not None}
    known = [name for name in JointOptions._fields if name not in ("polygon", "name")]
    for name, value in given.items():
        if name not in known:
            raise SpecError(f"found a change of {name}, expected one of {', '.join(known)}")
        if isinstance(value, (int, float)) and not (math.isfinite(value) and value > 0):
            raise SpecError(f"{name} is {value:g}, expected a positive number")
    if not given:
        return base
    if "section" not in given and given.keys() & (_ROUND | _FLAT):
        given["section"] = _shape(set(given))
    for name in ("tendons", "star_points"):
        if name in given:
            given[name] = int(given[name])
    return design_rig(base, design_of(JointOptions(**given)))


def warm_up() -> dict[str, Any]:
    """Compile all that sketches and suggestions need, and return how long it took [s]; after it no change of a number
    compiles anew."""
    import time

    begin = time.perf_counter()
    for pretension, amplitude in _WARM:
        sketch_curves("paper", {"length_mm": 90.0}, pretension, amplitude)
    suggest_pretension("paper", {"length_mm": 90.0}, 3.6)
    return {"wall_s": time.perf_counter() - begin}


def rig_text(rig: str, changes: Mapping[str, float | str | None], name: str) -> str:
    """Return the TOML text of a rig with some changes, under a name of its own. Arguments and errors as of
    `changed_rig`."""
    from sinew.plan.toml import dump_rig

    return dump_rig(changed_rig(base_rig(rig), changes).model_copy(update={"name": name}))


def _shape(given: set[str]) -> str:
    if given & _FLAT:
        return "ellipse"
    return "annulus" if "inner_mm" in given else "circle"


@functools.lru_cache(maxsize=16)
def base_rig(rig: str) -> "RigSpec":
    """Return the rig of a shipped name or of a TOML text. Raises SpecError."""
    from sinew.plan.toml import load_rig, parse_rig

    return parse_rig(rig) if "\n" in rig else load_rig(rig)


def _predicted(
    rig: "RigSpec", pretension_mm: float, amplitude_deg: float, band_hz: tuple[float, float], fine: bool
) -> "tuple[Prediction, list[Check] | None]":
    """Return (prediction, checks of what is assumed; of a sketch, which is made while a slider moves, None)."""
    import numpy as np

    from sinew.predict.joint import RESOLUTION, joint_problem
    from sinew.predict.joints.validity import check_joint, loads_of
    from sinew.predict.predicted import sketch
    from sinew.solve.curves import predict
    from sinew.solve.programs import configure

    configure()
    problem = joint_problem(rig, [pretension_mm], amplitude_deg, band_hz)
    if not fine:
        return sketch(problem, band_hz), None
    prediction = predict(problem, band_hz, RESOLUTION)
    torsion = np.array([float(np.max(branch.amplitude, initial=0.0)) for branch in prediction.branches])
    return prediction, check_joint(rig, [pretension_mm], loads_of(problem, torsion), tilt_held=True)


def curve_document(branch: "Branch", nominal: float) -> dict[str, Any]:
    """Return a predicted branch as lists over its points, with its marks; see `design_curves`.

    nominal: amplitude of the command [rad].
    """
    import numpy as np

    def mark(one: "Mark | None") -> dict[str, float] | None:
        if one is None:
            return None
        gain, phase = one.amplitude / nominal, math.degrees(one.phase)
        return {"frequency_hz": one.frequency_hz, "gain": gain, "phase_deg": phase}

    return {
        "frequency_hz": branch.frequency_hz.tolist(),
        "gain": (branch.amplitude / nominal).tolist(),
        "gain_measured_drive": (branch.fundamental / np.abs(branch.drive)).tolist(),
        "phase_deg": np.degrees(branch.phase).tolist(),
        "torsion_deg": np.degrees(branch.amplitude).tolist(),
        "stable": branch.stable.tolist(),
        "folds": [mark(fold) for fold in branch.folds],
        "peak": mark(branch.peak),
        "phase_90": mark(branch.phase_90),
        "complete": branch.complete,
        "message": branch.message,
    }


# A plan's curves are foretold, for what is measured to be held against.

_NOT_FORETOLD = (
    "This page holds no prediction beside a head that bends or sways: sinew check says what its sweep should give, "
    "sinew predict --bend-deg how it swings."
)
_ROOM = 0.4
_SEED = 0


def prediction_for_plan(plan_toml: str, rig_toml: str, draws: int = 0) -> dict[str, Any]:
    """Return the predicted response at each pretension of a plan, over the frequencies that it drives.

    Of a head that bends or sways there is none here, `curves` is empty and `remarks` says so.

    draws: rigs drawn from what is known of the rig's parameters, for 90 % bands; 0 for none.

    `curves`: in the plan's order of pretensions `pretension_mm`, and over the curve's points, which go through its
    folds, `frequency_hz`, `gain` (half of peak to peak over the commanded amplitude, what the analysis calls gain),
    `gain_measured_drive` (fundamentals, over the lever), `phase` (lag behind the lever [deg]), `stable`; `peak`,
    `phase_90` and `folds` as of `design_curves`. With bands also `gain_low`, `gain_high`, `phase_low`, `phase_high`:
    of what a sweep up or one down meets; None where no draw has a curve. `can_have_bands`: whether the rig holds
    intervals. `amplitude_deg`: of the command. `remarks`: sentences on the bands.
    It is kept, and comes from the disk the next time. Raises SpecError where a text is no plan or no rig.
    """
    from sinew.plan.toml import dump_plan, dump_rig, parse_plan, parse_rig

    plan, rig = parse_plan(plan_toml), parse_rig(rig_toml)
    if plan.is_spatial:
        return {"curves": [], "amplitude_deg": None, "can_have_bands": False, "remarks": [_NOT_FORETOLD]}
    key = key_of(dump_plan(plan), dump_rig(rig), draws)  # with its intervals, which a model's JSON leaves out
    found: dict[str, Any] | None = recall(_PREDICTED, key)
    if found is None:
        found = _predicted_for(plan, rig, draws)
        keep(_PREDICTED, key, found)
    return found


def _predicted_for(plan: "Plan", rig: "RigSpec", draws: int) -> dict[str, Any]:
    import numpy as np

    from sinew.predict.band import bands_of, draw_rigs, spread_of
    from sinew.predict.joint import RESOLUTION, joint_problem
    from sinew.solve.curves import predict
    from sinew.solve.programs import configure

    configure()
    pretensions, mode = list(plan.pretension.pretension_mm), plan.pretension.mode
    amplitude_deg, band_hz = _driven(plan)
    prediction = predict(joint_problem(rig, pretensions, amplitude_deg, band_hz, mode=mode), band_hz, RESOLUTION)
    nominal = math.radians(amplitude_deg)
    curves = []
    for pretension, branch in zip(pretensions, prediction.branches, strict=True):
        curve = curve_document(branch, nominal)
        curves.append({"pretension_mm": pretension, **curve, "phase": curve.pop("phase_deg")})
    found: dict[str, Any] = {"curves": curves, "amplitude_deg": amplitude_deg, "remarks": []}
    try:
        spread_of(rig)
    except SpecError as nothing_known:
        return found | {"can_have_bands": False, "remarks": [str(nothing_known)]}
    if draws > 1:
        drawn = draw_rigs(rig, draws, _SEED)
        bands = bands_of(prediction, rig, drawn, pretensions, amplitude_deg, band_hz, mode=mode)
        for curve, branch, band in zip(curves, prediction.branches, bands, strict=True):
            for name, place, scale in (("gain", 0, 1 / nominal), ("phase", 1, float(np.degrees(1.0)))):
                low, high = _ends(branch, band, place)
                curve[f"{name}_low"], curve[f"{name}_high"] = all_finite(low * scale), all_finite(high * scale)
        found["remarks"] = list(drawn.remarks)
    return found | {"can_have_bands": True}


def _driven(plan: "Plan") -> tuple[float, tuple[float, float]]:
    """Return (amplitude of the command [deg], lowest and highest frequency [Hz]) that a plan drives with."""
    if plan.sweep is not None:
        low, high, amplitude = plan.sweep.frequency_hz[0], plan.sweep.frequency_hz[-1], plan.sweep.amplitude_deg
    elif plan.track is not None:
        low, high, amplitude = plan.track.low_hz, plan.track.high_hz, max(plan.track.amplitude_deg)
    else:
        assert plan.ring_down is not None
        low, high = min(plan.ring_down.frequency_hz), max(plan.ring_down.frequency_hz)
        amplitude = plan.ring_down.amplitude_deg
    if high < low * (1 + _ROOM):
        return amplitude, (low / (1 + _ROOM), high * (1 + _ROOM))
    return amplitude, (low, high)


def _ends(branch: "Branch", band: "Band", place: int) -> Any:
    """Return the ends of a band at the points of its curve, (2, n); place: 0 amplitude [rad], 1 lag [rad]."""
    import numpy as np

    up, down = band.up[place], band.down[place]
    low, high = np.fmin(up.low, down.low), np.fmax(up.high, down.high)
    return np.array([np.interp(branch.frequency_hz, band.frequency_hz, end) for end in (low, high)])


# A pretension is suggested for a wanted resonance.

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
    from sinew.predict.band import draw_rigs
    from sinew.solve.programs import configure
    from sinew.tune.pretension import Swing, sketched, tune_pretension

    if amplitude_deg is not None and yaw_deg is not None:
        raise SpecError("found an amplitude of the command and one of the torsion, expected one of them")
    configure()
    made = changed_rig(base_rig(rig), changes)
    command_deg = 20.0 if amplitude_deg is None else float(amplitude_deg)
    swing = Swing(yaw_deg=float(yaw_deg)) if yaw_deg is not None else Swing(command_deg=command_deg)
    known = made.calibration is not None or any(one.interval90 is not None for _, one in made.parameters())
    drawn = draw_rigs(made, draws, 0) if draws > 1 and known else None
    document = tune_pretension(made, [float(wanted_hz)], swing, draws=drawn, follow=sketched).document()
    remarks = list(document["remarks"])
    if not known:
        remarks.append(f"the rig {made.name} holds no intervals, so nothing is known of how far this can be off")
    none: dict[str, Any] = {"pretension_mm": None, "frequency_hz": None}
    return {**none, **document["settings"][0], "range": document["range"], "remarks": remarks}


# A plan is previewed for its page: its faults and stages at once, and what `sinew check --json` says of it.


def plan_outline(plan_toml: str, rig_toml: str | None = None) -> dict[str, Any]:
    """Return what is known of a plan's text at once: `faults`, as `sinew.plan.toml.plan_faults` has them, each with
    `line`, `sentence` and `is_limit`; where it is a plan, though it may break limits of a rig, also `name` and
    `stages`, as `sinew.plan.check.stages_of` has them. Raises SpecError where the other text is no rig."""
    from sinew.plan.check import stages_of
    from sinew.plan.toml import parse_plan, plan_faults

    faults = plan_faults(plan_toml, None if rig_toml is None else base_rig(rig_toml))
    told = {"faults": [fault._asdict() for fault in faults]}
    if not all(fault.is_limit for fault in faults):
        return told
    plan = parse_plan(plan_toml)
    return {**told, "name": plan.name, "stages": [stage._asdict() for stage in stages_of(plan)]}


def preview_document(plan_toml: str, rig_toml: str, swing: bool = True) -> dict[str, Any]:
    """Return what `sinew check --json` says of a plan on a rig, further `refusals` and `warnings` as sentences.

    plan_toml, rig_toml: texts. swing: simulate the plan for its largest torsions, which takes seconds where it is long;
    of a head that bends or sways they are not foretold. A slack tendon is refused, as every bench refuses it. A plan
    that breaks a limit is an answer, with `ok` false. Raises SpecError where a text is no plan or no rig, or the plan
    drives as no bench does.
    """
    from sinew.bench.preflight import wire_times
    from sinew.plan.plan import require_motors
    from sinew.plan.toml import parse_plan, parse_rig
    from sinew.predict.foreseen import foresee_plan, told_preview

    plan, rig = parse_plan(plan_toml), parse_rig(rig_toml)
    require_motors(plan, "the bench")
    if swing and not plan.is_spatial:
        preview = foresee_plan(plan, rig)[0]
    else:
        from sinew.predict.preview import held_preview, preview_plan

        preview = held_preview(plan, rig)[0] if plan.is_spatial else preview_plan(plan, rig)
    warnings = [finding.sentence for finding in preview.findings if finding.severity == "warn"]
    told = told_preview(plan, rig, preview) | {"wire": wire_times(plan, rig)}
    return {**told, "refusals": list(preview.refusals), "warnings": warnings}
