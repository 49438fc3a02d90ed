"""Doubts: what a measurement says against itself, against its rig, or against what the rig's twin foretold.

A number with a tight interval may still be wrong: a drive held at a fifth of its duty, a gyro with another scale, a
sensor that repeats itself, all leave smooth curves. What cannot be right together is said here in sentences, each with
the places where it was seen and with how far they lie from what was expected, in units of its standard uncertainty.

That uncertainty is the measured one and the expectation's own, declared below with its reason. Doubt begins at three
of it. Nothing here needs the twin: what it foretells is kept beside the recording (attribute `expected`, see
`foretold`), and where there is none, that comparison is not made.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sinew.analysis.signal.signals import Signals, by_length
from sinew.measure.arrays import Array, mean_of_known
from sinew.measure.errors import SinewError
from sinew.measure.estimate import finite, number
from sinew.measure.recording import Segment

if TYPE_CHECKING:
    from sinew.plan.check import Reach
    from sinew.plan.rig import RigSpec

DOUBTED_FROM = 3.0
"""Distance from the expectation, in standard uncertainties, from which a number is doubted."""

# Standard uncertainties of the expectations, beside those of the measurement.
# The lever's reach by the servo's data sheet, with the torsion and the supply as measured: the twin agrees within 1 %;
# stall torque and speed of the data sheet are given to some percent, the gear's friction to a third.
_LEVER_STD = 0.07
# The reach against a held head, where nothing is known of the joint: in resonance the head takes up to half of it.
_HELD_LOW, _HELD_HIGH = 0.5, 1.15
# Share of samples at the duty limit from the describing function, which knows no harmonics: twin within 0.15.
_SHARE_STD = 0.1
# A curve against the twin's: parameters that were calibrated once, on one specimen, at one temperature.
_GAIN_STD, _PHASE_STD, _SHIFT = 0.1, math.radians(5.0), 0.04
_RESONANCE_STD, _DAMPING_STD = 0.03, 0.12
# Losses from the rig's parameters alone (geometry of the Dahl loop, share of the silicone in the stiffness).
_LOSS_STD = 0.2
# A lag of 0° or 180° by delays that the budget does not hold.
_LAG_STD = math.radians(4.0)
# A pretension by the tendon motors' angles: levelling moves them apart, not their mean; pulley and cable to 3 %.
_PRETENSION_STD_MM, _PRETENSION_STD = 0.15, 0.03

_MOST_TEXT = 40_000
_MOVING_RAD = math.radians(1.0)
_FROZEN_SHARE, _FROZEN_SAMPLES, _FROZEN_STRIDE = 0.25, 8, 4
_SAME = 1e-6


@dataclass(frozen=True)
class Place:
    """Where in a campaign something was seen: pretension [mm], drive frequency [Hz; NaN for none], repeat."""

    pretension_mm: float
    frequency_hz: float
    repeat: int

    def __str__(self) -> str:
        at = "" if math.isnan(self.frequency_hz) else f", {self.frequency_hz:g} Hz"
        return f"{self.pretension_mm:g} mm{at}, repeat {self.repeat + 1}"


@dataclass(frozen=True)
class Doubt:
    """One thing that a measurement says against itself.

    kind: lever, torsion, saturation, response, resonance, damping, phase, silence, axis, frozen or pretension.
    where: all places, the worst first. sentence: what was found there, what was expected, what to look at.
    distance: of the worst from its expectation in standard uncertainties; infinite where it is impossible.
    """

    kind: str
    where: tuple[Place, ...]
    sentence: str
    distance: float

    def to_json(self) -> dict[str, Any]:
        """Return the doubt as JSON holds it; an infinite distance becomes null."""
        return {
            "kind": self.kind,
            "sentence": self.sentence,
            "distance": finite(self.distance),
            "where": [
                {
                    "pretension_mm": one.pretension_mm,
                    "frequency_hz": None if math.isnan(one.frequency_hz) else one.frequency_hz,
                    "repeat": one.repeat,
                }
                for one in self.where
            ],
        }


def doubt_samples(sweep: xr.Dataset, signals: Signals) -> list[Doubt]:
    """Return what speaks against the samples of a recording, and against the sweep part of its results.

    sweep: that part, see `sinew.analysis.analysed.analyse_recording`; empty where there is none. signals: of the
    recording; without a rig only what needs none is looked at. What a recording lacks (tendon angles, a duty, an
    expectation) is not doubted.
    """
    rig, found = signals.rig, list(_frozen_channels(signals))
    expected = expectation(signals.attrs)
    if "gain" in sweep:
        part = _Sweep.of(sweep, signals)
        found += _phase_doubts(part)
        found += _silent_doubts(part, signals)
        if rig is not None:
            found += _lever_doubts(part, rig, expected)
        if expected is not None:
            found += _curve_doubts(part, expected)
    if rig is not None:
        found += _pretension_doubts(signals, rig)
    return found


def doubt_decays(results: xr.Dataset, signals: Signals) -> list[Doubt]:
    """Return what speaks against the damping of the decays, and against the frequencies of decays and resonances.

    results: all of them; signals: as for `doubt_samples`.
    """
    expected, found = expectation(signals.attrs), list[Doubt]()
    if signals.rig is not None:
        found += _damping_doubts(results, signals.rig, expected)
    if expected is not None:
        found += _resonance_doubts(results, expected)
    return found


def foretold(results: xr.Dataset) -> str:
    """Return what a recording of the same plan is expected to give, as the text of the attribute `expected`.

    results: of the twin's recording of the plan, without noise; one repeat is enough. Empty where it would be too much
    for an attribute of a file (some thousand groups).
    """
    document: dict[str, Any] = {}
    for name in _FORETOLD:
        if name in results:
            values = np.asarray(results[name].values, dtype=float)
            if values.ndim and results[name].dims[-1] == "repeat":
                values = mean_of_known(values)
            document[name] = [[_plain(x) for x in row] if np.ndim(row) else _plain(row) for row in values]
    for axis in ("pretension_mm", "frequency_hz"):
        if axis in results:
            document[axis] = [float(x) for x in results[axis].values]
    text = json.dumps(document, separators=(",", ":"))
    return text if len(text) < _MOST_TEXT else ""


_FORETOLD = (
    "drive_amplitude_rad",
    "gain_measured_drive",
    "phase_lag_rad",
    "saturated_share",
    "resonance_measured_drive_hz",
    "decay_frequency_hz",
    "damping_ratio",
)


def expectation(attrs: Mapping[Any, Any]) -> dict[str, Array] | None:
    """Return what was foretold of a recording, by its attributes, arrays by name; None where nothing that can be
    read."""
    text = str(attrs.get("expected", ""))
    if not text:
        return None
    try:
        document = json.loads(text)
        return {name: np.array(values, dtype=float) for name, values in document.items()}
    except (ValueError, TypeError, AttributeError):
        return None


def doubts_of(results: xr.Dataset) -> list[dict[str, Any]]:
    """Return the doubts that results carry (attribute `doubts`), as JSON holds them; none where they carry none."""
    try:
        found = json.loads(str(results.attrs.get("doubts", "[]")))
    except ValueError:
        return []
    return [one for one in found if isinstance(one, dict) and "sentence" in one] if isinstance(found, list) else []


@dataclass(frozen=True)
class _Sweep:
    """The sweep part of results: axes (p,), (f,), (r,), columns (p, f, r), and the commanded amplitude [rad],
    (p, f, r); the groups that stand in it, as place and samples."""

    pretension_mm: Array
    frequency_hz: Array
    repeat: NDArray[np.int64]
    columns: Mapping[str, Array]
    command: Array
    supply_v: Array
    groups: Sequence[tuple[tuple[int, int, int], slice]]

    @staticmethod
    def of(results: xr.Dataset, signals: Signals) -> "_Sweep":
        columns = {str(n): v.values for n, v in results.variables.items() if v.dims[-1:] == ("repeat",) and v.ndim == 3}
        shape = columns["gain"].shape
        axes = results["pretension_mm"].values, results["frequency_hz"].values, results["repeat"].values - 1
        command, supply = np.full(shape, np.nan), np.full(shape, np.nan)
        groups: list[tuple[tuple[int, int, int], slice]] = []
        row, column, layer = ({mark: k for k, mark in enumerate(axis.tolist())} for axis in axes)
        for segment, where in signals.of_kind("steady"):
            p, f = row.get(segment.pretension_mm), column.get(segment.frequency_hz)
            r = layer.get(segment.repeat)
            if p is not None and f is not None and r is not None:
                groups.append(((p, f, r), where))
                command[groups[-1][0]] = math.radians(segment.amplitude_deg)
        if groups and "supply_v" in signals.recorded:
            volts = _means(signals.recorded["supply_v"], [where for _, where in groups])
            supply[tuple(np.transpose([at for at, _ in groups]))] = volts
        return _Sweep(*axes, columns, command, supply, groups)

    def place(self, index: tuple[int, ...]) -> Place:
        p, f, r = index
        return Place(float(self.pretension_mm[p]), float(self.frequency_hz[f]), int(self.repeat[r]))

    def at(self, expected: Mapping[str, Array], name: str, factor: float = 1.0) -> Array:
        """Return a foretold column at the sweep's frequencies times a factor, (p, f), NaN where it does not reach."""
        out = np.full((self.pretension_mm.size, self.frequency_hz.size), np.nan)
        table = expected.get(name)
        axes = expected.get("pretension_mm"), expected.get("frequency_hz")
        if table is None or axes[0] is None or axes[1] is None or table.shape != (axes[0].size, axes[1].size):
            return out
        for i, p in enumerate(self.pretension_mm):
            row = np.flatnonzero(np.abs(axes[0] - p) < 1e-6)
            known = np.isfinite(table[row[0]]) if row.size else np.zeros(0, dtype=bool)
            if known.any():
                f, values = axes[1][known], table[row[0]][known]
                asked = np.clip(self.frequency_hz * factor, f[0], f[-1])
                inside = (self.frequency_hz >= f[0] - 1e-9) & (self.frequency_hz <= f[-1] + 1e-9)
                out[i] = np.where(inside, np.interp(asked, f, values), np.nan)
        return out

    def gather(self, kind: str, distance: Array, sentence: Callable[[tuple[int, ...]], str]) -> Iterator[Doubt]:
        """Yield the doubt of all places beyond the threshold; sentence: of the worst, and its advice."""
        distance = np.nan_to_num(distance, nan=0.0, posinf=np.inf)
        places = np.argwhere(distance > DOUBTED_FROM)
        if not places.size:
            return
        order = np.argsort([-distance[tuple(at)] for at in places], kind="stable")
        ranked = [tuple(int(i) for i in places[k]) for k in order]
        looked = int(np.isfinite(self.columns["gain_harmonic"]).sum())
        text = f"{sentence(ranked[0])} ({len(ranked)} of {looked} groups)"
        yield Doubt(kind, tuple(map(self.place, ranked)), text, float(distance[ranked[0]]))


