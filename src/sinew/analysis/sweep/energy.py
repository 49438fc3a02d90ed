"""What a swing costs, by a sweep: at resonance, against the trend off it, and where it costs least."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from sinew.analysis.signal.least_squares import solve_damped
from sinew.analysis.signal.motors import idle_power, rest_power, supply_uncertainty
from sinew.analysis.signal.repeats import combine_repeats, interval_variables
from sinew.analysis.signal.signals import Signals
from sinew.analysis.sweep.resonance import alike, by_repeat, read_each
from sinew.analysis.sweep.response import Response
from sinew.measure.arrays import Array, mean_of_known
from sinew.measure.recording import ENERGY_QUANTITIES

# The current that a swing needs is parted into spring, inertia and what the two save each other.


FEWEST_POINTS = 6
"""Frequencies that a trend needs at least."""

_ROUNDS = 30
_BAND = (0.8, 1.25)


@dataclass(frozen=True)
class SwingTrend:
    """Squared current (root mean square) over squared torsion amplitude: s + n f⁴ - c f² + q/φ₁².

    spring s [A²/rad²], inertia n [A² s⁴/rad²], saved c [A² s²/rad²], friction q [A²]; none is negative.
    saved_std: of c, from the residual. misfit: root mean square of the residual over the trend.
    """

    spring: float
    inertia: float
    saved: float
    friction: float
    saved_std: float
    misfit: float

    def squared_saving(self, frequency_hz: Array) -> Array:
        """Return c f² [A²/rad²]: by how much spring and inertia together need less than each for itself."""
        return self.saved * frequency_hz**2


def fit_swing_trend(frequency_hz: Array, current_a: Array, torsion_rad: Array) -> SwingTrend | None:
    """Return the trend of the current that a swing of the head needs; None with fewer than six usable frequencies.

    frequency_hz, current_a (root mean square), torsion_rad (amplitude): shape (f,); what is not finite is left out.

    Away from resonance the drive's torque fights the spring or the inertia: per swing it is a constant, or goes with
    f². Both are in antiphase, so that torque squared holds s + n f⁴ and twice their product with a minus: what the two
    save each other, which is all there is to resonance. For a linear viscous joint this form is exact. Coulomb
    friction adds a current of its own, whatever the swing: q/φ₁².
    Non-negative least squares, with the deviations taken relative to the trend s + n f⁴ + q/φ₁², so that the flanks
    and the resonance count alike.
    """
    valid = np.isfinite(frequency_hz) & np.isfinite(current_a) & np.isfinite(torsion_rad) & (torsion_rad > 0)
    if valid.sum() < FEWEST_POINTS:
        return None
    f, swing = frequency_hz[valid], torsion_rad[valid]
    wanted = (current_a[valid] / swing) ** 2
    design = np.stack([np.ones_like(f), f**4, -(f**2), swing**-2], axis=1)
    without = wanted
    terms = np.zeros(4)
    for _ in range(_ROUNDS):
        weight = 1.0 / without
        scale = np.linalg.norm(design * weight[:, None], axis=0)
        terms = scipy.optimize.nnls(design * weight[:, None] / scale, wanted * weight)[0] / scale
        moved = wanted + terms[2] * f**2
        if (np.abs(moved - without) <= 1e-8 + 1e-9 * without).all():
            break
        without = moved
    residual = (wanted - design @ terms) / without
    used = terms > 0
    weighted = design[:, used] / without[:, None]
    freedom = max(1, f.size - int(used.sum()))
    covariance = np.linalg.pinv(weighted.T @ weighted) * float(residual @ residual) / freedom
    last = int(used[:2].sum())
    std = float(np.sqrt(covariance[last, last])) if used[2] else 0.0
    spring, inertia, saved, friction = map(float, terms)
    return SwingTrend(spring, inertia, saved, friction, std, float(np.sqrt(np.mean(residual**2))))


@dataclass(frozen=True)
class LineTrend:
    """A straight line a + b f through the current off resonance: intercept [A], slope [A/Hz]."""

    intercept: float
    slope: float

    def current(self, frequency_hz: float) -> float:
        """Return the line at a frequency [A]."""
        return self.intercept + self.slope * frequency_hz


def fit_line_trend(frequency_hz: Array, current_a: Array, resonance_hz: float) -> LineTrend | None:
    """Return the paper's linear increase: a line by least squares through what was measured off resonance.

    Off resonance: outside 0.8 to 1.25 times the resonance. None where fewer than two frequencies lie on either side.
    """
    valid = np.isfinite(frequency_hz) & np.isfinite(current_a)
    f, current = frequency_hz[valid], current_a[valid]
    below, above = f < _BAND[0] * resonance_hz, f > _BAND[1] * resonance_hz
    if not np.isfinite(resonance_hz) or below.sum() < 2 or above.sum() < 2:
        return None
    off = below | above
    slope, intercept = np.polyfit(f[off], current[off], 1)
    return LineTrend(float(intercept), float(slope))


_FINE = 4001
_FROM_POWER = tuple(
    name
    for name in ENERGY_QUANTITIES
    if name.endswith(("_w", "_j", "_j_rad2")) and not name.startswith(("copper", "mechanical"))
)
_FROM_TREND = (
    "trend_cost_at_resonance_j_rad2",
    "energy_reduction",
    "energy_reduction_with_holding",
    "current_reduction",
    "break_even_rad",
    "cheapest_reduction",
)
_NEEDED = ("drive_power_w", "drive_copper_w", "drive_mechanical_w", "drive_current_rms_a", "amplitude_rad")
_READ = (*_NEEDED, "holding_power_w", "drive_power_std_w")


def cost_of_swing(power_w: Array, frequency_hz: Array, torsion_rad: Array) -> Array:
    """Return the energy per cycle for one radian of torsion amplitude [J/rad²], elementwise: P/(f φ₁²)."""
    return np.asarray(power_w / (frequency_hz * torsion_rad**2))


def estimate_energy(signals: Signals, response: Response, resonance_hz: Array) -> xr.Dataset | None:
    """Return the energy part of the results, over pretension with `_std`, `_low`, `_high`; None where nothing is known.

    resonance_hz: of every pretension and repeat, (p, r): by nominal drive. Each repeat is read at its own resonance;
    repeats are combined by Student's t. What they share is added: the voltage's uncertainty, how far two readings
    between the measured frequencies differ, and what the trend's residual leaves open. The attribute
    `idle_power_w` is what all servos draw with their torque off, by data sheet.
    docs/explanation/energy.md says what each number means.
    """
    columns, rig = response.columns, signals.rig
    if rig is None or not np.isfinite(columns["drive_power_w"]).any():
        return None
    shape = resonance_hz.shape
    mine = {name: by_repeat(columns[name]) for name in _READ}
    found = energy_of_repeats(response.frequency_hz, mine, resonance_hz.ravel(), rig.drive.resistance)
    value, std, misfit = ({name: rows[i].reshape(shape) for name, rows in found.items()} for i in range(3))
    for (pretension, repeat), watts in rest_power(signals, rig).items():
        rows = np.flatnonzero(response.pretension_mm == pretension)
        if rows.size and repeat < shape[1]:
            value["rest_power_w"][rows[0], repeat], std["rest_power_w"][rows[0], repeat] = watts
    volts = _of_voltage(value, supply_uncertainty(signals.recorded.get("supply_v"), rig))
    variables: dict[str, xr.Variable] = {}
    for name in ENERGY_QUANTITIES:
        grid = np.hypot(mean_of_known(misfit[name], 0.0), volts.get(name, 0.0))
        alone = np.isfinite(value[name]).sum(axis=1) == 1  # its own deviation holds the trend's already
        of_trend = np.where(alone | (name not in _FROM_TREND), 0.0, mean_of_known(std[name], 0.0))
        shared = np.hypot(grid, of_trend)
        variables |= interval_variables(name, combine_repeats(value[name], std[name], np.inf, shared))
    return xr.Dataset(variables, attrs={"idle_power_w": idle_power(rig)})


def _of_voltage(value: Mapping[str, Array], volts: float) -> dict[str, Array]:
    """Return the standard uncertainties from that of the voltage (relative), each (p,); repeats share them."""
    shared = {name: volts * np.abs(mean_of_known(value[name], 0.0)) for name in _FROM_POWER}
    shared["gear_at_resonance_w"] = volts * mean_of_known(value["drive_power_at_resonance_w"], 0.0)
    for name in ("energy_reduction", "energy_reduction_with_holding", "cheapest_reduction"):
        left = 1.0 - mean_of_known(value[name], 0.0)
        shared[name] = volts * np.abs(left * (1.0 - left))
    return shared


def energy_of_repeats(
    frequency_hz: Array, columns: Mapping[str, Array], resonance_hz: Array, resistance: float
) -> dict[str, Array]:
    """Return (value, standard deviation, misfit) of the energy quantities of k sweeps, (3, k), by name; NaN for absent.

    frequency_hz: shape (f,). columns: of the result schema, each (k, f), NaN left out. resonance_hz: shape (k,).
    resistance: of the drive [Ω]. Between measured frequencies a cubic spline is read. misfit: how far another reading
    lies, which says how much the grid leaves open: Akima's spline, and a parabola through the five points around the
    cheapest.
    """
    out = {name: np.full((3, resonance_hz.size), np.nan) for name in ENERGY_QUANTITIES}
    needed = np.isfinite([columns[name] for name in _NEEDED]).all(axis=0) & (columns["amplitude_rad"] > 0)
    moved = (np.where(needed, columns["drive_power_w"], 0.0) != 0.0).any(axis=1)  # or a lever that no servo moved
    for alike_rows, valid in alike(needed):
        rows = alike_rows[moved[alike_rows]]
        if valid.sum() < FEWEST_POINTS or not rows.size:
            continue
        f, at = frequency_hz[valid], resonance_hz[rows]
        mine = {name: columns[name][np.ix_(rows, valid)] for name in _READ}
        off = _off_resonance(f, mine["drive_current_rms_a"], mine["amplitude_rad"], at, resistance)
        found, other = (_energies(_Sweeps(f, mine, second), at, off) for second in (False, True))
        for name, (value, std) in found.items():
            out[name][:, rows] = value, std, np.abs(value - other[name][0])
    return out


class _OffResonance(NamedTuple):
    """What k sweeps say off resonance, (k,) each: what spring and inertia save each other, as squared current and as
    power [A² s²/rad², W s²/rad²], both with their standard deviations, and the paper's line at the resonance [A]."""

    current: Array
    current_std: Array
    power: Array
    power_std: Array
    line: Array


