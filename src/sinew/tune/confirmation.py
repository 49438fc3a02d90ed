"""This is where a proposal is run on the full twin, and what comes out is held against what was predicted of it."""

import math
from typing import NamedTuple

import xarray as xr

from sinew.analysis.analysis import analyse_recording
from sinew.measure.estimate import Estimate
from sinew.plan.plan import Plan
from sinew.tune.proposal import Proposal, plan_of
from sinew.tune.resonance import Swing, find_resonances
from sinew.twin.cache import configure
from sinew.twin.simulate import simulate

__all__ = ["ENOUGH", "Confirmed", "Request", "confirm"]

ENOUGH = 0.03
"""Share by which the twin's resonance may be off the predicted one."""


class Request(NamedTuple):
    """A proposal to confirm, and the seed of the twin's scatter and noise."""

    proposal: Proposal
    seed: int


class Confirmed(NamedTuple):
    """One end of the band. predicted_hz, measured_hz: 90° of lag behind the measured lever, at the plan's command;
    peak_hz: of the measured gain. yaw_deg: half of peak to peak at that peak. error: share by which measured is off."""

    pretension_mm: float
    predicted_hz: float
    measured_hz: Estimate
    peak_hz: Estimate
    yaw_deg: float
    error: float


def confirm(request: Request) -> tuple[Confirmed, ...]:
    """Return what the full twin, with sensors, scatter and noise, says of a proposal at both ends of the band.

    Its plan runs with one repeat; the recording is analysed as one of a bench would be.
    """
    configure()
    proposal, seed = request
    plan = _once(plan_of(proposal))
    assert plan.sweep is not None
    results = analyse_recording(simulate(plan, proposal.rig, seed=seed), proposal.rig)
    swing = Swing(command_deg=plan.sweep.amplitude_deg)
    pretensions = plan.pretension.pretension_mm
    band = 0.75 * plan.sweep.frequency_hz[0], 1.2 * plan.sweep.frequency_hz[-1]
    predicted = find_resonances(proposal.rig, pretensions, swing, band_hz=band)
    told = []
    for i, (mm, one) in enumerate(zip(pretensions, predicted, strict=True)):
        at = results.isel(pretension_mm=i)
        measured, peak = (_estimate(at, name) for name in ("phase_90_hz", "resonance_hz"))
        wanted = math.nan if one is None else one.frequency_hz
        yaw = float(at["gain_peak"]) * plan.sweep.amplitude_deg
        told.append(Confirmed(mm, wanted, measured, peak, yaw, measured.value / wanted - 1))
    return tuple(told)


def _estimate(at: xr.Dataset, name: str) -> Estimate:
    stem = name.removesuffix("_hz")
    return Estimate(*(float(at[key]) for key in (name, f"{stem}_std_hz", f"{stem}_low_hz", f"{stem}_high_hz")))


def _once(plan: Plan) -> Plan:
    """Return a plan whose sweep is measured once."""
    assert plan.sweep is not None
    return plan.model_copy(update={"sweep": plan.sweep.model_copy(update={"repeats": 1})})