def _lever_doubts(sweep: _Sweep, rig: "RigSpec", expected: Mapping[str, Array] | None) -> Iterator[Doubt]:
    """Yield where the lever did not go as far as its servo takes it, and where lever and torsion contradict each other.

    The servo's balance with the torsion as measured gives the lever. Where it is off, the lever is to blame if it is
    off against a held head, too, or against what the twin foretold while the torsion it brings about is as foretold;
    else the torsion is.
    """
    from sinew.plan.check import drive_reach, drive_reaches  # plans are heavy, and a table has none

    lever, command = sweep.columns["drive_amplitude_rad"], sweep.command
    lag, gain = sweep.columns["phase_lag_rad"], sweep.columns["gain_measured_drive"]
    std = sweep.columns["drive_amplitude_std_rad"]
    foretold_lever, on_curve = np.full(sweep.command.shape[:2], np.nan), np.zeros(lever.shape, dtype=bool)
    if expected is not None:
        foretold_lever = sweep.at(expected, "drive_amplitude_rad")
        on_curve = np.fmax(*_off_curve(sweep, expected)[0]) < DOUBTED_FROM
    blamed, contradicted, unsaturated = (np.zeros(lever.shape) for _ in range(3))
    swung: dict[tuple[int, ...], Reach] = {}
    looked = np.isfinite(lever) & np.isfinite(command) & (command > 0)
    places = [tuple(int(i) for i in place) for place in np.argwhere(looked)]
    supply = np.nan_to_num(sweep.supply_v[looked]).tolist()
    supplied = {volts: _supplied(rig, volts) if volts > 0 else rig for volts in set(supply)}
    rigs = [supplied[volts] for volts in supply]
    head = np.where(np.isfinite(gain + lag), gain * np.exp(-1j * lag), 0.0)[looked]
    hertz = np.broadcast_to(sweep.frequency_hz[:, None], looked.shape)[looked]
    reached = drive_reaches(rigs, command[looked], hertz, head) if places else []
    for at, here, frequency, reach in zip(places, rigs, hertz.tolist(), reached, strict=True):
        swung[at] = reach
        own = _ratio(std[at], lever[at])
        by_head = _logs(lever[at], reach.amplitude_rad, math.hypot(_LEVER_STD, own))
        if by_head > DOUBTED_FROM:
            held = drive_reach(here, float(command[at]), frequency).amplitude_rad
            nearest = min(max(lever[at], _HELD_LOW * held), _HELD_HIGH * held)
            by_held = _logs(lever[at], nearest, math.hypot(_LEVER_STD, own))
            by_twin = _logs(lever[at], foretold_lever[at[:2]], math.hypot(_LEVER_STD, own))
            guilty = by_held > DOUBTED_FROM or (by_twin > DOUBTED_FROM and bool(on_curve[at]))
            (blamed if guilty else contradicted)[at] = by_head
        if "saturated_share" in sweep.columns and sweep.columns["saturated_share"][at] < 0.02:
            unsaturated[at] = reach.saturated_share / _SHARE_STD

    if (blamed > 0).any():  # the same fault where it shows less
        short = np.zeros(lever.shape, dtype=bool)
        for at, reach in swung.items():
            short[at] = lever[at] < reach.amplitude_rad
        same = (contradicted > 0) & (short == short[np.unravel_index(np.argmax(blamed), blamed.shape)])
        blamed, contradicted = np.where(same, contradicted, blamed), np.where(same, 0.0, contradicted)

    def lever_sentence(at: tuple[int, ...]) -> str:
        less = lever[at] < swung[at].amplitude_rad
        advice = (
            "look at the drive's PWM limit, goal PWM, profile and supply, and at what the lever may rub on"
            if less
            else "look at the masses on the lever, the supply, the drive's model and the encoder's scale"
        )
        return (
            f"the lever went {_deg(lever[at])} of the {_deg(command[at])} asked for at {sweep.place(at)}; with the "
            f"head swinging as measured the drive reaches {_deg(swung[at].amplitude_rad)}: {advice}"
        )

    def torsion_sentence(at: tuple[int, ...]) -> str:
        return (
            f"lever and torsion contradict each other at {sweep.place(at)}: with a head that swings "
            f"{number(gain[at], 3)} times as far as the lever, the drive would move the lever by "
            f"{_deg(swung[at].amplitude_rad)}, it moved by {_deg(lever[at])}; look at the gyro's scale and axes, and "
            "at the lever's inertia in the rig"
        )

    def share_sentence(at: tuple[int, ...]) -> str:
        return (
            f"the drive's duty never touched its limit at {sweep.place(at)}, where the check has it there for "
            f"{100 * swung[at].saturated_share:.0f} % of the time: look at the drive's PWM limit and goal PWM"
        )

    yield from sweep.gather("lever", blamed, lever_sentence)
    yield from sweep.gather("torsion", contradicted, torsion_sentence)
    yield from sweep.gather("saturation", unsaturated, share_sentence)


