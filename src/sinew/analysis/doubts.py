"""Doubts: what a measurement says against itself, against its rig, or against what the rig's twin foretold.

A number with a tight interval may still be wrong: a drive held at a fifth of its duty, a gyro with another scale, a
sensor that repeats itself, all leave smooth curves. What cannot be right together is said here in sentences, each with
the places where it was seen and with how far they lie from what was expected, in units of its standard uncertainty.

That uncertainty is the measured one and the expectation's own, declared below with its reason. Doubt begins at three
of it. Nothing here needs the twin: what it foretells is kept beside the recording (attribute `expected`, see
`expected_text`), and where there is none, that comparison is not made.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sinew.analysis.signal.signals import Signals
from sinew.measure.arrays import Array, mean_of_known
from sinew.measure.errors import SinewError
from sinew.measure.estimate import number
from sinew.measure.recording import Segment
from sinew.measure.result import Field, Result, Rows
from sinew.plan.check import drive_reach, drive_reaches
from sinew.plan.rig import RigSpec
from sinew.plan.toml import parse_plan

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
_FROZEN_SHARE, _FROZEN_SAMPLES = 0.25, 8
_SAME = 1e-6


@dataclass(frozen=True, repr=False)
class Location(Result):
    """Where in a campaign something was seen: pretension [mm], drive frequency [Hz; NaN for none], repeat."""

    pretension_mm: Annotated[float, Field("pretension")]
    frequency_hz: Annotated[float, Field("frequency")]
    repeat: Annotated[int, Field("repeat")]

    def __str__(self) -> str:
        at = "" if math.isnan(self.frequency_hz) else f", {self.frequency_hz:g} Hz"
        return f"{self.pretension_mm:g} mm{at}, repeat {self.repeat + 1}"


@dataclass(frozen=True, repr=False)
class Doubt(Result):
    """One thing that a measurement says against itself.

    kind: lever, torsion, saturation, response, resonance, damping, phase, silence, axis, frozen or pretension.
    where: all places, the worst first. sentence: what was found there, what was expected, what to look at.
    distance: of the worst from its expectation in standard uncertainties; infinite where it is impossible.
    """

    kind: Annotated[str, Field("", "detail")]
    where: Annotated[Rows[Location], Field("", "detail")]
    sentence: Annotated[str, Field("", "sentence")]
    distance: Annotated[float, Field("", "detail")]


def doubt_samples(sweep: xr.Dataset, signals: Signals) -> list[Doubt]:
    """Return what speaks against the samples of a recording, and against the sweep part of its results.

    sweep: that part, see `sinew.analysis.analysed.analyse_recording`; empty where there is none. signals: of the
    recording; without a rig only what needs none is looked at. What a recording lacks (tendon angles, a duty, an
    expectation) is not doubted.
    """
    rig, expected = signals.rig, expectation(signals.attrs)
    checks = [*_frozen_checks(signals)]
    if "gain" in sweep:
        part = _Sweep.of(sweep, signals)
        checks += _torsion_checks(part, signals)
        if rig is not None:
            checks += _lever_checks(part, rig, expected)
        if expected is not None:
            checks.append(("response", _curve_check(part, expected)))
    if rig is not None:
        checks.append(("pretension", _pretension_check(signals, rig)))
    return [doubt for kind, seen in checks for doubt in seen.doubt(kind)]


def doubt_decays(results: xr.Dataset, signals: Signals) -> list[Doubt]:
    """Return what speaks against the damping of the decays, and against the frequencies of decays and resonances.

    results: all of them; signals: as for `doubt_samples`.
    """
    expected, checks = expectation(signals.attrs), list[tuple[str, _Seen]]()
    if signals.rig is not None:
        checks += _damping_checks(results, signals.rig, expected)
    if expected is not None:
        checks += _resonance_checks(results, expected)
    return [doubt for kind, seen in checks for doubt in seen.doubt(kind)]


def expected_text(results: xr.Dataset) -> str:
    """Return what a recording of the same plan is expected to give, as the text of the attribute `expected`.

    results: of the twin's recording of the plan, without noise; one repeat is enough. Empty where it would be too much
    for an attribute of a file (some thousand groups).
    """
    document: dict[str, Any] = {}
    for name in _EXPECTED:
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


_EXPECTED = (
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


def doubts_of(results: xr.Dataset) -> Rows[Doubt]:
    """Return the doubts that results carry (attribute `doubts`); none where they carry none, or of another form."""
    try:
        return Rows(Doubt.from_dict(one) for one in json.loads(str(results.attrs.get("doubts", "[]"))))
    except (ValueError, TypeError, KeyError):
        return Rows()


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
        if "supply_v" in signals.recorded:
            for at, where in groups:
                supply[at] = signals.recorded["supply_v"][where].mean()
        return _Sweep(*axes, columns, command, supply, groups)

    def where(self, index: tuple[int, ...]) -> Location:
        p, f, r = index
        return Location(float(self.pretension_mm[p]), float(self.frequency_hz[f]), int(self.repeat[r]))

    def at(self, expected: Mapping[str, Array], name: str, factor: float = 1.0) -> Array:
        """Return an expected column at the sweep's frequencies times a factor, (p, f), NaN where it does not reach."""
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
                nearby_hz = np.clip(self.frequency_hz * factor, f[0], f[-1])
                inside = (self.frequency_hz >= f[0] - 1e-9) & (self.frequency_hz <= f[-1] + 1e-9)
                out[i] = np.where(inside, np.interp(nearby_hz, f, values), np.nan)
        return out

    def seen(self, distance: Array, sentence: Callable[[tuple[int, ...]], str]) -> "_Seen":
        """Return the groups beyond the threshold; sentence: of one of them, with its advice."""
        distance = np.nan_to_num(distance, nan=0.0, posinf=np.inf)
        places = [tuple(map(int, location)) for location in np.argwhere(distance > DOUBTED_FROM)]
        rows = [(float(distance[at]), self.where(at), partial(sentence, at)) for at in places]
        return _Seen(rows, int(np.isfinite(self.columns["gain_harmonic"]).sum()), "groups")


