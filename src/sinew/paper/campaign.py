"""A campaign as one small JSON document: curves over pretension, resonances, windows, and the paper's table."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, TypedDict

import jax
import numpy as np
import xarray as xr

from sinew.analysis.decay.paper_method import decay_windows, describe_windows
from sinew.analysis.decay.ring_down import DECAY_FROM_PERIODS, paper_envelope
from sinew.analysis.sweep.resonance import MEANINGS, estimate_resonance, resonance_table
from sinew.analysis.sweep.response import FEWEST_PRETENSIONS, estimate_response, fit_saturation
from sinew.figures.motion import rig_of
from sinew.measure.arrays import Array, mean_and_spread
from sinew.measure.errors import SinewError
from sinew.measure.estimate import all_finite, finite
from sinew.measure.recording import ENERGY_QUANTITIES, companions
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
        changes = {
            f"{column}_{pretension:g}": finite(float(values[i]))
            for column, values in columns.items()
            for i, pretension in enumerate(SHARE_PRETENSIONS_MM)
        }
        rows.append({"effect": name, **changes})
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


# ---- The paper's numbers beside the measured ones: tolerance and its reason, role, and place in the paper.
#
# A row is worth what it could have missed. One that the calibration aims at, or that only repeats an input, says so in
# its role; one whose tolerance nothing could leave does not stand here. What the twin misses stands here as well.


Role = Literal["fitted", "input", "follows"]


class Row(TypedDict):
    """One line of the table: a quantity, the paper's number, ours (None where it could not be measured), and whether
    they agree within the tolerance. Counts and rank correlations stand for statements without a number.

    role: what agreement is worth: the rig was fitted to it (`sinew.paper.numbers.TARGETS`), it is one of its inputs, or
    it follows. Nothing counts as fitted on a rig without a calibrated parameter. reason: of the tolerance, a sentence.
    """

    quantity: str
    paper: float
    measured: float | None
    tolerance: float
    ok: bool
    where: str
    role: Role
    reason: str


def is_the_papers(results: xr.Dataset, rig: RigSpec | None) -> bool:
    """Return whether results have to do with the paper: the rig is named `paper` and no file of others was imported."""
    return rig is not None and rig.name == "paper" and results.attrs.get("source") != "import"


_THRESHOLD_MM = 12.0


def count_roles(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return how many rows are met, and how many of those that neither were fitted nor are inputs; one sentence."""
    free = [row for row in rows if row["role"] == "follows"]
    met, follow = (sum(bool(row["ok"]) for row in some) for some in (rows, free))
    fitted, put_in = (sum(row["role"] == role for row in rows) for role in ("fitted", "input"))
    parts = [f"{fitted} were fitted"] if fitted else []
    parts += [f"{put_in} are inputs"] if put_in else []
    worth = f"; {' and '.join(parts)}, of the {len(free)} that follow {follow} are met" if parts else ""
    return f"{met} of {len(rows)} rows within tolerance{worth}"


def paper_table(results: xr.Dataset, beyond: xr.Dataset | None = None, rig: RigSpec | None = None) -> list[Row]:
    """Return the rows for which the data hold the parts: sweep, ring-downs, a sweep above 12 mm, and the rig.

    There are none for a rig other than the paper's, or for an imported recording (`is_the_papers`).
    Trends are counted on means over repeats, without regard to their spread.
    results: of the campaign. beyond: of a sweep at pretensions above 12 mm. rig: for Eq. 5, and for the roles.
    Resonance and gain are Eq. 6's (`paper_resonance_hz`, `paper_gain_peak`).
    A part that is there but could not be measured (NaN) gives a row that is not ok.
    """
    if rig is None or not is_the_papers(results, rig):
        return []
    has_sweep, results = "resonance_hz" in results, results.sortby("pretension_mm")
    rows = [*_ends(results), *_trends(results)] if has_sweep else []
    rows += _damping(results) if "paper_lehr_damping" in results else []
    rows += _drive(results) if has_sweep else []
    if beyond is not None and "paper_gain_peak" in beyond and "paper_gain_peak" in results:
        rows += _bounded(results, beyond)
    rows += _bare_silicone(rig)
    if not any(parameter.origin == "calibrated" for _, parameter in rig.parameters()):
        for row in rows:
            row["role"] = "follows" if row["role"] == "fitted" else row["role"]
    return rows