def _supplied(rig: "RigSpec", volts: float) -> "RigSpec":
    """Return a rig whose drive is fed with so many volts."""
    supply = rig.drive.supply_voltage.model_copy(update={"value": float(volts)})
    return rig.model_copy(update={"drive": rig.drive.model_copy(update={"supply_voltage": supply})})


def _phase_doubts(sweep: _Sweep) -> Iterator[Doubt]:
    """Yield where the torsion leads the lever, or lags by more than half a turn: a joint that gives energy away."""
    lag = sweep.columns["phase_lag_rad"]
    std = np.sqrt(
        np.nan_to_num(sweep.columns["phase_std_rad"]) ** 2
        + np.nan_to_num(sweep.columns["phase_delay_std_rad"]) ** 2
        + _LAG_STD**2
    )
    moving = sweep.columns["drive_amplitude_rad"] > _MOVING_RAD
    beyond = np.maximum(-lag, lag - math.pi)
    distance = np.where(moving & (beyond > 0), beyond / std, 0.0)
    yield from sweep.gather(
        "phase",
        distance,
        lambda at: (
            f"the torsion lags the lever by {math.degrees(lag[at]):.0f}° at {sweep.place(at)}; a joint that takes "
            "energy lags by 0° to 180°: look at the signs of the gyro's axes and of the lever (wiring), and at the "
            "sensor delays of the rig"
        ),
    )