class _Seen(NamedTuple):
    """What one check saw: (distance, place, sentence) at each place; looked: at how many places, or groups, it did."""

    rows: Sequence[tuple[float, Location, Callable[[], str]]]
    looked: int
    of: str = "places"

    def doubt(self, kind: str) -> list[Doubt]:
        """Return the doubt of all places beyond the threshold, the worst first, with the sentence of the worst."""
        beyond = sorted((row for row in self.rows if row[0] > DOUBTED_FROM), key=lambda row: -row[0])
        if not beyond:
            return []
        of = f" ({len(beyond)} of {self.looked} {self.of})" if self.looked > 1 or self.of == "groups" else ""
        return [Doubt(kind, Rows(row[1] for row in beyond), beyond[0][2]() + of, beyond[0][0])]


_Checks = Iterator[tuple[str, _Seen]]
"""Kinds of doubts, and what was seen."""


def _lever_checks(sweep: _Sweep, rig: RigSpec, expected: Mapping[str, Array] | None) -> _Checks:
    """Yield where the lever did not go as far as its servo takes it, and where lever and torsion contradict each other.

    The servo's balance with the torsion as measured gives the lever. Where it is off, the lever is to blame if it is
    off against a held head, too, or against what the twin foretold while the torsion it brings about is as foretold;
    else the torsion is.
    """
    lever, command, gain = (sweep.columns["drive_amplitude_rad"], sweep.command, sweep.columns["gain_measured_drive"])
    lag, std = sweep.columns["phase_lag_rad"], sweep.columns["drive_amplitude_std_rad"]
    expected_lever, on_curve = np.full(command.shape[:2], np.nan), np.zeros(lever.shape, dtype=bool)
    if expected is not None:
        expected_lever = sweep.at(expected, "drive_amplitude_rad")
        on_curve = np.fmax(*_off_curve(sweep, expected)[0]) < DOUBTED_FROM
    blamed, contradicted, unsaturated, reach = (np.zeros(lever.shape) for _ in range(4))
    looked = np.isfinite(lever) & np.isfinite(command) & (command > 0)
    supply = np.nan_to_num(sweep.supply_v[looked]).tolist()
    supplied = {volts: _supplied(rig, volts) if volts > 0 else rig for volts in set(supply)}
    rigs = [supplied[volts] for volts in supply]
    head = np.where(np.isfinite(gain + lag), gain * np.exp(-1j * lag), 0.0)[looked]
    hertz = np.broadcast_to(sweep.frequency_hz[:, None], looked.shape)[looked]
    reached = drive_reaches(rigs, command[looked], hertz, head) if looked.any() else []
    for location, here, frequency, swung in zip(np.argwhere(looked), rigs, hertz.tolist(), reached, strict=True):
        at = tuple(map(int, location))
        reach[at], own = swung.amplitude_rad, math.hypot(_LEVER_STD, _ratio(std[at], lever[at]))
        by_head = _logs(lever[at], reach[at], own)
        if by_head > DOUBTED_FROM:
            held = drive_reach(here, float(command[at]), frequency).amplitude_rad
            by_held = _logs(lever[at], min(max(lever[at], _HELD_LOW * held), _HELD_HIGH * held), own)
            by_twin = _logs(lever[at], expected_lever[at[:2]], own)
            guilty = by_held > DOUBTED_FROM or (by_twin > DOUBTED_FROM and bool(on_curve[at]))
            (blamed if guilty else contradicted)[at] = by_head
        if "saturated_share" in sweep.columns and sweep.columns["saturated_share"][at] < 0.02:
            unsaturated[at] = swung.saturated_share / _SHARE_STD
    short = lever < reach
    if (blamed > 0).any():  # the same fault where it shows less
        same = (contradicted > 0) & (short == short[np.unravel_index(np.argmax(blamed), blamed.shape)])
        blamed, contradicted = np.where(same, contradicted, blamed), np.where(same, 0.0, contradicted)
    advice = {
        True: "look at the drive's PWM limit, goal PWM, profile and supply, and at what the lever may rub on",
        False: "look at the masses on the lever, the supply, the drive's model and the encoder's scale",
    }
    yield (
        "lever",
        sweep.seen(
            blamed,
            lambda at: (
                f"the lever went {_deg(lever[at])} of the {_deg(command[at])} asked for at {sweep.where(at)}; with the "
                f"head swinging as measured the drive reaches {_deg(reach[at])}: {advice[bool(short[at])]}"
            ),
        ),
    )
    yield (
        "torsion",
        sweep.seen(
            contradicted,
            lambda at: (
                f"lever and torsion contradict each other at {sweep.where(at)}: with a head that swings "
                f"{number(gain[at], 3)} times as far as the lever, the drive would move the lever by "
                f"{_deg(reach[at])}, it moved by {_deg(lever[at])}; look at the gyro's scale and axes, and at the "
                "lever's inertia in the rig"
            ),
        ),
    )
    yield (
        "saturation",
        sweep.seen(
            unsaturated,
            lambda at: (
                f"the drive's duty never touched its limit at {sweep.where(at)}, where the check has it there for "
                f"{100 * _SHARE_STD * unsaturated[at]:.0f} % of the time: look at the drive's PWM limit and goal PWM"
            ),
        ),
    )


