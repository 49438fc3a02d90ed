"""Pretensions predicted by a rig that was calibrated at a few others.

The paper's campaign runs on the twin, with scatter, noise and jitter. The search begins at another rig: the
parameters that a calibration finds are displaced, the drive is known. It sees the recording at 0, 4, 8 and 12 mm
alone. Predicted are all thirteen pretensions; counted are the nine others, by the resonance and the gain there: error
of the frequency at most 1 %, of the gain at most 3 %.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from campaigns.calibration import draw_rig

from sinew.identify.joint.calibration import Calibration, calibrate
from sinew.plan.plan import Plan
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.predict.against import Against, hold_against, measured_of
from sinew.predict.joint import RESOLUTION, joint_problem
from sinew.solve.curves import predict
from sinew.twin.parameters import Effects
from sinew.twin.simulate import simulate

FITTED_MM = (0.0, 4.0, 8.0, 12.0)
FREQUENCY_SHARE, GAIN_SHARE = 0.01, 0.03


@dataclass(frozen=True)
class Outcome:
    """calibration: from the few pretensions. against: the prediction beside all."""

    calibration: Calibration
    against: Against

    def worst(self, name: str) -> float:
        """Return the largest relative error of a reading over the pretensions that were not fitted."""
        return self.against.scores["others"][name].largest


def displaced(truth: RigSpec, seed: int) -> RigSpec:
    """Return the rig that the search begins at: what it can find is elsewhere, the drive is the same."""
    names = [name for name, _ in truth.parameters() if not name.startswith("drive.")]
    other = dict(draw_rig(seed).parameters())
    return truth.with_values({name: other[name].value for name in names})


def at_pretensions(recording: xr.Dataset, pretension_mm: Sequence[float]) -> xr.Dataset:
    """Return the part of a recording that was made at some pretensions."""
    kept = np.isin(recording["pretension_mm"].values, pretension_mm)
    part = recording.isel(segment=kept, sample=np.repeat(kept, recording["row_size"].values))
    return part.assign_attrs(content_hash="")


def predicted(recording: xr.Dataset, rig: RigSpec, fitted_mm: Sequence[float]) -> Against:
    """Return what a rig predicts beside a recording."""
    measured = measured_of(recording, rig)
    band, pretension = measured.band_hz, measured.response.pretension_mm
    command = joint_problem(rig, pretension, measured.amplitude_deg, band, mode=measured.mode)
    return hold_against(measured, predict(command, band, RESOLUTION), rig, Effects(), fitted_mm)


def run(plan: Plan, seed: int, start: int, fitted_mm: Sequence[float] = FITTED_MM) -> Outcome:
    """Return one trial. seed: of the recording. start: of where the search begins."""
    truth = load_rig("paper")
    recording = simulate(plan, truth, seed=seed)
    few = at_pretensions(recording, fitted_mm)
    done = calibrate(displaced(truth, start), few, name="few")
    return Outcome(done, predicted(recording, done.rig, fitted_mm))