def _silent_doubts(sweep: _Sweep, signals: Signals) -> Iterator[Doubt]:
    """Yield where the lever moved and the head did not, and where another axis of the gyro swings more than x."""
    size, std = sweep.columns["amplitude_rad"], sweep.columns["amplitude_std_rad"]
    moving = sweep.columns["drive_amplitude_rad"] > _MOVING_RAD
    silent = moving & ~(size > DOUBTED_FROM * std)
    yield from sweep.gather(
        "silence",
        np.where(silent, np.inf, 0.0),
        lambda at: (
            f"the head does not answer at {sweep.place(at)}: the lever swings by "
            f"{_deg(sweep.columns['drive_amplitude_rad'][at])}, the torsion is none beyond its noise; look at the IMU "
            "and at what couples lever and head"
        ),
    )
    gyro = signals.recorded.get("gyro_rad_s")
    if gyro is None:
        return
    ratio, squares = np.zeros(size.shape), np.empty((len(sweep.groups), 3))
    for rows, samples in by_length([where for _, where in sweep.groups]):
        turns = gyro.take(samples, axis=0).astype(float)
        turns -= turns[:, :1]  # a channel that stands still is then none
        sums = np.ones(samples.shape[1]) @ turns
        squares[rows] = np.diagonal(turns.transpose(0, 2, 1) @ turns, axis1=1, axis2=2) - sums**2 / samples.shape[1]
    for (place, _), (along, y, z) in zip(sweep.groups, np.sqrt(np.maximum(squares, 0.0)).tolist(), strict=True):
        ratio[place] = max(y, z) / along if along > 0 else math.inf if max(y, z) > 0 else 0.0
    yield from sweep.gather(
        "axis",
        np.where(moving & (ratio > 1.0), DOUBTED_FROM * np.maximum(ratio, 1.0), 0.0),
        lambda at: (
            f"the gyro turns {number(ratio[at], 2)} times as much about another axis of the head as about its x, the "
            f"joint's, at {sweep.place(at)}; look at imu_axes in the rig's wiring and at the chip's mounting"
        ),
    )


