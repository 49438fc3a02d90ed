"""This is where the undetermined parameters of the paper's rig are calibrated against the paper's numbers.

    .venv/bin/python tools/calibrate_paper.py            fit, then write src/sinew/rigs/paper.toml
    .venv/bin/python tools/calibrate_paper.py --ranges   also how far each parameter can move (minutes)

The paper prints four numbers that fix the joint's mechanics (resonance and gain at pretension 0 and 12 mm) and some
trends (damping ratio about constant, 90° crossing at the peak). Ten parameters are free, so the fit is a maximum a
posteriori one: the paper's numbers with a third of their tolerance as standard deviation, each parameter with a
weak normal prior about what is thought likely. Everything random is absent: scatter and noise are off, and the same
command gives the same file.
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.signal import find_peaks

from sinew.analysis.envelope import fit_envelope
from sinew.measure.netcdf import write_atomically
from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_rig, load_rig
from sinew.twin.integrate import Track
from sinew.twin.simulate import lane_parameters, simulate_tracks

ROOT = Path(__file__).resolve().parents[1]
RIG = ROOT / "src/sinew/rigs/paper.toml"
RANGES = ROOT / "src/sinew/rigs/paper-ranges.json"
SAMPLE_HZ, AMPLITUDE_DEG = 200.0, 20.0
PRETENSION_MM = (0.0, 6.0, 12.0)
RESONANCE_HZ = (3.0, 3.65, 4.3)
TOTAL_INERTIA = 12.74e-3
Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Free:
    """A free parameter: dotted name, what is thought likely, and how firmly (standard deviation), in its unit."""

    name: str
    likely: float
    width: float


FREE = (
    Free("tendons.head_radius", 0.0278, 0.008),
    Free("tendons.first_contact_tension", 12.0, 8.0),
    Free("silicone.diameter", 0.058, 0.008),
    Free("silicone.loss_factor", 0.10, 0.06),
    Free("inertia.lever", 8.3e-3, 1.6e-3),
    Free("tendons.guide_friction", 4e-3, 4e-3),
    Free("tendons.presliding_angle", 0.3, 0.4),
    Free("drive.supply_voltage", 13.5, 1.0),
    Free("drive.armature", 0.0125, 0.006),
    Free("drive.friction", 0.25, 0.15),
)


@dataclass(frozen=True)
class Target:
    """A number of the paper: its value and the tolerance within which it is met."""

    name: str
    value: float
    tolerance: float


TARGETS = (
    Target("resonance_hz at 0 mm", 3.0, 0.1),
    Target("resonance_hz at 12 mm", 4.3, 0.1),
    Target("gain at 0 mm", 2.8, 0.15),
    Target("gain at 12 mm", 1.4, 0.1),
    Target("damping spread, 0 mm", 0.0, 0.06),
    Target("damping spread, 6 mm", 0.0, 0.06),
    Target("damping spread, 12 mm", 0.0, 0.06),
    Target("90 degree crossing minus peak at 0 mm, Hz", 0.0, 0.3),
    Target("90 degree crossing minus peak at 6 mm, Hz", 0.0, 0.3),
    Target("90 degree crossing minus peak at 12 mm, Hz", 0.0, 0.3),
)


def rig_with(base: RigSpec, values: Vector) -> RigSpec:
    """Return the rig with the free parameters at these values; base radius and head inertia follow."""
    settings = {free.name: float(value) for free, value in zip(FREE, values, strict=True)}
    settings["tendons.base_radius"] = settings["tendons.head_radius"]
    settings["inertia.head"] = TOTAL_INERTIA - settings["inertia.lever"]
    return base.with_values(settings, origin="calibrated")


def groups() -> list[Group]:
    """Return the reduced campaign: nine frequencies and one ring-down at three pretensions."""
    campaign = []
    for pretension, resonance in zip(PRETENSION_MM, RESONANCE_HZ, strict=True):
        for frequency in resonance + np.linspace(-0.8, 0.8, 9):
            campaign.append(Group("steady", pretension, float(frequency), AMPLITUDE_DEG, 0, 3.0, 5 / float(frequency)))
        stop = np.ceil(3.0 * resonance) / resonance
        campaign.append(Group("ring-down", pretension, resonance, AMPLITUDE_DEG, 0, float(stop), 3.0))
    return campaign


def observe(rigs: list[RigSpec]) -> NDArray[np.float64]:
    """Return what the paper measured, for every rig in one batch, shape (rig, target)."""
    campaign = groups()
    lanes = [lane_parameters(campaign, rig) for rig in rigs]
    stacked = jax.tree.map(lambda *leaves: np.concatenate(leaves), *lanes)
    tracks = simulate_tracks(stacked, campaign * len(rigs), SAMPLE_HZ)
    size = len(campaign)
    return np.array([_observe_one(campaign, tracks[i * size : (i + 1) * size]) for i in range(len(rigs))])


def _observe_one(campaign: list[Group], tracks: list[Track]) -> Vector:
    peaks, gains, crossings, damping = [], [], [], []
    for pretension in PRETENSION_MM:
        rows = [(g, t) for g, t in zip(campaign, tracks, strict=True) if g.pretension_mm == pretension]
        steady = [(g.frequency_hz, *_amplitudes(g, t)) for g, t in rows if g.kind == "steady"]
        frequency = np.array([row[0] for row in steady])
        response, drive = (np.array([row[k] for row in steady]) for k in (1, 2))
        curve = CubicSpline(frequency, np.abs(response) / np.radians(AMPLITUDE_DEG))
        fine = np.linspace(frequency[0], frequency[-1], 1601)
        peaks.append(fine[np.argmax(curve(fine))])
        gains.append(float(np.max(curve(fine))))
        lag = CubicSpline(frequency, -np.unwrap(np.angle(response / drive)))(fine)
        crossings.append(float(np.interp(np.pi / 2, lag, fine)))
        damping += [_lehr(g, t) for g, t in rows if g.kind == "ring-down"]
    spread = np.array(damping) / np.mean(damping) - 1
    return np.array([peaks[0], peaks[2], gains[0], gains[2], *spread, *(np.array(crossings) - peaks)])


def _amplitudes(group: Group, track: Track) -> tuple[complex, complex]:
    start, count = group.sample_counts(SAMPLE_HZ)
    time_s = np.arange(start, start + count) / SAMPLE_HZ
    angle = 2 * np.pi * group.frequency_hz * time_s
    design = np.stack([np.sin(angle), np.cos(angle), np.ones(count)], axis=1)
    solution = np.linalg.lstsq(design, np.stack([track.torsion[start:], track.lever[start:]], axis=1))[0]
    return complex(solution[0, 0], solution[1, 0]), complex(solution[0, 1], solution[1, 1])


def _lehr(group: Group, track: Track) -> float:
    """Return λ/⟨ω⟩ of a free decay by the paper's method, on the true torsion from one period after the stop.

    In that period the lever is still settling on its servo; the analysis of a recording leaves it out as well.
    """
    start, _ = group.sample_counts(SAMPLE_HZ)
    torsion = track.torsion[start + round(SAMPLE_HZ / group.frequency_hz) :]
    at, _ = find_peaks(np.abs(torsion), height=0.02 * float(np.abs(torsion).max()))
    if at.size < 4:
        return 1.0  # no oscillation to speak of: far outside the paper's numbers
    return fit_envelope(at / SAMPLE_HZ, np.abs(torsion[at])).lehr_damping


def scaled(base: RigSpec) -> tuple[Vector, Vector, Vector]:
    """Return (likely, width, bounds (2, free)) of the free parameters."""
    table = dict(base.parameters())
    bounds = np.array([table[free.name].bounds for free in FREE]).T
    return np.array([f.likely for f in FREE]), np.array([f.width for f in FREE]), bounds


def misfit(observed: Vector) -> Vector:
    """Return (observed - paper) in thirds of a tolerance; the last axis is the target."""
    value = np.array([t.value for t in TARGETS])
    return np.asarray((observed - value) * 3 / np.array([t.tolerance for t in TARGETS]))


class _MetError(Exception):
    """Raised inside a search as soon as the paper's numbers are met."""