def _row(
    quantity: str,
    paper: float,
    measured: float,
    tolerance: float,
    where: str,
    reason: str,
    role: Role = "follows",
) -> Row:
    """Return a row; it is ok where measured is within the tolerance of paper."""
    ok = bool(abs(measured - paper) <= tolerance * (1 + 1e-9))
    return Row(
        quantity=quantity,
        paper=paper,
        measured=finite(float(measured)),
        tolerance=tolerance,
        ok=ok,
        where=where,
        role=role,
        reason=reason,
    )


_COUNT = "a trend has no exception"


def _ends(results: xr.Dataset) -> Iterator[Row]:
    """Yield resonance and gain at the ends of the range."""
    where, hertz = (
        "Abstract; section 4.1, Figure 6 left",
        "printed to 0.1 Hz, read off a frequency grid that is not printed",
    )
    stated = (
        ("paper_resonance_hz", "resonance frequency at {:g} mm in Hz", 0.0, 3.0, 0.1, hertz),
        ("paper_resonance_hz", "resonance frequency at {:g} mm in Hz", 12.0, 4.3, 0.1, hertz),
        ("paper_gain_peak", "gain at resonance at {:g} mm", 0.0, 2.8, 0.15, _GAIN),
        ("paper_gain_peak", "gain at resonance at {:g} mm", 12.0, 1.4, 0.1, _GAIN),
    )
    for name, quantity, at, said, tolerance, reason in stated:
        for measured in results[name].values[np.isclose(results["pretension_mm"].values, at)][:1]:
            yield _row(quantity.format(at), said, measured, tolerance, where, reason, "fitted")


_GAIN = "printed to 0.1, mean of five periods and three repeats"


def _trends(results: xr.Dataset) -> Iterator[Row]:
    resonance, gain = (results[name].values for name in ("paper_resonance_hz", "paper_gain_peak"))
    if resonance.size > 1:
        where, steps = "Section 4.1, Figures 6 and 8", "steps of pretension at which the"
        yield _row(f"{steps} resonance does not rise", 0, _not_rising(resonance), 0, where, _COUNT)
        yield _row(f"{steps} gain does not fall", 0, _not_rising(-gain), 0, where, _COUNT)
    gap = float(np.abs(results["phase_90_hz"].values - resonance).max())
    text = "largest distance between 90° crossing and resonance in Hz"
    reason = "as for the resonance itself: the paper reads both off one grid"
    yield _row(text, 0, gap, 0.1, "Section 4.1, Figure 6 right", reason, "fitted")


_CONSTANT = 0.15
"""Half of what a constant damping constant d would make of D = d/(2ωI) from 3.0 to 4.3 Hz: (1 - 3.0/4.3)/2. A D that
changes by more is not told from that law by the words "approximately constant"."""


def _damping(results: xr.Dataset) -> Iterator[Row]:
    known = np.flatnonzero(np.isfinite(results["paper_lehr_damping"].values).any(axis=1))
    if known.size < 2:
        return
    rate, omega, damping = (
        mean_and_spread(results[name].values[known])[0]
        for name in ("paper_decay_rate_per_s", "paper_omega_rad_s", "paper_lehr_damping")
    )
    where, windows = "Section 4.2, Figure 10", decay_windows(results)
    steps, anywhere = "steps of pretension at which", ", wherever the decay begins" if windows else ""
    fallen = max([_not_rising(rate), *(float(window.falling_rates) for window in windows)])
    yield _row(f"{steps} λ does not rise{anywhere}", 0, fallen, 0, where, _COUNT)
    yield _row(f"{steps} ⟨ω⟩ does not rise", 0, _not_rising(omega), 0, where, _COUNT)
    spread = float((damping.max() - damping.min()) / damping.mean())
    reason = "half of what a constant d would make of D between 3.0 and 4.3 Hz"
    begun = f"from {DECAY_FROM_PERIODS:g} drive period after the stop on"
    text = f"spread of Lehr's damping D over pretension {begun}, (max − min) / mean"
    yield _row(text, 0, spread, _CONSTANT, where, reason, "fitted")
    if windows:
        starts = f"{windows[0].start_periods:g} to {windows[-1].start_periods:g}"
        text = f"largest spread of D over pretension, wherever the decay begins ({starts} drive periods after the stop)"
        yield _row(text, 0, max([spread, *(one.spread for one in windows)]), _CONSTANT, where, reason)


