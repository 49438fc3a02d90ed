"""A campaign as one small JSON document: curves over pretension, resonances, windows, and the paper's table."""

import math
from typing import Any

import jax
import numpy as np
import xarray as xr

from sinew.analysis.decay.decay_windows import decay_windows, describe_windows
from sinew.analysis.decay.ring_down import DECAY_FROM_PERIODS, paper_envelope
from sinew.analysis.sweep.resonance import MEANINGS, estimate_resonance, resonance_table
from sinew.analysis.sweep.response import estimate_response
from sinew.figures.motion import rig_of
from sinew.measure.arrays import mean_and_spread
from sinew.measure.errors import SinewError
from sinew.measure.estimate import all_finite, finite
from sinew.measure.schema import ENERGY_QUANTITIES, companions
from sinew.paper.table import paper_table
from sinew.plan.plan import Group, Plan, Pretension, RingDown, Sweep
from sinew.plan.rig import RigSpec
from sinew.solve.march import Track
from sinew.twin.parameters import Effects
from sinew.twin.sensors import read_gyro
from sinew.twin.simulate import lane_parameters, record_tracks, simulate_tracks


def summarise(
    results: xr.Dataset,
    *,
    wall_s: float,
    simulated_s: float,
    beyond: xr.Dataset | None = None,
    rig: RigSpec | None = None,
) -> dict[str, Any]:
    """Return the content of summary.json; lists run over pretension, what could not be measured is null.

    beyond: results of a sweep above 12 mm. rig: the one in the attributes of the results where none is given.
    wall_s: time that the run took [s]; simulated_s: time on the rig's clock that it covers [s].
    `resonance_hz` and `gain` are the fundamental's, `paper_resonance_hz` and `paper_gain` Eq. 6's; `resonance` has all
    meanings side by side, `decay_windows` D over pretension by where the decay begins.
    `gain_std` and `resonance_hz_std` are standard deviations over repeats; ring-down numbers are means over repeats by
    the paper's method, `lehr_damping_std` their sample standard deviation.
    """
    has_sweep, has_decay = "resonance_hz" in results, "paper_lehr_damping" in results

    def column(name: str, factor: float = 1.0) -> list[float | None]:
        return all_finite(factor * results[name].values) if has_sweep else []

    windows = decay_windows(results)
    return {
        "pretension_mm": column("pretension_mm"),
        "resonance_hz": column("resonance_hz"),
        "resonance_hz_std": column("resonance_std_hz"),
        "gain": column("gain_peak"),
        "gain_std": column("gain_peak_std"),
        "paper_resonance_hz": column("paper_resonance_hz"),
        "paper_gain": column("paper_gain_peak"),
        "gain_measured_drive": column("gain_peak_measured_drive"),
        "phase_90_hz": column("phase_90_hz"),
        "drive_amplitude_deg_at_resonance": column("drive_amplitude_at_resonance_rad", 180 / math.pi),
        "energy": _energy(results),
        "ring_down": _ring_down(results) if has_decay else {name: [] for name in _RING_DOWN},
        "resonance": {"meanings": dict(MEANINGS) if has_sweep else {}, "rows": resonance_table(results)},
        "decay_windows": {"conclusion": describe_windows(windows), "rows": [window.to_json() for window in windows]},
        "paper": paper_table(results, beyond, rig if rig is not None else rig_of(results)),
        "wall_s": float(wall_s),
        "simulated_s": float(simulated_s),
    }


_RING_DOWN = ("pretension_mm", "decay_rate_per_s", "omega_rad_s", "lehr_damping", "lehr_damping_std")


def _ring_down(results: xr.Dataset) -> dict[str, list[float | None]]:
    """Return the ring-down columns over the pretensions at which at least one decay was measured."""
    here = results.isel(pretension_mm=np.flatnonzero(np.isfinite(results["paper_lehr_damping"].values).any(axis=1)))
    damping, spread = mean_and_spread(here["paper_lehr_damping"].values)
    columns = (
        here["pretension_mm"].values,
        mean_and_spread(here["paper_decay_rate_per_s"].values)[0],
        mean_and_spread(here["paper_omega_rad_s"].values)[0],
        damping,
        spread,
    )
    return {name: all_finite(values) for name, values in zip(_RING_DOWN, columns, strict=True)}


def _energy(results: xr.Dataset) -> dict[str, Any]:
    """Return what a swing costs over pretension, and what the servos draw with their torque off; {} if not known."""
    if "energy_reduction" not in results:
        return {}
    idle = float(results.attrs.get("idle_power_w", math.nan))
    ends = [end for name in ("energy_reduction", "energy_reduction_with_holding") for end in companions(name)[1:]]
    columns = {name: all_finite(results[name].values) for name in (*ENERGY_QUANTITIES, *ends)}
    return {"idle_power_w": finite(idle), **columns}


# The share of each effect is measured: one short campaign on the twin, one effect off at a time.

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
    None where the sweep has no resonance, or a decay no peaks. Scatter and sensor noise are off; all rows run as one
    batch.
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
        resonance = estimate_resonance(estimate_response(recording, rig))
        decays = ((group, track) for group, track in zip(groups, own, strict=True) if group.kind == "ring-down")
        damping = {g.pretension_mm: paper_damping(track, g, rig, effects, plan.sample_hz) for g, track in decays}
        columns: dict[str, Any] = {
            "resonance_hz": resonance["resonance_hz"].values,
            "gain": resonance["gain_peak"].values,
            "damping": [damping[pretension] for pretension in SHARE_PRETENSIONS_MM],
        }
        told = {
            f"{column}_{pretension:g}": finite(float(values[i]))
            for column, values in columns.items()
            for i, pretension in enumerate(SHARE_PRETENSIONS_MM)
        }
        rows.append({"effect": name, **told})
    return rows


def paper_damping(track: Track, group: Group, rig: RigSpec, effects: Effects, hz: float) -> float:
    """Return D of one simulated ring-down, as the gyroscope has it, by the paper's method; NaN where there is none."""
    begin = group.sample_counts(hz)[0]
    rng = np.random.default_rng(0)
    starts = np.zeros(1, dtype=np.intp)
    low, rate, true = (np.outer(along, [1.0, 0.0, 0.0]) for along in (track.gyro, track.gyro_rate, track.torsion_rate))
    gyro = read_gyro(low, rate, true, starts, hz, rig.imu, effects, rng)[begin:, 0]
    time = np.arange(gyro.size) / hz
    try:
        return paper_envelope(time, gyro, free_from_s=DECAY_FROM_PERIODS / group.frequency_hz).lehr_damping
    except SinewError:
        return math.nan