def _off_resonance(f: Array, current: Array, torsion: Array, resonance_hz: Array, resistance: float) -> _OffResonance:
    found = np.full((3, resonance_hz.size), np.nan)
    for row, at in enumerate(resonance_hz.tolist()):
        trend, line = fit_swing_trend(f, current[row], torsion[row]), fit_line_trend(f, current[row], at)
        assert trend is not None, "there are frequencies enough"
        found[:, row] = trend.saved, trend.saved_std, np.nan if line is None else line.current(at)
    saved, saved_std, expected = found
    return _OffResonance(saved, saved_std, resistance * saved, resistance * saved_std, expected)


@dataclass(frozen=True)
class _Sweeps:
    """Columns of k sweeps by name, (k, f), all finite where they are needed."""

    f: Array
    columns: Mapping[str, Array]
    second: bool

    def at(self, name: str, where: Array) -> Array:
        """Return a column of each sweep at a frequency of its own, (k,), NaN outside the sweep."""
        return read_each(self.f, self.columns[name], where, "akima" if self.second else "cubic")

    def power(self, where: Array) -> tuple[Array, Array, Array]:
        """Return electrical power, its standard deviation, and torsion amplitude at frequencies, (k,) each."""
        own = read_each(self.f, np.nan_to_num(self.columns["drive_power_std_w"]), where, "line")
        return self.at("drive_power_w", where), own, self.at("amplitude_rad", where)

    def cheapest(self) -> Array:
        """Return the frequencies of the least energy per cycle and squared swing [Hz], NaN at the edge of the sweep."""
        cost = np.log(cost_of_swing(self.columns["drive_power_w"], self.f, self.columns["amplitude_rad"]))
        if self.second:
            least = np.argmin(cost, axis=1)
            near = least[:, None] + np.arange(-2, 3)
            there, near = (near >= 0) & (near < self.f.size), near.clip(0, self.f.size - 1)
            away = self.f[near] - self.f[least][:, None]
            powers = np.stack([away**2, away, np.ones_like(away)], axis=2) * there[:, :, None]
            bend, slope, _ = solve_damped(powers, np.take_along_axis(cost, near, axis=1) * there, 1e-26).T
            return np.where(bend > 0, self.f[least] - 0.5 * slope / np.where(bend > 0, bend, 1.0), np.nan)
        fine = np.linspace(self.f[0], self.f[-1], _FINE)
        lowest = np.argmin(scipy.interpolate.CubicSpline(self.f, cost, axis=1)(fine), axis=1)
        return np.where((lowest > 0) & (lowest < _FINE - 1), fine[lowest], np.nan)