def _supplied(rig: RigSpec, volts: float) -> RigSpec:
    """Return a rig whose drive is fed with so many volts."""
    supply = rig.drive.supply_voltage.model_copy(update={"value": float(volts)})
    return rig.model_copy(update={"drive": rig.drive.model_copy(update={"supply_voltage": supply})})


def _torsion_checks(sweep: _Sweep, signals: Signals) -> _Checks:
    """Yield where the torsion leads the lever, or lags by more than half a turn: a joint that gives energy away; where
    the lever moved and the head did not; and where another axis of the gyro swings more than x."""
    columns = sweep.columns
    lag, lever, size = columns["phase_lag_rad"], columns["drive_amplitude_rad"], columns["amplitude_rad"]
    known = (np.nan_to_num(columns[name]) ** 2 for name in ("phase_std_rad", "phase_delay_std_rad"))
    moving, beyond = lever > _MOVING_RAD, np.maximum(-lag, lag - math.pi)
    yield (
        "phase",
        sweep.seen(
            np.where(moving & (beyond > 0), beyond / np.sqrt(sum(known) + _LAG_STD**2), 0.0),
            lambda at: (
                f"the torsion lags the lever by {math.degrees(lag[at]):.0f}° at {sweep.where(at)}; a joint that takes "
                "energy lags by 0° to 180°: look at the signs of the gyro's axes and of the lever (wiring), and at the "
                "sensor delays of the rig"
            ),
        ),
    )
    yield (
        "silence",
        sweep.seen(
            np.where(moving & ~(size > DOUBTED_FROM * columns["amplitude_std_rad"]), np.inf, 0.0),
            lambda at: (
                f"the head does not answer at {sweep.where(at)}: the lever swings by {_deg(lever[at])}, the torsion is "
                "none beyond its noise; look at the IMU and at what couples lever and head"
            ),
        ),
    )
    if "gyro_rad_s" not in signals.recorded:
        return
    ratio, gyro = np.zeros(size.shape), signals.recorded["gyro_rad_s"]
    for at, where in sweep.groups:
        turns = gyro[where].astype(float)
        along, y, z = (turns - turns[0]).std(axis=0).tolist()  # a channel that stands still is then none
        ratio[at] = max(y, z) / along if along > 0 else math.inf if max(y, z) > 0 else 0.0
    yield (
        "axis",
        sweep.seen(
            np.where(moving & (ratio > 1.0), DOUBTED_FROM * np.maximum(ratio, 1.0), 0.0),
            lambda at: (
                f"the gyro turns {number(ratio[at], 2)} times as much about another axis of the head as about its x, "
                f"the joint's, at {sweep.where(at)}; look at imu_axes in the rig's wiring and at the chip's mounting"
            ),
        ),
    )