def _off_curve(
    sweep: _Sweep, expected: Mapping[str, Array]
) -> tuple[tuple[Array, Array], tuple[Array, Array], tuple[Array, Array]]:
    """Return how far gain and lag lie from the foretold curve in standard uncertainties, (p, f, r) each, and the ends
    of what it takes within `_SHIFT` of their frequencies, (p, f, 1) each: of the gain, and of the lag [rad]."""
    gain, gain_std = sweep.columns["gain_measured_drive"], sweep.columns["gain_measured_drive_std"]
    lag, lag_std = sweep.columns["phase_lag_rad"], sweep.columns["phase_std_rad"]
    factors = np.linspace(1.0 - _SHIFT, 1.0 + _SHIFT, 5)
    curves = np.stack([sweep.at(expected, "gain_measured_drive", factor) for factor in factors])
    phases = np.stack([sweep.at(expected, "phase_lag_rad", factor) for factor in factors])
    low, high = curves.min(axis=0)[..., None], curves.max(axis=0)[..., None]
    first, last = phases.min(axis=0)[..., None], phases.max(axis=0)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        own = np.hypot(_GAIN_STD, np.nan_to_num(gain_std / gain))
        off = np.abs(np.log(gain / np.clip(gain, low, high))) / own
        turn = np.abs(np.angle(np.exp(1j * (lag - np.clip(lag, first, last))))) / np.hypot(_PHASE_STD, lag_std)
    return (off, turn), (low, high), (first, last)


def _curve_doubts(sweep: _Sweep, expected: Mapping[str, Array]) -> Iterator[Doubt]:
    """Yield where gain or phase by the measured lever is far from the twin's curve.

    The curve may lie shifted by `_SHIFT` in frequency: what it takes in between is expected as well.
    """
    gain, lag = sweep.columns["gain_measured_drive"], sweep.columns["phase_lag_rad"]
    (off, turn), (low, high), (first, last) = _off_curve(sweep, expected)
    distance = np.fmax(off, turn)

    def sentence(at: tuple[int, ...]) -> str:
        if not turn[at] > off[at]:
            return (
                f"the curve is far from the rig's prediction: gain {number(gain[at], 3)} at {sweep.place(at)}, "
                f"expected {number(low[at[:2]][0], 3)} to {number(high[at[:2]][0], 3)}; either the "
                "rig file is not this rig, or pretension, lever or gyro are not as it says"
            )
        return (
            f"the curve is far from the rig's prediction: a lag of {math.degrees(lag[at]):.0f}° at {sweep.place(at)}, "
            f"expected {math.degrees(first[at[:2]][0]):.0f} to {math.degrees(last[at[:2]][0]):.0f}°; either the rig "
            "file is not this rig, or pretension, lever or delays are not as it says"
        )

    yield from sweep.gather("response", distance, sentence)


def _resonance_doubts(results: xr.Dataset, expected: Mapping[str, Array]) -> Iterator[Doubt]:
    """Yield where resonance or decay lie at another frequency than the twin's."""
    ends = {"resonance_measured_drive_hz": "resonance_measured_drive_std_hz", "decay_frequency_hz": ""}
    for name, spread in ends.items():
        if name not in results:
            continue
        values = np.asarray(results[name].values, dtype=float)
        own = np.zeros(values.shape[:1]) if not spread else np.nan_to_num(results[spread].values)
        value = values if values.ndim == 1 else mean_of_known(values)
        rows: list[tuple[float, Place, str]] = []
        for p, mm in enumerate(results["pretension_mm"].values):
            hoped = _hoped(expected, name, float(mm))
            if not (math.isfinite(hoped) and math.isfinite(value[p])):
                continue
            distance = _logs(float(value[p]), hoped, math.hypot(_RESONANCE_STD, own[p] / value[p]))
            what = "the joint resonates" if name.startswith("resonance") else "the free joint swings"
            rows.append(
                (
                    distance,
                    Place(float(mm), math.nan, 0),
                    f"{what} at {number(value[p])} Hz at {mm:g} mm, expected {number(hoped)} Hz; look at pretension "
                    "and first contact, at the masses on the lever, and at the rig file",
                )
            )
        yield from _worst("resonance", rows)