def fit(
    base: RigSpec, start: Vector, fixed: dict[int, float] | None = None, *, steps: int = 15, prior: float = 1.0
) -> tuple[Vector, Vector]:
    """Return (values, observed) of the maximum a posteriori fit.

    fixed: parameters that are held, by index. prior: weight of the prior; below 1 the search also ends as soon as
    all of the paper's numbers are met.
    """
    likely, width, bounds = scaled(base)
    free = np.array([i for i in range(len(FREE)) if i not in (fixed or {})])
    values = np.clip(start, bounds[0], bounds[1])
    for i, value in (fixed or {}).items():
        values[i] = value
    best: list[Vector] = []

    def complete(x: Vector) -> Vector:
        whole = values.copy()
        whole[free] = np.clip(likely[free] + width[free] * x, bounds[0, free], bounds[1, free])
        return whole

    def residual(x: Vector) -> Vector:
        observed = observe([rig_with(base, complete(x))])[0]
        if prior < 1 and admissible(observed):
            best[:] = [complete(x), observed]
            raise _MetError
        return np.concatenate([misfit(observed), prior * x])

    def jacobian(x: Vector) -> NDArray[np.float64]:
        h = 0.02
        moved = [x + sign * h * row for row in np.eye(free.size) for sign in (1, -1)]
        seen = misfit(observe([rig_with(base, complete(m)) for m in moved]))
        return np.concatenate([((seen[0::2] - seen[1::2]) / (2 * h)).T, prior * np.eye(free.size)])

    low, high = (bounds[:, free] - likely[free]) / width[free]
    x0 = np.clip((values[free] - likely[free]) / width[free], low + 1e-6, high - 1e-6)
    try:
        solution = least_squares(residual, x0, jacobian, bounds=(low, high), max_nfev=steps, xtol=1e-3, ftol=1e-3)
    except _MetError:
        return best[0], best[1]
    final = complete(solution.x)
    return final, observe([rig_with(base, final)])[0]