_LISSAJOUS_MM = 4.0


def _drive(results: xr.Dataset) -> Iterator[Row]:
    reason, where = "one pair in twenty in the wrong order", "Section 4.1, Figure 7; section 5.2.5"
    by_resonance = results.isel(pretension_mm=np.argsort(results["paper_resonance_hz"].values))
    amplitude = by_resonance["drive_amplitude_at_resonance_rad"].values
    if amplitude.size > 1:
        if not np.isfinite(results["paper_resonance_hz"].values).all():
            amplitude = np.full(amplitude.size, np.nan)
        text = (
            "Kendall's τ of the drive amplitude at resonance over frequency "
            "(-1: each pair falls; the last below the first)"
        )
        row = _row(text, -1, _concordance(amplitude), 0.1, where, reason)
        row["ok"] = row["ok"] and bool(amplitude[-1] < amplitude[0])
        yield row
    for here in np.flatnonzero(np.isclose(results["pretension_mm"].values, _LISSAJOUS_MM))[:1]:
        sweep = mean_and_spread(results["drive_amplitude_rad"].values[here])[0]
        sweep = sweep[np.argsort(results["frequency_hz"].values)]
        text = f"Kendall's τ of the drive amplitude over frequency at {_LISSAJOUS_MM:g} mm (-1: each pair falls)"
        yield _row(text, -1, _concordance(sweep[np.isfinite(sweep)]), 0.1, where, reason)


def _bounded(results: xr.Dataset, beyond: xr.Dataset) -> Iterator[Row]:
    """Yield what the paper says of the gain above its threshold: that it stays at one, and that this begins there."""
    parts = [[part[name].values for part in (results, beyond)] for name in ("pretension_mm", "paper_gain_peak")]
    x, y = (np.concatenate(part) for part in parts)
    if not (parts[0][1] > _THRESHOLD_MM).any():
        return
    far, where = int(np.argmax(parts[0][1])), "Section 4.1; section 5.2.4"
    text = f"gain at resonance far above the threshold, at {float(parts[0][1][far]):g} mm"
    reason = "as for the gain at 12 mm; the paper says “bounded to a value of one”"
    yield _row(text, 1, float(parts[1][1][far]), 0.1, where, reason)
    if x.size >= FEWEST_PRETENSIONS:
        order, known = np.argsort(x), bool(np.isfinite(y).all())
        kink = fit_saturation(x[order], y[order]).threshold_mm.value if known else math.nan
        text = "pretension from which on the gain levels off in mm (kink of two straight lines)"
        reason = "“≈ 12 mm”; the other pretensions that it names lie 2 mm and more away"
        yield _row(text, _THRESHOLD_MM, kink, 2.0, where, reason)


def _bare_silicone(rig: RigSpec) -> list[Row]:
    stiffness = rig.silicone.stiffness(0.0)
    frequency = math.sqrt(stiffness / (rig.inertia.head.value + rig.inertia.lever.value)) / (2 * math.pi)
    text, where = "stiffness k = G J / L of the bare silicone in N m/rad", "Section 2, Equation 5"
    reason = "printed to 0.001; an input, which only a change of the rig could miss"
    rows = [_row(text, 3.052, stiffness, 0.001, where, reason, "input")]
    text = "frequency of the bare silicone, √(k/I)/2π, in Hz (the joint with tendons: 3.0 Hz)"
    reason = "computed from what is printed; an input"
    return [*rows, _row(text, 2.46, frequency, 0.01, "From Equations 4 and 5", reason, "input")]


def _not_rising(values: Array) -> float:
    """Return the number of steps that do not rise, NaN where a value is missing."""
    return float((np.diff(values) <= 0).sum()) if np.isfinite(values).all() else math.nan


def _concordance(values: Array) -> float:
    """Return Kendall's rank correlation of values with their order, (rising - falling pairs) / pairs, or NaN."""
    if not np.isfinite(values).all():
        return math.nan
    upper = np.triu_indices(values.size, 1)
    return float(np.sign(values[upper[1]] - values[upper[0]]).mean())