_Ends = tuple[Array, Array]


def _off_curve(sweep: _Sweep, expected: Mapping[str, Array]) -> tuple[_Ends, _Ends, _Ends]:
    """Return how far gain and lag lie from the foretold curve in standard uncertainties, (p, f, r) each, and the ends
    of what it takes within `_SHIFT` of their frequencies, (p, f, 1) each: of the gain, and of the lag [rad]."""
    gain, gain_std = sweep.columns["gain_measured_drive"], sweep.columns["gain_measured_drive_std"]
    lag, lag_std = sweep.columns["phase_lag_rad"], sweep.columns["phase_std_rad"]
    factors = np.linspace(1.0 - _SHIFT, 1.0 + _SHIFT, 5)
    curves, phases = (
        np.stack([sweep.at(expected, name, factor) for factor in factors])
        for name in ("gain_measured_drive", "phase_lag_rad")
    )
    low, high = curves.min(axis=0)[..., None], curves.max(axis=0)[..., None]
    first, last = phases.min(axis=0)[..., None], phases.max(axis=0)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        own = np.hypot(_GAIN_STD, np.nan_to_num(gain_std / gain))
        off = np.abs(np.log(gain / np.clip(gain, low, high))) / own
        turn = np.abs(np.angle(np.exp(1j * (lag - np.clip(lag, first, last))))) / np.hypot(_PHASE_STD, lag_std)
    return (off, turn), (low, high), (first, last)


def _curve_check(sweep: _Sweep, expected: Mapping[str, Array]) -> _Seen:
    """Return where gain or phase by the measured lever is far from the twin's curve.

    The curve may lie shifted by `_SHIFT` in frequency: what it takes in between is expected as well.
    """
    (off, turn), gains, lags = _off_curve(sweep, expected)

    def sentence(at: tuple[int, ...]) -> str:
        if turn[at] > off[at]:
            low, high = (f"{math.degrees(end[at[:2]][0]):.0f}" for end in lags)
            found, unit, what = f"a lag of {math.degrees(sweep.columns['phase_lag_rad'][at]):.0f}°", "°", "delays"
        else:
            low, high = (number(end[at[:2]][0], 3) for end in gains)
            found, unit, what = f"gain {number(sweep.columns['gain_measured_drive'][at], 3)}", "", "gyro"
        return (
            f"the curve is far from the rig's prediction: {found} at {sweep.where(at)}, expected {low} to {high}{unit}"
            f"; either the rig file is not this rig, or pretension, lever or {what} are not as it says"
        )

    return sweep.seen(np.fmax(off, turn), sentence)


def _resonance_checks(results: xr.Dataset, expected: Mapping[str, Array]) -> _Checks:
    """Yield where resonance or decay lie at another frequency than the twin's."""
    for name, spread, what in (
        ("resonance_measured_drive_hz", "resonance_measured_drive_std_hz", "the joint resonates"),
        ("decay_frequency_hz", "", "the free joint swings"),
    ):
        if name not in results:
            continue
        values = np.asarray(results[name].values, dtype=float)
        own = np.nan_to_num(results[spread].values) if spread else np.zeros(values.shape[0])
        value = values if values.ndim == 1 else mean_of_known(values)
        rows = []
        for mm, hz, std in zip(results["pretension_mm"].values.tolist(), value.tolist(), own.tolist(), strict=True):
            expected_hz = _expected_at(expected, name, mm)
            if math.isfinite(expected_hz) and math.isfinite(hz):
                text = (
                    f"{what} at {number(hz)} Hz at {mm:g} mm, expected {number(expected_hz)} Hz; look at pretension "
                    "and first contact, at the masses on the lever, and at the rig file"
                )
                distance = _logs(hz, expected_hz, math.hypot(_RESONANCE_STD, std / hz))
                rows.append((distance, Location(mm, math.nan, 0), partial(str, text)))
        yield "resonance", _Seen(rows, len(rows))