def alone(base: RigSpec, values: Vector, index: int) -> tuple[float, float]:
    """Return how far one parameter can move with the others held, by bisection on whether the numbers are met."""
    _, _, bounds = scaled(base)

    def met(value: float) -> bool:
        return bool(admissible(observe([rig_with(base, np.where(np.arange(len(FREE)) == index, value, values))])[0]))

    return _edge(met, values[index], bounds[0, index], 7), _edge(met, values[index], bounds[1, index], 7)


def together(base: RigSpec, values: Vector, index: int) -> tuple[float, float]:
    """Return how far one parameter can move while the others are readjusted inside their bounds."""
    _, _, bounds = scaled(base)
    ends = []
    for bound in bounds[:, index]:
        last = values

        def met(value: float) -> bool:
            nonlocal last
            found, observed = fit(base, last, {index: value}, steps=8, prior=0.1)
            if admissible(observed):
                last = found
            return bool(admissible(observed))

        ends.append(_edge(met, values[index], float(bound), 4))
    return ends[0], ends[1]


def _edge(met: Callable[[float], bool], inside: float, bound: float, halvings: int) -> float:
    """Return the value nearest to `bound` for which `met` holds, by bisection from a value for which it does."""
    if met(bound):
        return float(bound)
    outside = bound
    for _ in range(halvings):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if met(middle) else (inside, middle)
    return float(inside)


def admissible(observed: Vector) -> NDArray[np.bool_]:
    """Return whether all of the paper's numbers are met, over the leading axes."""
    return np.asarray((np.abs(misfit(observed)) <= 3).all(axis=-1))


def find_ranges(base: RigSpec, values: Vector) -> dict[str, dict[str, object]]:
    """Return for each free parameter its value, bounds and both ranges, in its unit; prints as it goes."""
    _, _, bounds = scaled(base)
    table = dict(base.parameters())
    ranges: dict[str, dict[str, object]] = {}
    for index, free in enumerate(FREE):
        one, all_ = alone(base, values, index), together(base, values, index)
        ranges[free.name] = {
            "value": float(f"{values[index]:.6g}"),
            "unit": table[free.name].unit,
            "bounds": [float(bounds[0, index]), float(bounds[1, index])],
            "alone": [float(f"{v:.4g}") for v in one],
            "together": [float(f"{v:.4g}") for v in all_],
        }
        print(f"{free.name:32} alone {one[0]:.4g} .. {one[1]:.4g}, together {all_[0]:.4g} .. {all_[1]:.4g}", flush=True)
    return ranges


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def main() -> None:
    """Run the calibration."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ranges", action="store_true", help="also find how far each parameter can move")
    chosen = parser.parse_args()
    base = load_rig(str(RIG))
    likely, _, _ = scaled(base)
    values, observed = fit(base, likely)
    values = np.array([float(f"{value:.4g}") for value in values])
    observed = observe([rig_with(base, values)])[0]
    for free, value in zip(FREE, values, strict=True):
        print(f"{free.name:32} {value:.4g}")
    for target, number in zip(TARGETS, observed, strict=True):
        print(f"{target.name:42} paper {target.value:6.3f}  twin {number:7.4f}  tolerance {target.tolerance}")
    if not admissible(observed):
        raise SystemExit("the paper's numbers are not all met; nothing was written")
    text = dump_rig(rig_with(base, values))
    write_atomically(RIG, lambda path: _write(path, text))
    print(f"wrote {RIG}", flush=True)
    if chosen.ranges:
        ranges = find_ranges(base, values)
        write_atomically(RANGES, lambda path: _write(path, json.dumps(ranges, indent=1) + "\n"))
        print(f"wrote {RANGES}")


if __name__ == "__main__":
    main()