def _damping_doubts(results: xr.Dataset, rig: "RigSpec", expected: Mapping[str, Array] | None) -> Iterator[Doubt]:
    """Yield where Lehr's damping lies outside what the rig's losses can give, or far from the twin's."""
    if "damping_ratio" not in results:
        return
    ratio, own = results["damping_ratio"].values, results["damping_ratio_std"].values
    pretension, hertz = results["pretension_mm"].values, results["decay_frequency_hz"].values
    outside: list[tuple[float, Place, str]] = []
    far: list[tuple[float, Place, str]] = []
    for at in np.argwhere(np.isfinite(ratio)):
        p, r = int(at[0]), int(at[1])
        mm, value, frequency = float(pretension[p]), float(ratio[p, r]), float(hertz[p, r])
        place = Place(mm, math.nan, r)
        low, high = possible_damping(rig, frequency)
        relative = math.hypot(_LOSS_STD, _ratio(float(own[p, r]), value))
        nearest = min(max(value, low), high)
        outside.append(
            (
                math.inf if value <= 0 else _logs(value, nearest, relative),
                place,
                f"D is {number(value, 3)} at {place}; silicone and guides of the rig can give {number(low, 2)} to "
                f"{number(high, 2)}: look at the drive (does it hold the lever?), at the guides, and at the rig file",
            )
        )
        hoped = _hoped(expected, "damping_ratio", mm)
        if math.isfinite(hoped) and value > 0:
            relative = math.hypot(_DAMPING_STD, _ratio(float(own[p, r]), value))
            text = f"D is {number(value, 3)} at {place}, the rig's prediction is {number(hoped, 3)}"
            far.append((_logs(value, hoped, relative), place, text))
    yield from _worst("damping", outside)
    yield from _worst("damping", far)


def _hoped(expected: Mapping[str, Array] | None, name: str, pretension_mm: float) -> float:
    """Return a foretold number at a pretension, NaN where it was not foretold."""
    if expected is None or name not in expected or "pretension_mm" not in expected:
        return math.nan
    row = np.flatnonzero(np.abs(expected["pretension_mm"] - pretension_mm) < 1e-6)
    return float(expected[name][row[0]]) if row.size else math.nan


def possible_damping(rig: "RigSpec", frequency_hz: float) -> tuple[float, float]:
    """Return the smallest and largest Lehr damping that the rig's losses can give a joint that swings at a frequency.

    The frequency gives the stiffness, k = ω²(I_h + I_l). The silicone's part of it, GJ/L, has the loss factor η, hence
    D_s = η/2 · GJ/(L k); a joint compressed by its tendons is stiffer by at most some tenths, which the uncertainty
    holds. What is more is the tendons': N T = (k - GJ/L) ℓ/(r_b r_h) at most, of which the guides take
    their loop's energy in a cycle of amplitude a, which is D = loop/(2π k a²), largest near a = 1.6 φ_s for Dahl's law,
    and next to nothing at large ones. A dashpot d adds d/(2 I ω).
    """
    silicone, tendons = rig.silicone, rig.tendons
    inertia = rig.inertia.head.value + rig.inertia.lever.value
    omega = 2.0 * math.pi * frequency_hz
    stiffness = omega**2 * inertia
    bare = silicone.stiffness(0.0)
    by_silicone = 0.5 * silicone.loss_factor.value * min(1.0, bare / stiffness)
    total = max(0.0, stiffness - bare) / tendons.stiffness(1.0, 0.0)
    total += tendons.count * tendons.first_contact_tension.value
    swing = np.geomspace(0.1, 100.0, 200) * tendons.guides.reach
    by_guides = float(tendons.damping(total, stiffness, swing).max())
    by_dashpot = silicone.viscous.value / (2.0 * inertia * omega)
    return by_silicone + by_dashpot, 0.5 * silicone.loss_factor.value + by_guides + by_dashpot


def group_doubts(rig: "RigSpec", segment: Segment, time_s: Array, drive_rad: Array, gyro_rad_s: Array) -> list[str]:
    """Return what can be said against a steady group while its run goes on, in sentences.

    time_s, drive_rad: (n,); gyro_rad_s: about the joint's axis, (n,); NaN where a reading did not come. The lever is
    held against half of what it reaches against a held head, for in resonance the head takes up to half.
    """
    from sinew.plan.check import drive_reach

    known = np.isfinite(time_s) & np.isfinite(drive_rad) & np.isfinite(gyro_rad_s)
    command = math.radians(segment.amplitude_deg)
    if segment.kind != "steady" or known.sum() < _FROZEN_SAMPLES or not command > _MOVING_RAD:
        return []
    time, lever, rate = time_s[known], drive_rad[known], gyro_rad_s[known]
    phase = 2.0 * np.pi * segment.frequency_hz * (time - time[0])
    design = np.stack([np.cos(phase), np.sin(phase), np.ones_like(phase)], axis=1)
    wave = np.linalg.lstsq(design, lever, rcond=None)[0]
    amplitude = float(np.hypot(wave[0], wave[1]))
    place, found = Place(segment.pretension_mm, segment.frequency_hz, segment.repeat), []
    least = _HELD_LOW * drive_reach(rig, command, segment.frequency_hz).amplitude_rad
    if amplitude < least and _logs(amplitude, least, _LEVER_STD) > DOUBTED_FROM:
        found.append(
            f"the lever went {_deg(amplitude)} of the {_deg(command)} asked for at {place}, the drive reaches "
            f"{_deg(2.0 * least)} against a held head: look at its PWM limit, goal PWM, profile and supply"
        )
    step = float(np.median(np.diff(time)))
    for words, values, share in (("the gyro", rate, _FROZEN_SHARE), ("the drive's encoder", lever, 1.0)):
        longest = int(_longest_rows(values[:, None], np.array([[0, values.size]]), _near(values[:, None]))[0])
        if longest > max(_FROZEN_SAMPLES, share / (step * segment.frequency_hz)):
            found.append(f"{words} repeats one value for {longest * step:.2g} s at {place}: look at it and its cable")
    return found


