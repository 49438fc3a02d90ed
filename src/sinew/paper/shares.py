"""This is where the share of each effect is measured: one short campaign on the twin, one effect off at a time."""

import math
from typing import Any

import jax
import numpy as np
import xarray as xr

from sinew.analysis.analysis import analyse_recording
from sinew.plan.plan import Plan, Pretension, RingDown, Sweep
from sinew.plan.rig import RigSpec
from sinew.twin.parameters import Effects
from sinew.twin.simulate import lane_parameters, record_tracks, simulate_tracks

__all__ = ["SHARES", "SHARE_PRETENSIONS_MM", "effect_shares", "shares_plan"]

SHARE_PRETENSIONS_MM = (0.0, 12.0)
"""Both ends of the paper's range."""

SHARES: dict[str, tuple[str, ...]] = {
    "all effects": (),
    "silicone without loss": ("silicone_loss",),
    "guides without friction": ("guide_friction",),
    "tendons held at constant tension": ("length_locking",),
    "head that cannot sink": ("axial_motion",),
    "drive without duty limit": ("drive_saturation",),
    "stopped lever locked to the head": ("drive_recoil",),
}
"""What is switched off, in the reader's words."""


def shares_plan() -> Plan:
    """Return the short campaign: both ends of the paper's pretension range, a coarse grid, one repeat.

    The report says so above the table, in words of its own.
    """
    return Plan(
        name="shares",
        pretension=Pretension(pretension_mm=SHARE_PRETENSIONS_MM),
        sweep=Sweep(frequency_hz=tuple(np.round(np.arange(2.2, 5.25, 0.15), 2)), repeats=1),
        ring_down=RingDown(frequency_hz=(3.0, 4.3), repeats=1),
    )


def effect_shares(rig: RigSpec) -> list[dict[str, Any]]:
    """Return one row for each entry of `SHARES`: resonance, gain and damping at the two pretensions.

    Keys: effect, and resonance_hz, gain (nominal drive), damping (paper's D), each with the suffix _0 and _12 [mm];
    None where the sweep has no resonance. Scatter and sensor noise are off; all rows run as one batch.
    """
    plan = shares_plan()
    groups = plan.groups()
    quiet = Effects().without("repeatability", "sensor_noise", "stamp_jitter")
    cases = {name: quiet.without(*off) for name, off in SHARES.items()}
    lanes = [lane_parameters(groups, rig, effects=effects) for effects in cases.values()]
    stacked = jax.tree.map(lambda *leaves: np.concatenate(leaves), *lanes)
    tracks = simulate_tracks(stacked, groups * len(cases), plan.sample_hz)
    rows = []
    for index, (name, effects) in enumerate(cases.items()):
        own = tracks[index * len(groups) : (index + 1) * len(groups)]
        rng = np.random.default_rng(0)
        recording = record_tracks(own, lanes[index], plan, rig, effects=effects, rng=rng)
        rows.append({"effect": name, **_row(analyse_recording(recording, rig))})
    return rows


def _row(results: xr.Dataset) -> dict[str, float | None]:
    columns = {
        "resonance_hz": results["resonance_hz"].values,
        "gain": results["gain_peak"].values,
        "damping": results["paper_lehr_damping"].mean("repeat").values,
    }
    return {
        f"{name}_{pretension:g}": float(values[i]) if math.isfinite(values[i]) else None
        for name, values in columns.items()
        for i, pretension in enumerate(SHARE_PRETENSIONS_MM)
    }
