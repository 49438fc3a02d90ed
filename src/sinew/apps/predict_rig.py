"""This is where a rig, shipped, calibrated or of a joint that is not built yet, becomes its predicted curves."""

from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, cast

import typer

from sinew.apps.predict_document import prediction_document
from sinew.measure.errors import SpecError
from sinew.measure.units import number_list

if TYPE_CHECKING:
    from sinew.plan.plan import TendonMode
    from sinew.plan.rig import RigSpec
    from sinew.predict.branch import Prediction
    from sinew.predict.joints.validity import Check
    from sinew.predict.prediction import Problem

__all__ = [
    "Amplitude",
    "Mode",
    "Predicted",
    "Pretension",
    "RigAsked",
    "Without",
    "check_mode",
    "predict_rig",
    "rig_asked",
]

_MODES = ("position", "position-with-current-limit", "current")
_BAND_HZ = (1.0, 6.0)

Pretension = Annotated[
    str, typer.Option("--pretension-mm", metavar="MM,...", help="Rig: pretensions, one curve for each.")
]
Amplitude = Annotated[
    float, typer.Option("--amplitude-deg", metavar="DEG", help="Rig: amplitude of the drive's command.")
]
Mode = Annotated[str, typer.Option("--mode", metavar="|".join(_MODES), help="Rig: mode of the motors.")]
Without = Annotated[
    list[str] | None,
    typer.Option("--without", metavar="EFFECT", help="Rig: switch an effect of the twin off; may be repeated."),
]


class RigAsked(NamedTuple):
    """What is asked of a rig: pretensions [mm], amplitude of the command [deg], mode of the motors, effects of the
    twin that are off, and band [Hz]."""

    pretensions: list[float]
    amplitude_deg: float
    mode: str
    without: tuple[str, ...]
    band_hz: tuple[float, float]

    def words(self) -> list[str]:
        """Return the options that ask for it again."""
        pretensions = ",".join(f"{mm:g}" for mm in self.pretensions)
        words = ["--pretension-mm", pretensions, "--amplitude-deg", f"{self.amplitude_deg:g}", "--mode", self.mode]
        words += [word for effect in self.without for word in ("--without", effect)]
        return [*words, "--from-hz", f"{self.band_hz[0]:g}", "--to-hz", f"{self.band_hz[1]:g}"]


class Predicted(NamedTuple):
    """A rig's prediction: the problem it was, its curves, and what it is worth."""

    rig: "RigSpec"
    asked: RigAsked
    problem: "Problem"
    prediction: "Prediction"
    checks: "list[Check]"

    def document(self) -> dict[str, Any]:
        """Return it as JSON holds it."""
        found = prediction_document(self.prediction, self.asked.pretensions)
        found["validity"] = [
            {"check": c.name, "value": c.value, "limit": c.limit, "holds": c.holds, "sentence": c.sentence}
            for c in self.checks
        ]
        return found

    def backbones(self) -> list[dict[str, Any]]:
        """Return the documents of its backbones."""
        from sinew.apps.predict_backbone import rig_backbones
        from sinew.twin.effects import Effects

        asked, effects = self.asked, Effects().without(*self.asked.without)
        mode = cast("TendonMode", asked.mode)
        return rig_backbones(self.rig, asked.pretensions, asked.amplitude_deg, asked.band_hz, mode, effects)


def check_mode(mode: str) -> None:
    """Do nothing where a mode of the tendon motors is known; else raise SpecError."""
    if mode not in _MODES:
        raise SpecError(f"--mode is {mode!r}, expected one of {', '.join(_MODES)}")


def rig_asked(
    pretension: str, amplitude: float, mode: str, without: list[str] | None, start: float | None, stop: float | None
) -> RigAsked:
    """Return what the options ask of a rig. Raises SpecError where one of them cannot be meant."""
    check_mode(mode)
    try:
        pretensions = number_list(pretension)
    except ValueError as error:
        raise SpecError(f"--pretension-mm: {error}") from error
    if amplitude <= 0:
        raise SpecError(f"--amplitude-deg is {amplitude:g}, expected a positive angle")
    if min(pretensions) < 0:
        raise SpecError(f"--pretension-mm holds {min(pretensions):g}, expected zero or more: cables cannot push")
    band_hz = (start or _BAND_HZ[0], stop or _BAND_HZ[1])
    if not 0 < band_hz[0] < band_hz[1]:
        raise SpecError(f"found a band from {band_hz[0]:g} to {band_hz[1]:g} Hz, expected 0 < --from-hz < --to-hz")
    return RigAsked(pretensions, amplitude, mode, tuple(without or ()), band_hz)


def predict_rig(rig: "RigSpec", asked: RigAsked) -> Predicted:
    """Return the prediction of a rig, with what it is worth."""
    import numpy as np

    from sinew.predict.joint import RESOLUTION, joint_problem
    from sinew.predict.joints.loads import loads_of
    from sinew.predict.joints.validity import check_joint
    from sinew.predict.prediction import predict
    from sinew.twin.cache import configure
    from sinew.twin.effects import Effects

    configure()
    mode, effects = cast("TendonMode", asked.mode), Effects().without(*asked.without)
    problem = joint_problem(rig, asked.pretensions, asked.amplitude_deg, asked.band_hz, mode=mode, effects=effects)
    prediction = predict(problem, asked.band_hz, RESOLUTION)
    torsion = np.array([float(np.max(branch.amplitude, initial=0.0)) for branch in prediction.branches])
    held = asked.mode != "current"
    checks = check_joint(rig, asked.pretensions, loads_of(problem, torsion), tilt_held=held)
    return Predicted(rig, asked, problem, prediction, checks)