def _frozen_channels(signals: Signals) -> Iterator[Doubt]:
    """Yield the channels that repeat one value while they should move: a sensor that stands still.

    Looked at where the lever is driven by more than a degree, steady, and in the first second of a free decay. A sine
    that is rounded rests on its crest for 2 sqrt(2/A) rad, A its amplitude in counts: a quarter period is beyond that
    from four counts on. The lever may rest in its gear's friction at each turn, so angle, current and duty of the drive
    are doubted after a whole period. The accelerometer is looked at where the rig gives it noise, on all three axes at
    once. A foreign file says nothing of its sensors, and is left alone.
    """
    if signals.attrs.get("source") == "import":
        return
    rate, recorded, rig = signals.budget.sample_hz, signals.recorded, signals.rig
    quiet = "sensor_noise" in str(signals.attrs.get("effects_off", "")).split()
    noisy = rig is not None and not quiet and rig.imu.accelerometer_noise.value > rig.imu.accelerometer_lsb.value
    channels: list[tuple[str, str, Array, float]] = []
    if "gyro_rad_s" in recorded:
        channels.append(("gyro", "the gyro", recorded["gyro_rad_s"][:, :1], _FROZEN_SHARE))
    if "acceleration_m_s2" in recorded and noisy:
        channels.append(("accelerometer", "the accelerometer", recorded["acceleration_m_s2"], _FROZEN_SHARE))
    for name, words in (
        ("drive_rad", "the drive's encoder"),
        ("drive_current_a", "the drive's current"),
        ("drive_pwm", "the drive's duty"),
    ):
        if name in recorded and (name == "drive_rad" or np.ptp(recorded[name]) > 0):
            channels.append((name, words, recorded[name][:, None], 1.0))
    moving = list(_moving(signals))
    driven = [row for row in moving if row[0].kind == "steady"]  # in a ring-down the lever stands
    for _, words, values, share in channels:
        looked = moving if share < 1.0 else driven
        if not looked:
            continue
        needed = np.maximum(_FROZEN_SAMPLES, share * rate / np.array([segment.frequency_hz for segment, _ in looked]))
        longest = _rows_beyond(values, np.array([(where.start, where.stop) for _, where in looked]), needed)
        rows: list[tuple[float, Place, str]] = []
        for one in np.flatnonzero(longest):
            segment, _ = looked[one]
            place = Place(segment.pretension_mm, segment.frequency_hz, segment.repeat)
            text = (
                f"{words} repeats one value for {longest[one] / rate:.2g} s at {place}, while the lever is driven: "
                "look at the sensor, its cable and its firmware"
            )
            rows.append((float(DOUBTED_FROM * longest[one] / needed[one]), place, text))
        yield from _worst("frozen", rows, len(looked))


def _moving(signals: Signals) -> Iterator[tuple[Segment, slice]]:
    for segment, where in signals.segments:
        if not (segment.amplitude_deg > math.degrees(_MOVING_RAD) and segment.frequency_hz > 0):
            continue
        if segment.kind == "steady":
            yield segment, where
        elif segment.kind == "ring-down":
            yield segment, slice(where.start, min(where.stop, where.start + round(signals.budget.sample_hz)))


def _rows_beyond(values: Array, stretches: NDArray[np.int64], needed: Array) -> NDArray[np.int64]:
    """Return how many samples in a row repeat one value, at most, in each stretch, zero where not more than needed.

    values: (n, axes). stretches: first sample and the one after the last, (k, 2). needed: (k,), not below
    `_FROZEN_SAMPLES`. A row of more than m samples has m that equal the one before, hence m // 4 neighbours among every
    fourth sample: where these are missing, nothing else is looked at.
    """
    near, out = _near(values), np.zeros(needed.size, dtype=np.int64)
    fewest = needed.astype(np.int64) // _FROZEN_STRIDE
    maybe = np.flatnonzero(_longest_rows(values, stretches, near, _FROZEN_STRIDE) > fewest)
    out[maybe] = _longest_rows(values, stretches[maybe], near)
    return np.where(out > needed, out, 0)


def _near(values: Array) -> list[float]:
    """Return how far two samples of an axis may lie apart and be equal: readings that were brought onto other times by
    interpolation are equal but for their last bits."""
    return [_SAME * max(abs(float(column.max())), abs(float(column.min()))) for column in values.T]