def _damping_checks(results: xr.Dataset, rig: RigSpec, expected: Mapping[str, Array] | None) -> _Checks:
    """Yield where Lehr's damping lies outside what the rig's losses can give, or far from the twin's."""
    if "damping_ratio" not in results:
        return
    ratio, own = results["damping_ratio"].values, results["damping_ratio_std"].values
    outside, far = [], []
    for p, r in np.argwhere(np.isfinite(ratio)).tolist():
        mm, value = float(results["pretension_mm"].values[p]), float(ratio[p, r])
        location, relative = Location(mm, math.nan, r), _ratio(float(own[p, r]), value)
        low, high = possible_damping(rig, float(results["decay_frequency_hz"].values[p, r]))
        distance = _logs(value, min(max(value, low), high), math.hypot(_LOSS_STD, relative))
        text = (
            f"D is {number(value, 3)} at {location}; silicone and guides of the rig can give {number(low, 2)} to "
            f"{number(high, 2)}: look at the drive (does it hold the lever?), at the guides, and at the rig file"
        )
        outside.append((math.inf if value <= 0 else distance, location, partial(str, text)))
        twins = _expected_at(expected or {}, "damping_ratio", mm)
        if math.isfinite(twins) and value > 0:
            text = f"D is {number(value, 3)} at {location}, the rig's prediction is {number(twins, 3)}"
            far.append((_logs(value, twins, math.hypot(_DAMPING_STD, relative)), location, partial(str, text)))
    yield "damping", _Seen(outside, len(outside))
    yield "damping", _Seen(far, len(far))


def _expected_at(expected: Mapping[str, Array], name: str, pretension_mm: float) -> float:
    """Return a foretold number at a pretension, NaN where it was not foretold."""
    if name not in expected or "pretension_mm" not in expected:
        return math.nan
    row = np.flatnonzero(np.abs(expected["pretension_mm"] - pretension_mm) < 1e-6)
    return float(expected[name][row[0]]) if row.size else math.nan


def possible_damping(rig: RigSpec, frequency_hz: float) -> tuple[float, float]:
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


def group_doubts(rig: RigSpec, segment: Segment, time_s: Array, drive_rad: Array, gyro_rad_s: Array) -> list[str]:
    """Return what can be said against a steady group while its run goes on, in sentences.

    time_s, drive_rad: (n,); gyro_rad_s: about the joint's axis, (n,); NaN where a reading did not come. The lever is
    held against half of what it reaches against a held head, for in resonance the head takes up to half.
    """
    known = np.isfinite(time_s) & np.isfinite(drive_rad) & np.isfinite(gyro_rad_s)
    command = math.radians(segment.amplitude_deg)
    if segment.kind != "steady" or known.sum() < _FROZEN_SAMPLES or not command > _MOVING_RAD:
        return []
    time, lever, rate = time_s[known], drive_rad[known], gyro_rad_s[known]
    phase = 2.0 * np.pi * segment.frequency_hz * (time - time[0])
    design = np.stack([np.cos(phase), np.sin(phase), np.ones_like(phase)], axis=1)
    wave = np.linalg.lstsq(design, lever, rcond=None)[0]
    amplitude = float(np.hypot(wave[0], wave[1]))
    location, found = Location(segment.pretension_mm, segment.frequency_hz, segment.repeat), []
    least = _HELD_LOW * drive_reach(rig, command, segment.frequency_hz).amplitude_rad
    if amplitude < least and _logs(amplitude, least, _LEVER_STD) > DOUBTED_FROM:
        found.append(
            f"the lever went {_deg(amplitude)} of the {_deg(command)} asked for at {location}, the drive reaches "
            f"{_deg(2.0 * least)} against a held head: look at its PWM limit, goal PWM, profile and supply"
        )
    step = float(np.median(np.diff(time)))
    for words, values, share in (("the gyro", rate, _FROZEN_SHARE), ("the drive's encoder", lever, 1.0)):
        longest = _longest_row(values[:, None], _near(values[:, None]))
        if longest > max(_FROZEN_SAMPLES, share / (step * segment.frequency_hz)):
            found.append(
                f"{words} repeats one value for {longest * step:.2g} s at {location}: look at it and its cable"
            )
    return found


