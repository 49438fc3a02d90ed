"""This is where sliders become a joint, and the joint its predicted curve."""

import functools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.plan.rig import RigSpec
    from sinew.predict.branch import Branch, Mark, Prediction
    from sinew.predict.joints.validity import Check

__all__ = ["base_rig", "changed_rig", "curve_document", "design_curves", "sketch_curves", "warm_up"]

_ROUND, _FLAT = {"outer_mm", "inner_mm"}, {"width_mm", "height_mm"}
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
    are right to 0.4 % of the curve's height and whose peak to 0.3 % in frequency (`sinew.predict.sketch`).

    Lists over the curve's points, which goes through its folds: `frequency_hz`, `gain` (half of peak to peak of the
    torsion over the command's amplitude, as the analysis' `gain`), `gain_measured_drive` (fundamentals, over the
    lever), `phase_deg` (lag behind the lever), `torsion_deg`, `stable`. `folds`, `peak`, `phase_90`: each with
    `frequency_hz`, `gain`, `phase_deg`. `validity`: rows of check, value, limit, holds, sentence. Further
    `error_estimate`, `harmonics`, `complete`, `message`, `wall_s`, and `base`, `rig`: the names.
    Raises SpecError where a number cannot be meant.
    """
    from sinew.apps.predict_rig import rig_asked

    base = base_rig(rig)
    made = changed_rig(base, changes)
    low, high = (float(hertz) for hertz in band_hz)
    rig_asked(repr(float(pretension_mm)), amplitude_deg, "position", None, low, high)
    prediction, checks = _predicted(made, float(pretension_mm), amplitude_deg, (low, high), fine)
    branch = prediction.branches[0]
    return {
        **curve_document(branch, math.radians(amplitude_deg)),
        "base": base.name,
        "rig": made.name,
        "pretension_mm": pretension_mm,
        "amplitude_deg": amplitude_deg,
        "fine": fine,
        "harmonics": prediction.harmonics,
        "error_estimate": prediction.error_estimate,
        "wall_s": prediction.wall_s,
        "validity": [
            {"check": c.name, "value": c.value, "limit": c.limit, "holds": c.holds, "sentence": c.sentence}
            for c in checks
        ],
    }


def sketch_curves(
    rig: str,
    changes: Mapping[str, float | str | None],
    pretension_mm: float,
    amplitude_deg: float,
    band_hz: Sequence[float] = (1.0, 6.0),
) -> dict[str, Any]:
    """Return the sketch of `design_curves`: in a process of its own it need not wait for a refined curve."""
    return design_curves(rig, changes, pretension_mm, amplitude_deg, band_hz, fine=False)


def changed_rig(base: "RigSpec", changes: Mapping[str, float | str | None]) -> "RigSpec":
    """Return the rig that a base becomes with some changes, by the names of the options of `sinew predict`.

    `length_mm`, `outer_mm` (a circle; with `inner_mm` an annulus), `width_mm` with `height_mm` (an ellipse),
    `tendon_circle_mm`, `lever_inertia_kg_m2`, `head_inertia_kg_m2`, `head_mass_kg`, `material`, `shear_modulus_kpa`,
    `loss_factor`, `tendons`, `first_contact_n`; `section` where another shape is meant. None leaves a part as it is.
    Raises SpecError for an unknown name, and where a number cannot be meant.
    """
    from sinew.apps.joint_options import JointOptions, design_of
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
    """Compile all that sketches need, and return how long it took [s]; after it no change of a number compiles anew."""
    import time

    begin = time.perf_counter()
    for pretension, amplitude in _WARM:
        sketch_curves("paper", {"length_mm": 90.0}, pretension, amplitude)
    return {"wall_s": time.perf_counter() - begin}


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
) -> "tuple[Prediction, list[Check]]":
    """Return (prediction, checks of what is assumed)."""
    import numpy as np

    from sinew.predict.joint import RESOLUTION, joint_problem
    from sinew.predict.joints.loads import loads_of
    from sinew.predict.joints.validity import check_joint
    from sinew.predict.prediction import predict
    from sinew.predict.sketch import sketch
    from sinew.twin.cache import configure

    configure()
    problem = joint_problem(rig, [pretension_mm], amplitude_deg, band_hz)
    prediction = predict(problem, band_hz, RESOLUTION) if fine else sketch(problem, band_hz)
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