def _reduction(power: Array, own: Array, saving: Array, saving_std: Array) -> tuple[Array, Array]:
    """Return 1 - P/(P + S) and its standard deviation."""
    whole = power + saving
    return saving / whole, np.hypot(saving * own, power * saving_std) / whole**2


def _energies(sweeps: _Sweeps, where: Array, off: _OffResonance) -> dict[str, tuple[Array, Array]]:
    """Return (value, standard deviation) of the energy quantities by name, (k,) each. where: the resonances [Hz]."""
    power, own, swing = sweeps.power(where)
    copper, mechanical = sweeps.at("drive_copper_w", where), sweeps.at("drive_mechanical_w", where)
    current, holding = sweeps.at("drive_current_rms_a", where), sweeps.at("holding_power_w", where)
    relative, exact, square = own / power, np.zeros_like(power), where**2 * swing**2
    per_cycle = where * swing**2
    out = {
        "drive_power_at_resonance_w": (power, own),
        "copper_at_resonance_w": (copper, copper * relative),
        "gear_at_resonance_w": (power - copper - mechanical, own),
        "mechanical_at_resonance_w": (mechanical, mechanical * relative),
        "holding_at_resonance_w": (holding, exact),
        "energy_per_cycle_at_resonance_j": (power / where, own / where),
        "swing_cost_at_resonance_j_rad2": (power / per_cycle, own / per_cycle),
    }
    saving, saving_std = off.power * square, off.power_std * square
    total = np.sqrt(current**2 + off.current * square)
    less = 1.0 - (power + holding) / (power + saving)
    spread = np.hypot((saving - holding) * own, (power + holding) * saving_std) / (power + saving) ** 2
    evens = (saving > 0) & (holding >= 0)
    held, saves = np.where(evens, holding, np.nan), np.where(evens, saving, np.nan)
    even = swing * np.sqrt(held / saves)
    out |= {
        "trend_cost_at_resonance_j_rad2": ((power + saving) / per_cycle, np.hypot(own, saving_std) / per_cycle),
        "energy_reduction": _reduction(power, own, saving, saving_std),
        "current_reduction": (1.0 - current / total, 0.5 * current * square * off.current_std / total**3),
        "energy_reduction_with_holding": (less, spread),
        "break_even_rad": (even, 0.5 * even * saving_std / saves),
    }
    cheapest = sweeps.cheapest()
    least, own, swing = sweeps.power(cheapest)
    square, per_cycle = cheapest**2 * swing**2, cheapest * swing**2
    known_power = np.isfinite(power) | np.isfinite(cheapest)
    return out | {
        "cheapest_hz": (cheapest, exact),
        "swing_cost_at_cheapest_j_rad2": (least / per_cycle, own / per_cycle),
        "cheapest_reduction": _reduction(least, own, off.power * square, off.power_std * square),
        "line_current_a": (np.where(known_power, off.line, np.nan), exact),
        "line_reduction": (1.0 - current / off.line, exact),
    }
