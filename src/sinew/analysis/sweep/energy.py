"""What a swing costs, by a sweep: at resonance, against the trend off it, and where it costs least."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy
import xarray as xr
from scipy.optimize import nnls

from sinew.analysis.signal.power import idle_power, rest_power, supply_uncertainty
from sinew.analysis.signal.repeats import combine_repeats
from sinew.analysis.signal.signals import Signals
from sinew.analysis.sweep.resonance import interval_variables
from sinew.analysis.sweep.response import Response
from sinew.measure.arrays import Array, mean_of_known
from sinew.measure.schema import ENERGY_QUANTITIES

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
        terms = nnls(design * weight[:, None] / scale, wanted * weight)[0] / scale
        moved = wanted + terms[2] * f**2
        if np.allclose(moved, without, rtol=1e-9):
            break
        without = moved
    residual = (wanted - design @ terms) / without
    used = terms > 0
    weighted = design[:, used] / without[:, None]
    freedom = max(1, f.size - int(used.sum()))
    covariance = np.linalg.pinv(weighted.T @ weighted) * float(residual @ residual) / freedom
    place = int(used[:2].sum())
    std = float(np.sqrt(covariance[place, place])) if used[2] else 0.0
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
_READ = (*_NEEDED, "holding_power_w")


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
    value, std, misfit = ({name: np.full(shape, np.nan) for name in ENERGY_QUANTITIES} for _ in range(3))
    resistance = rig.drive.resistance
    for p, r in np.ndindex(*shape):
        mine = {name: columns[name][p, :, r] for name in (*_READ, "drive_power_std_w")}
        at = float(resonance_hz[p, r])
        found = energy_of_repeat(response.frequency_hz, mine, at, resistance)
        other = energy_of_repeat(response.frequency_hz, mine, at, resistance, second=True)
        for name, (number, own) in found.items():
            value[name][p, r], std[name][p, r] = number, own
            misfit[name][p, r] = abs(number - other[name][0]) if name in other else math.nan
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


def energy_of_repeat(
    frequency_hz: Array, columns: Mapping[str, Array], resonance_hz: float, resistance: float, *, second: bool = False
) -> dict[str, tuple[float, float]]:
    """Return (value, standard deviation) of the energy quantities of one sweep, by name; those that it cannot say fail.

    columns: of the result schema, each (f,). resistance: of the drive [Ω]. Between measured frequencies a cubic spline
    is read. second: the other reading, whose difference says how much the grid leaves open: Akima's spline, and a
    parabola through the five points around the cheapest.
    """
    valid = np.isfinite([columns[name] for name in _NEEDED]).all(axis=0) & (columns["amplitude_rad"] > 0)
    f = frequency_hz[valid]
    if f.size < FEWEST_POINTS or not columns["drive_power_w"][valid].any():  # or a lever that no servo moved
        return {}
    sweep = _Sweep(f, {name: values[valid] for name, values in columns.items()}, second)
    trend = fit_swing_trend(f, sweep.columns["drive_current_rms_a"], sweep.columns["amplitude_rad"])
    assert trend is not None, "there are frequencies enough"
    out = _at_resonance(sweep, resonance_hz)
    saved = (trend.saved, trend.saved_std)
    if out:
        out |= _against_trend(sweep, resonance_hz, resistance, saved)
    cheapest = sweep.cheapest()
    if math.isfinite(cheapest):
        power, own, swing = sweep.power(cheapest)
        saving = resistance * cheapest**2 * swing**2
        cost = power / (cheapest * swing**2)
        out["cheapest_hz"] = (cheapest, 0.0)
        out["swing_cost_at_cheapest_j_rad2"] = (cost, cost * own / power)
        out["cheapest_reduction"] = _reduction(power, own, saving * saved[0], saving * saved[1])
    line = fit_line_trend(f, sweep.columns["drive_current_rms_a"], resonance_hz)
    if line is not None and out:
        expected = line.current(resonance_hz)
        out["line_current_a"] = (expected, 0.0)
        out["line_reduction"] = (1.0 - sweep.at("drive_current_rms_a", resonance_hz) / expected, 0.0)
    return out


@dataclass(frozen=True)
class _Sweep:
    """Columns of one sweep by name, (f,), all finite where they are needed."""

    f: Array
    columns: Mapping[str, Array]
    second: bool = False

    @property
    def _curve(self) -> Any:
        return scipy.interpolate.Akima1DInterpolator if self.second else scipy.interpolate.CubicSpline

    @cached_property
    def _together(self) -> tuple[list[str], Callable[[float], Array]]:
        """Return the names of the columns known at all frequencies, and the one curve through them."""
        names = [name for name in _READ if np.isfinite(self.columns[name]).all()]
        return names, self._curve(self.f, np.stack([self.columns[name] for name in names], axis=1))

    def at(self, name: str, where: float) -> float:
        known = np.isfinite(self.columns[name])
        if known.sum() < 4 or not self.f[0] <= where <= self.f[-1]:
            return math.nan
        names, together = self._together
        if name in names:
            return float(together(where)[names.index(name)])
        return float(self._curve(self.f[known], self.columns[name][known])(where))

    def power(self, where: float) -> tuple[float, float, float]:
        """Return electrical power, its standard deviation, and torsion amplitude at a frequency."""
        own = float(np.interp(where, self.f, np.nan_to_num(self.columns["drive_power_std_w"])))
        return self.at("drive_power_w", where), own, self.at("amplitude_rad", where)

    def cheapest(self) -> float:
        """Return the frequency of the least energy per cycle and squared swing [Hz], NaN at the edge of the sweep."""
        cost = np.log(cost_of_swing(self.columns["drive_power_w"], self.f, self.columns["amplitude_rad"]))
        if self.second:
            least = int(np.argmin(cost))
            near = slice(max(0, least - 2), least + 3)
            bend, slope, _ = np.polyfit(self.f[near] - self.f[least], cost[near], 2)
            return float(self.f[least] - 0.5 * slope / bend) if bend > 0 else math.nan
        fine = np.linspace(self.f[0], self.f[-1], _FINE)
        place = int(np.argmin(scipy.interpolate.CubicSpline(self.f, cost)(fine)))
        return float(fine[place]) if 0 < place < _FINE - 1 else math.nan


def _reduction(power: float, own: float, saving: float, saving_std: float) -> tuple[float, float]:
    """Return 1 - P/(P + S) and its standard deviation."""
    whole = power + saving
    return saving / whole, math.hypot(saving * own, power * saving_std) / whole**2


def _at_resonance(sweep: _Sweep, where: float) -> dict[str, tuple[float, float]]:
    if not math.isfinite(where) or not sweep.f[0] <= where <= sweep.f[-1]:
        return {}
    power, own, swing = sweep.power(where)
    copper, mechanical = sweep.at("drive_copper_w", where), sweep.at("drive_mechanical_w", where)
    holding = sweep.at("holding_power_w", where)
    relative = own / power
    cost = power / (where * swing**2)
    return {
        "drive_power_at_resonance_w": (power, own),
        "copper_at_resonance_w": (copper, copper * relative),
        "gear_at_resonance_w": (power - copper - mechanical, own),
        "mechanical_at_resonance_w": (mechanical, mechanical * relative),
        "holding_at_resonance_w": (holding, 0.0),
        "energy_per_cycle_at_resonance_j": (power / where, own / where),
        "swing_cost_at_resonance_j_rad2": (cost, cost * relative),
    }


def _against_trend(
    sweep: _Sweep, where: float, resistance: float, saved: tuple[float, float]
) -> dict[str, tuple[float, float]]:
    power, own, swing = sweep.power(where)
    current, holding = sweep.at("drive_current_rms_a", where), sweep.at("holding_power_w", where)
    square = where**2 * swing**2
    saving, saving_std = (resistance * square * x for x in saved)
    trend = (power + saving) / (where * swing**2)
    total = math.sqrt(current**2 + saved[0] * square)
    out = {
        "trend_cost_at_resonance_j_rad2": (trend, math.hypot(own, saving_std) / (where * swing**2)),
        "energy_reduction": _reduction(power, own, saving, saving_std),
        "current_reduction": (1.0 - current / total, 0.5 * current * square * saved[1] / total**3),
    }
    if math.isfinite(holding):
        less = 1.0 - (power + holding) / (power + saving)
        spread = math.hypot((saving - holding) * own, (power + holding) * saving_std) / (power + saving) ** 2
        out["energy_reduction_with_holding"] = (less, spread)
        even = swing * math.sqrt(holding / saving) if saving > 0 and holding >= 0 else math.nan
        out["break_even_rad"] = (even, 0.5 * even * saving_std / saving if saving > 0 else math.nan)
    return out