def _frozen_checks(signals: Signals) -> _Checks:
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
    driven = [(one, where) for one, where in signals.of_kind("steady") if _is_driven(one)]
    second = round(rate)
    ringing = [
        (one, slice(where.start, min(where.stop, where.start + second)))
        for one, where in signals.of_kind("ring-down")
        if _is_driven(one)
    ]
    for name, words, share in (
        ("gyro_rad_s", "the gyro", _FROZEN_SHARE),
        ("acceleration_m_s2", "the accelerometer", _FROZEN_SHARE),
        ("drive_rad", "the drive's encoder", 1.0),
        ("drive_current_a", "the drive's current", 1.0),
        ("drive_pwm", "the drive's duty", 1.0),
    ):
        looked = driven + ringing if share < 1.0 else driven  # in a ring-down the lever stands
        if name not in recorded or not looked or (name == "acceleration_m_s2" and not noisy):
            continue
        values = recorded[name][:, :1] if name == "gyro_rad_s" else recorded[name].reshape(recorded[name].shape[0], -1)
        if name in ("drive_current_a", "drive_pwm") and not np.ptp(values) > 0:
            continue
        rows, near = [], _near(values)
        for segment, where in looked:
            needed = max(_FROZEN_SAMPLES, share * rate / segment.frequency_hz)
            longest = _longest_row(values[where], near)
            if longest > needed:
                location = Location(segment.pretension_mm, segment.frequency_hz, segment.repeat)
                text = (
                    f"{words} repeats one value for {longest / rate:.2g} s at {location}, while the lever is driven: "
                    "look at the sensor, its cable and its firmware"
                )
                rows.append((DOUBTED_FROM * longest / needed, location, partial(str, text)))
        yield "frozen", _Seen(rows, len(looked))


def _is_driven(segment: Segment) -> bool:
    return segment.amplitude_deg > math.degrees(_MOVING_RAD) and segment.frequency_hz > 0


def _near(values: Array) -> Array:
    """Return how far two samples of an axis may lie apart and be equal: readings that were brought onto other times by
    interpolation are equal but for their last bits."""
    return np.asarray(_SAME * np.abs(values).max(axis=0), dtype=float)


def _longest_row(values: Array, near: Array) -> int:
    """Return how many samples in a row repeat one value at most, on all axes of (n, axes) at once."""
    same = (np.abs(np.diff(values, axis=0)) <= near).all(axis=1)
    edges = np.flatnonzero(np.diff(same, prepend=False, append=False))
    return 1 + int((edges[1::2] - edges[::2]).max(initial=0))


def _pretension_check(signals: Signals, rig: RigSpec) -> _Seen:
    """Return where the tendon motors do not stand where the pretension has them, against the least one of the
    recording.

    Motor angle times pulley radius, plus what the servo yields under its tension (current times torque constant by
    radius and servo stiffness). Tendons that are held by current follow the joint, and are not looked at.
    """
    mode, recorded, tendons = _tendon_mode(signals.attrs), signals.recorded, rig.tendons
    found: dict[float, list[float]] = {}
    if {"tendon_rad", "tendon_current_a"} <= set(recorded) and mode.startswith("position"):
        per_ampere = tendons.tension(1.0) / tendons.servo_stiffness.value
        for segment, where in signals.segments:
            if segment.kind in ("steady", "ring-down"):
                angle, current = (recorded[name][where].mean() for name in ("tendon_rad", "tendon_current_a"))
                pulled = tendons.pulley_radius.value * angle + per_ampere * current
                found.setdefault(segment.pretension_mm, []).append(1e3 * float(pulled))
    rows = []
    for mm, values in found.items() if len(found) > 1 else ():
        least = min(found)
        wanted, pulled = mm - least, float(np.median(values) - np.median(found[least]))
        text = (
            f"the tendon motors stand {number(pulled, 3)} mm from where they stood at {least:g} mm, at {mm:g} mm they "
            f"should by {number(wanted, 3)} mm: look for a slipped pulley, another radius, or a motor that was turned"
        )
        distance = abs(pulled - wanted) / math.hypot(_PRETENSION_STD_MM, _PRETENSION_STD * wanted)
        rows.append((distance, Location(mm, math.nan, 0), partial(str, text)))
    return _Seen(rows, len(rows))


def _tendon_mode(attrs: Mapping[Any, Any]) -> str:
    """Return how the tendons were held, by the recording's plan; empty where it has none."""
    text = str(attrs.get("plan", ""))
    try:
        return parse_plan(text).pretension.mode if text.strip() else ""
    except SinewError:
        return ""


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