def _longest_rows(values: Array, stretches: NDArray[np.int64], near: list[float], stride: int = 1) -> NDArray[np.int64]:
    """Return how many samples in a row equal the one before, at most, and one, in each stretch, (k,).

    values: (n, axes), which are to be equal on all of them. stride: each so many samples of a stretch, its first not
    among them, are looked at and counted.
    """
    starts, stops = stretches.T
    sizes = -(-(stops - starts) // stride)
    begins = np.cumsum(sizes) - sizes
    at = np.repeat(starts - stride * begins, sizes) + stride * np.arange(sizes.sum())
    is_looked = np.ones(at.size, dtype=bool)
    is_looked[begins] = False
    found = np.flatnonzero(is_looked)
    for column, tolerance in zip(values.T, near, strict=True):  # few are left for the second
        found = found[np.abs(column[at[found]] - column[at[found] - 1]) <= tolerance]
    same = np.zeros(at.size + 1, dtype=bool)
    same[found] = True
    edges = np.flatnonzero(np.diff(same, prepend=False))
    longest = np.ones(len(stretches), dtype=np.int64)
    np.maximum.at(longest, np.searchsorted(begins, edges[::2], "right") - 1, 1 + edges[1::2] - edges[::2])
    return longest


def _means(values: NDArray[Any], stretches: list[slice]) -> Array:
    """Return the mean of all that was recorded in each stretch, (k,)."""
    out = np.empty(len(stretches))
    for rows, samples in by_length(stretches):
        out[rows] = values.take(samples, axis=0).reshape(rows.size, -1).mean(axis=1)
    return out


def _pretension_doubts(signals: Signals, rig: "RigSpec") -> Iterator[Doubt]:
    """Yield where the tendon motors do not stand where the pretension has them, against the least one of the recording.

    Motor angle times pulley radius, plus what the servo yields under its tension (current times torque constant by
    radius and servo stiffness). Tendons that are held by current follow the joint, and are not looked at.
    """
    mode, recorded = _tendon_mode(signals.attrs), signals.recorded
    if "tendon_rad" not in recorded or "tendon_current_a" not in recorded or not mode.startswith("position"):
        return
    tendons = rig.tendons
    radius = tendons.pulley_radius.value
    per_ampere = tendons.tension(1.0) / tendons.servo_stiffness.value
    looked = [row for row in signals.segments if row[0].kind in ("steady", "ring-down")]
    angle, current = (_means(recorded[name], [w for _, w in looked]) for name in ("tendon_rad", "tendon_current_a"))
    found: dict[float, list[float]] = {}
    for (segment, _), pulled in zip(looked, (radius * angle + per_ampere * current).tolist(), strict=True):
        found.setdefault(segment.pretension_mm, []).append(1e3 * pulled)
    if len(found) < 2:
        return
    least = min(found)
    rows = []
    for mm, values in found.items():
        asked, pulled = mm - least, float(np.median(values) - np.median(found[least]))
        std = math.hypot(_PRETENSION_STD_MM, _PRETENSION_STD * asked)
        text = (
            f"the tendon motors stand {number(pulled, 3)} mm from where they stood at {least:g} mm, at {mm:g} mm they "
            f"should by {number(asked, 3)} mm: look for a slipped pulley, another radius, or a motor that was turned"
        )
        rows.append((abs(pulled - asked) / std, Place(mm, math.nan, 0), text))
    yield from _worst("pretension", rows)


def _tendon_mode(attrs: Mapping[Any, Any]) -> str:
    """Return how the tendons were held, by the recording's plan; empty where it has none."""
    from sinew.plan.toml import parse_plan

    text = str(attrs.get("plan", ""))
    try:
        return parse_plan(text).pretension.mode if text.strip() else ""
    except SinewError:
        return ""


def _worst(kind: str, rows: list[tuple[float, Place, str]], looked: int | None = None) -> Iterator[Doubt]:
    """Yield the doubt of all rows (distance, place, sentence) beyond the threshold, with the sentence of the worst.

    looked: at how many places, where rows are not all of them.
    """
    beyond = sorted((row for row in rows if row[0] > DOUBTED_FROM), key=lambda row: -row[0])
    of = len(rows) if looked is None else looked
    if beyond:
        more = f" ({len(beyond)} of {of} places)" if of > 1 else ""
        yield Doubt(kind, tuple(row[1] for row in beyond), beyond[0][2] + more, beyond[0][0])


def _logs(value: float, expected: float, std: float) -> float:
    """Return |ln(value/expected)| over a relative standard uncertainty; NaN where nothing is expected."""
    if not (math.isfinite(expected) and math.isfinite(value)):
        return math.nan
    if value <= 0 or expected <= 0:
        return 0.0 if value == expected else math.inf
    return abs(math.log(value / expected)) / std


def _ratio(over: float, under: float) -> float:
    return over / under if math.isfinite(over) and under > 0 else 0.0


def _deg(radians: float) -> str:
    return number(math.degrees(radians), 3, "°")


def _plain(value: float) -> float | None:
    return float(f"{value:.4g}") if math.isfinite(value) else None
