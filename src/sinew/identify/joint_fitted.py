"""This is where a fit of the tendon joint is held: the rig it found, with intervals, and what it leaves unexplained."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sinew.identify.certainty import Covariance, correlation
from sinew.measure.estimate import Estimate
from sinew.measure.schema import SegmentKind
from sinew.plan.rig import RigSpec

__all__ = ["Deviation", "JointFit", "JointSegment"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Deviation:
    """How far one repetition at one pretension was from the shared parameters.

    recording: index of the recording. pretension: of the set pretension [m]; guide_friction: relative [1].
    """

    recording: int
    pretension_mm: float
    repeat: int
    pretension: Estimate
    guide_friction: Estimate


@dataclass(frozen=True)
class JointSegment:
    """One fitted segment: the gyroscope's rate about the joint's axis, as it was and as the fit has it.

    recording, segment: indices. time_s: from the segment's first sample, shape (n,). measured, predicted: [rad/s],
    shape (n,). kept: which samples were fitted, shape (n,); the last of a segment lack the lever motion after them.
    current_a, predicted_current_a: mean current of the tendon motors over the segment.
    """

    recording: int
    segment: int
    kind: SegmentKind
    pretension_mm: float
    frequency_hz: float
    repeat: int
    time_s: Array
    measured: Array
    predicted: Array
    kept: NDArray[np.bool_]
    current_a: float
    predicted_current_a: float

    @property
    def residual(self) -> Array:
        """Return measured less predicted [rad/s], shape (n,)."""
        return self.measured - self.predicted


@dataclass(frozen=True)
class JointFit:
    """What recordings of a rig say about its tendon joint.

    rig: where the fit began; fitted_rig: the same with the fitted values, origin calibrated.
    parameters: by the rig's dotted name, in the unit of the rig's parameter (SI). Those that were tied move along in
        `fitted_rig` (the base's radius with the head's, the head's inertia against the lever's).
    derived: physical combinations, unit in the key. Of the joint: `stiffness_n_m_rad` (G J/L), `tendon_moment_n_m`
        (head radius times the tension of one tendon at first contact). At each pretension, key ending in `[4 mm]`:
        `tendon_moment_n_m`, `tension_n` (of one tendon), `natural_frequency_hz` (undamped), `damping_ratio`, both at
        the torsion amplitude `amplitude_rad`; `cubic_n_m_rad3` (of the static restoring torque), and the shares of the
        energy lost in a cycle, `silicone_share`, `guide_friction_share`, `viscous_share`.
    pretension_mm: that were fitted, increasing. repeats: repetitions at each, over all recordings.
    deviations: of each repetition, the random effects.
    names, covariance: first those of `parameters` in their units, then the deviations (of pretension [m] and of guide
        friction [1], in the order of `deviations`).
    segments: measured and predicted. rmse: by channel with unit: `gyro_rad_s`, `tendon_current_a`.
    converged, message: how the search ended. unidentifiable: sentences.
    """

    rig: RigSpec
    fitted_rig: RigSpec
    parameters: dict[str, Estimate]
    derived: dict[str, Estimate]
    pretension_mm: tuple[float, ...]
    repeats: int
    deviations: tuple[Deviation, ...]
    names: tuple[str, ...]
    covariance: Covariance
    segments: tuple[JointSegment, ...]
    rmse: dict[str, float]
    converged: bool
    message: str
    unidentifiable: tuple[str, ...]

    @property
    def correlation(self) -> Array:
        """Return the correlation matrix of the numbers in `names`, shape (m, m)."""
        return correlation(self.covariance.matrix)

    def at_pretension(self, name: str, pretension_mm: float) -> Estimate:
        """Return one derived quantity at a pretension that was fitted; KeyError where there is none."""
        return self.derived[f"{name}[{pretension_mm:g} mm]"]

    def by_pretension(self) -> list[dict[str, Any]]:
        """Return the derived quantities of every pretension, as JSON has them."""
        rows = []
        for pretension in self.pretension_mm:
            end = f"[{pretension:g} mm]"
            mine = {key.removesuffix(end): one.to_json() for key, one in self.derived.items() if key.endswith(end)}
            rows.append({"pretension_mm": pretension, **mine})
        return rows

    def document(self) -> dict[str, Any]:
        """Return the JSON document of `sinew identify`; frequency and damping are those at the smallest pretension."""
        units = {name: parameter.unit for name, parameter in self.rig.parameters()}
        shared = {key: one.to_json() for key, one in self.derived.items() if not key.endswith(" mm]")}
        return {
            "model": "tendon",
            "parameters": {name: one.to_json() for name, one in self.parameters.items()},
            "units": {name: units[name] for name in self.parameters},
            "derived": shared,
            "natural_frequency_hz": self.at_pretension("natural_frequency_hz", self.pretension_mm[0]).to_json(),
            "damping_ratio": self.at_pretension("damping_ratio", self.pretension_mm[0]).to_json(),
            "by_pretension": self.by_pretension(),
            "rmse": {"train": _number(self.rmse["gyro_rad_s"]), "test": None},
            "unit": "rad/s",
            "converged": self.converged,
            "message": self.message,
            "unidentifiable": list(self.unidentifiable),
            "compared": [],
        }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
