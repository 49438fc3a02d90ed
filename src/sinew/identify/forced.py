"""Forced response from a fit: its law under a drive of several levels, with the bands that its intervals give.

A fit tells a law over the inertia,

    r'' + law(r, r') = g a,    a = L sin Ωt of a push, L Ω² sin Ωt of a moving base,

r being the motion, against the base where that moves. The gain g of a push is known of a driven record. A free decay
has none: the inertia is not in it, nor anything that a push of one unit does. One measured steady motion gives it, for
at its frequency and amplitude the law says how large the push over the inertia was. The response to other levels
follows, in the units of the record, whatever they are. A base that moves in the motion's own unit has a gain of one.

Bands are of draws: laws as likely as the fit's covariance says (Student's), each with the gain that leads it through
the measured point, itself drawn by its standard deviation. So what the point pins down is narrow near it.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, cast

import jax
import numpy as np

from sinew.identify.oscillation import Laws, driven, push_needed
from sinew.identify.oscillator.model import Fit, Fitted, Model, free_mechanics, get_model, reached
from sinew.identify.oscillator.record import Excitation, derivative_order, relaxation_of
from sinew.identify.steady_fit import ResponseFit
from sinew.measure.arrays import Array
from sinew.measure.errors import FileError, RecordingError, SpecError
from sinew.measure.estimate import Estimate, finite, interval, number
from sinew.measure.result import Column, Field, Result, Table
from sinew.measure.units import convert, with_unit
from sinew.mechanics.laws import NUMBERS, Cycle, LossFactor
from sinew.mechanics.silicone import relaxation_times
from sinew.predict.band import Band, Marked, Tube, band_of, estimate_of_deviations, factor_of
from sinew.predict.oscillator import resolution_for
from sinew.solve.branch import Branch, Mark
from sinew.solve.curves import Problem, Resolution
from sinew.solve.curves import predict as follow
from sinew.solve.examination import largest_multiplier, maps_of, rows_of
from sinew.solve.programs import configure

Kind = Literal["torque", "base"]
Progress = Callable[[float, float], None]

# What a fit says of its law is put down, so that a file holds it.


@dataclass(frozen=True, repr=False)
class Mechanics(Result):
    """A law over the inertia, as a fit knows it, and as a file of it holds it.

    model: its name in `sn.MODELS`. excitation: of the record. unit: of the motion; input_unit: of the input, of a base
    or lever that of its motion. numbers: the law's, k of them, and gain where there is one, SI. covariance: shape
    (k, k), infinite where the record tells nothing. degrees_of_freedom: behind it. largest: amplitude of the motion
    that was seen, NaN where none was. unit_said, input_unit_said: what people have both in; "" where nobody said.
    """

    model: Annotated[str, Field("", "detail")]
    excitation: Annotated[Excitation, Field("", "detail")]
    unit: Annotated[str, Field("", "detail")]
    input_unit: Annotated[str, Field("", "detail")]
    numbers: Annotated[Mapping[str, float], Field("", "detail")]
    covariance: Column
    degrees_of_freedom: Annotated[float, Field("", "detail")]
    largest: Annotated[float, Field("", "detail")]
    unit_said: Annotated[str, Field("", "detail")] = ""
    input_unit_said: Annotated[str, Field("", "detail")] = ""

    @property
    def values(self) -> Array:
        """Return the numbers, shape (k,)."""
        return np.array(list(self.numbers.values()), dtype=float)

    def value(self, name: str) -> float:
        """Return one number; zero for one that the law has not."""
        return self.numbers.get(name, 0.0)


def mechanics_of(fit: Fitted) -> Mechanics:
    """Return what a fit, in time or to steady states, says of its law."""
    assert isinstance(fit, (Fit, ResponseFit))
    layout = fit.layout.layout if isinstance(fit, ResponseFit) else fit.layout
    part = layout.parts[0]
    record, sought = part.record, free_mechanics(layout.model, part.record)
    own = [k for k, one in enumerate(layout.entries) if one.local in sought]
    names = [layout.entries[k].local for k in own]
    scale = np.array([part.scales.physical(name) for name in names])
    return Mechanics(
        layout.model.name,
        record.excitation,
        record.motion_unit,
        record.input_motion_unit,
        dict(zip(names, (fit.solution.values[own] * scale).tolist(), strict=True)),
        fit.covariance.matrix[np.ix_(own, own)] * np.outer(scale, scale),
        float(fit.covariance.degrees_of_freedom),
        _largest(fit),
        record.motion_said,
        record.input_motion_said,
    )


def _largest(fit: Fit | ResponseFit) -> float:
    if isinstance(fit, Fit):
        return max(reached(fit, i) for i in range(len(fit.records)))
    moving = [
        np.abs(one.response) * one.input_amplitude / (2 * np.pi * one.frequency_hz) ** derivative_order(one.output_unit)
        for one in fit.points
    ]
    return float(max(one.max() for one in moving))


def read_mechanics(source: Mapping[str, Any] | str | Path) -> Mechanics:
    """Return the law in a document of `sinew identify`, or in the file of one.

    Raises FileError for a file that cannot be read, SpecError for a document that holds no such law.
    """
    name, document = "the document", source
    if not isinstance(source, Mapping):
        name = Path(source).name
        try:
            document = json.loads(Path(source).read_text(encoding="utf-8"))
        except OSError as error:
            raise FileError(f"cannot read {source}: {error.strerror or error}") from error
        except ValueError as error:
            raise FileError(f"{name} is not JSON ({error}); expected fit.json of sinew identify --out") from error
    if not isinstance(document, Mapping) or "model" not in document:
        raise SpecError(f"{name} is no fit; expected fit.json, which sinew identify --out writes, or its --json")
    if document["model"] == "tendon":
        raise SpecError(
            f"{name} is the fit of a whole tendon joint; make a rig of the recording with sinew calibrate and predict "
            "that"
        )
    if document.get("mechanics") is None:
        raise SpecError(f"{name} does not hold its mechanics with their covariance; identify anew")
    known = Mechanics.from_dict({"model": document["model"], **document["mechanics"]})
    if math.isnan(known.largest):
        raise SpecError(
            f"{name} does not say how far its motion went: a rate was recorded, and no spring gives it a frequency; "
            "no resonance follows from it"
        )
    unknown = [[np.inf if one is None else one for one in row] for row in known.covariance]
    return replace(known, covariance=np.array(unknown, dtype=float))


# What is asked of it.


class Through(NamedTuple):
    """A measured steady motion: frequency [Hz], amplitude (half of peak to peak, in the motion's unit) and its standard
    deviation, zero where it is not known; level: of the drive there, None for the first that is asked for."""

    frequency_hz: float
    amplitude: float
    std: float = 0.0
    level: float | None = None


@dataclass(frozen=True)
class Level:
    """The response to one level of the drive, in the units of the fit, and how far it can be off."""

    level: float
    branch: Branch
    band: Band


class Shown(NamedTuple):
    """How numbers are shown: what they are multiplied by, and the unit that they have then."""

    factor: float = 1.0
    unit: str = "1"

    def of(self, value: float) -> str:
        """Return a number with its unit."""
        return number(self.factor * value, unit="" if self.unit == "1" else self.unit)


def shown_in(unit: str, said: str = "") -> Shown:
    """Return how numbers in an SI unit are shown: in the unit that was said; where nobody said, angles in degrees."""
    if said:
        return Shown(1 / convert(said, unit), said)
    return Shown(math.degrees(1.0), "deg") if unit == "rad" else Shown(1.0, unit)


def drive_shown(known: Mechanics, kind: Kind, unit: str = "", *, through: bool) -> Shown:
    """Return how levels of a drive are said and shown: with a measured point in any unit, else in that of the record's
    input, or of its motion; unless `unit` is given, an angle of a base in degrees (`--base-deg`)."""
    if through:
        return Shown(1.0, unit or "1")
    alike = known.excitation in (("base", "lever") if kind == "base" else ("force", "torque"))
    own, said = (known.input_unit, known.input_unit_said) if alike else (known.unit, known.unit_said)
    return shown_in(own, unit or ("" if kind == "base" and own == "rad" else said))


@dataclass(frozen=True, repr=False)
class Forced(Result):
    """What a fit is predicted to do under several levels of a drive.

    mechanics: its law. kind: of the drive. levels: curves with bands, in the units of the fit. gain: acceleration of
    the motion by a unit of the drive, in the motion's unit per s² of a push, 1 of a base. through: the point it is
    from. motion, drive: how amplitudes and levels are shown. remarks: sentences.
    """

    mechanics: Mechanics
    kind: Kind
    levels: tuple[Level, ...]
    gain: Estimate
    through: Through | None
    count: int
    seed: int
    motion: Shown
    drive: Shown
    error_estimate: float
    harmonics: int
    remarks: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON holds it, amplitudes and levels as they are shown."""
        through = None
        if self.through is not None:
            through = {
                "frequency_hz": self.through.frequency_hz,
                "amplitude": self.motion.factor * self.through.amplitude,
                "std": self.motion.factor * self.through.std,
                "level": self.drive.factor * cast(float, self.through.level),
            }
        return {
            "model": self.mechanics.model,
            "unit": self.motion.unit,
            "drive": {"kind": self.kind, "unit": self.drive.unit, "gain": self.gain.to_json()},
            "through": through,
            "levels": [
                {"level": self.drive.factor * one.level}
                | _curve(one.branch, self.motion.factor)
                | {"band": _band(one.band, self.motion.factor)}
                for one in self.levels
            ],
            "harmonics": self.harmonics,
            "error_estimate": self.error_estimate,
            "draws": {"count": self.count, "seed": self.seed},
            "remarks": list(self.remarks),
        }

    def blocks(self) -> list[Table | str]:
        """Return a row for each level, with 90 % intervals, and what to know of them."""
        title = f"forced response of model {self.mechanics.model}, 90 % intervals from {self.count} draws"
        drive, amplitude = (
            with_unit(what, one.unit) for what, one in ((self.kind, self.drive), ("amplitude", self.motion))
        )
        rows = []
        for level in self.levels:
            band, shown = level.band, number(self.drive.factor * level.level)
            places = (("peak", band.peak), ("90° of phase", band.phase_90), *(("fold", fold) for fold in band.folds))
            rows += [(shown, words, *_intervals(mark, self.motion.factor)) for words, mark in places]
        return [
            Table((drive, "at", "frequency/Hz", amplitude), rows, title),
            *(f"- {sentence}" for sentence in self.remarks),
            f"{self.harmonics} harmonics, error estimate {self.error_estimate:.1e}",
        ]


def predict_fit(
    fit: Mechanics | Mapping[str, Any] | str | Path,
    *,
    torque: float | Sequence[float] | None = None,
    base: float | Sequence[float] | None = None,
    through: Through | Sequence[float] | None = None,
    band_hz: tuple[float, float] | None = None,
    draws: int = 100,
    seed: int = 0,
    motion: Shown | None = None,
    drive: Shown | None = None,
    progress: Progress | None = None,
) -> Forced:
    """Return the steady response of a fitted law to levels of a drive, with 90 % bands.

    fit: its mechanics, the document of an identification, or the path of its fit.json.
    torque: amplitudes of what pushes (a torque, a force, a voltage), in the unit that the record's input was read in,
    or, with `through`, in any. base: amplitudes by which the base (or lever) moves instead, an angle in degrees. Both
    as --torque and --base of `sinew predict`.
    through: (frequency [Hz], amplitude, its standard deviation, level) of one measured steady motion, which gives the
    drive's gain; the last two may be left out. Amplitudes are half of peak to peak, in SI and radians as the fit's.
    band_hz: frequencies; else from a third of the natural frequency to twice it. draws, seed: of the bands.
    motion, drive: how amplitudes and levels are shown. progress: called with (done, total).
    Raises SpecError where the fit does not determine what is asked, RecordingError where the point cannot be met.
    """
    configure()
    known = fit if isinstance(fit, Mechanics) else read_mechanics(fit)
    kind, drives = _kind_of(torque, base)
    shown = motion or shown_in(known.unit, known.unit_said)
    at = drive or drive_shown(known, kind, through=through is not None)
    levels = drives / at.factor
    point = None if through is None else _checked(Through(*through), levels, shown)
    model = _model_of(known)
    numbers = _numbers_of(known, model, wanted=_gain_from(known, kind, point) == "fit")
    natural = math.sqrt(numbers.value("stiffness")) / (2 * np.pi)
    band = (natural / 3, 2 * natural) if band_hz is None else (float(band_hz[0]), float(band_hz[1]))
    if not 0 < band[0] < band[1] < np.inf:
        raise SpecError(f"found a band from {band[0]:g} to {band[1]:g} Hz, expected two positive ones, the lower first")
    if draws < _FEWEST_DRAWS:
        raise SpecError(f"found {draws} draws, expected {_FEWEST_DRAWS} or more: a 90 % band is of their quantiles")
    rng = np.random.default_rng(seed)
    drawn, remarks = _drawn(numbers, draws, rng)
    values = np.concatenate([numbers.values[None], drawn])
    normal = _Normal.of(numbers, model)
    gains, said = _gains(normal, values, kind, point, rng, shown)
    values, gains = values[np.isfinite(gains)], gains[np.isfinite(gains)]
    found = _levels(normal, values, gains, kind, levels, band, progress)
    sentences = (*_undetermined(known, kind, point, gains), *remarks, *said)
    sentences += tuple(
        _extrapolated(known, one, shown, at) for one in found.levels if _reach(one) > _BEYOND * known.largest
    )
    return Forced(
        mechanics=known,
        kind=kind,
        levels=found.levels,
        gain=estimate_of_deviations(float(gains[0]), gains[1:] - gains[0]),
        through=point,
        count=len(gains) - 1,
        seed=seed,
        motion=shown,
        drive=at,
        error_estimate=found.error,
        harmonics=found.harmonics,
        remarks=(*sentences, *_of_bands(found.levels, at)),
    )


_FEWEST_DRAWS = 20
_BEYOND = 1.2  # of the largest amplitude that was seen: from there on a law is extrapolated
_TRIES = 200


def _kind_of(torque: float | Sequence[float] | None, base: float | Sequence[float] | None) -> tuple[Kind, Array]:
    if (torque is None) == (base is None):
        raise SpecError("say what drives it: either torque, the levels of what pushes, or base, by how much that moves")
    kind: Kind = "base" if torque is None else "torque"
    levels = np.atleast_1d(np.asarray(base if torque is None else torque, dtype=float))
    if not levels.size or not np.all(np.isfinite(levels) & (levels > 0)):
        raise SpecError(f"found levels {levels.tolist()}, expected one positive amplitude or more")
    return kind, levels


def _checked(point: Through, levels: Array, motion: Shown) -> Through:
    level = float(levels[0]) if point.level is None else float(point.level)
    for name, value in (("frequency", point.frequency_hz), ("amplitude", point.amplitude), ("level", level)):
        if not (math.isfinite(value) and value > 0):
            raise SpecError(f"the measured point has a {name} of {value:g}, expected a positive number")
    if not 0 <= point.std < 0.5 * point.amplitude:
        raise SpecError(
            f"the measured amplitude is {motion.of(point.amplitude)} with a standard deviation of "
            f"{motion.of(point.std)}, expected one from zero to half of it"
        )
    return point._replace(level=level)


def _model_of(known: Mechanics) -> Model:
    model = get_model(known.model)
    if held := [one.lost for one in model.law.terms if one.history is not None and not isinstance(one, LossFactor)]:
        raise SpecError(
            f"{held[0]} has an inner state, which the harmonic balance of a steady response does not follow; identify "
            "with drag or coulomb"
        )
    return model


def _gain_from(known: Mechanics, kind: Kind, point: Through | None) -> Literal["point", "fit", "unit"]:
    """Return where the drive's gain is from: the measured point, the fit, or the unit that base and motion share.

    Raises SpecError where neither fit nor point say what a unit of the drive does.
    """
    if point is not None:
        return "point"
    alike = ("force", "torque") if kind == "torque" else ("base", "lever")
    if known.excitation in alike and "gain" in known.numbers:
        return "fit"
    if kind == "base":
        return "unit"
    what = "a free decay" if known.excitation == "none" else f"a record that was driven by its {known.excitation}"
    raise SpecError(
        f"{what} does not determine the inertia, so not what a push of one unit does; give one measured steady "
        "motion with --through FREQ:AMPLITUDE, or drive the base with --base"
    )


def _numbers_of(known: Mechanics, model: Model, *, wanted: bool) -> Mechanics:
    """Return the fit with the numbers that matter, sound. wanted: whether the gain does.

    A loss beside another one may have come out below zero by chance: then it is not there, as far as the record tells.
    Raises SpecError where a number is not known, or cannot be.
    """
    lost = {number.name for term in model.law.losses.terms for number in term.numbers}
    positions = [k for k, name in enumerate(known.numbers) if name != "gain" or wanted]
    covariance = known.covariance[np.ix_(positions, positions)]
    numbers = {name: value for name, value in known.numbers.items() if name != "gain" or wanted}
    for (name, value), variance in zip(known.numbers.items(), np.diag(known.covariance), strict=True):
        if name not in numbers:
            continue
        word = NUMBERS[name].word if name in NUMBERS else "gain"
        if not (np.isfinite(value) and np.isfinite(variance)):
            raise SpecError(f"this fit does not determine the {word}, so no response follows from it; record more")
        if name in NUMBERS and NUMBERS[name].positive and value <= 0:
            if len(lost) > 1 and name in lost and value + 2 * math.sqrt(variance) > 0:
                numbers[name] = 0.0
            else:
                raise SpecError(
                    f"the {word} of this fit is {value:.3g}, which nothing has; identify with another model"
                )
    return replace(known, numbers=numbers, covariance=covariance)


def _drawn(known: Mechanics, count: int, rng: np.random.Generator) -> tuple[Array, list[str]]:
    """Return laws as likely as the fit says, (count, k), and what to know of them."""
    factor, drawn, tried = factor_of(known.covariance), np.zeros((0, known.values.size)), 0
    positive = np.array([name in NUMBERS and NUMBERS[name].positive for name in known.numbers])
    freedom = known.degrees_of_freedom
    while len(drawn) < count:
        tried += count
        if tried > _TRIES * count:
            raise SpecError("hardly any law that is as likely as the fit says can be: its numbers are too uncertain")
        widened = np.sqrt(freedom / rng.chisquare(freedom, (count, 1)))
        some = known.values + widened * (rng.standard_normal((count, known.values.size)) @ factor.T)
        drawn = np.concatenate([drawn, some[np.all((some > 0) | ~positive, axis=1)]])
    lines = []
    if tried > 2 * count:
        lines.append("more than half of the laws drawn had a damping or stiffness below zero and were drawn again")
    return drawn[:count], lines


@dataclass(frozen=True)
class _Normal:
    """The normal form of laws: what counts time [rad/s] and motion, and which numbers stand where."""

    known: Mechanics
    model: Model
    laws: Laws
    omega: float

    @staticmethod
    def of(known: Mechanics, model: Model) -> "_Normal":
        omega = math.sqrt(known.value("stiffness"))
        natural = float(relaxation_of(omega)[0] * omega / relaxation_times()[0])
        return _Normal(known, model, Laws(model.law, natural, known.largest), omega)

    @property
    def size(self) -> float:
        """Return the unit of motion A."""
        return self.known.largest

    def numbers(self, values: Array) -> Array:
        """Return numbers as `sinew.identify.oscillation` takes them, with a gain of one, (n, l)."""
        found = np.zeros((len(values), len(self.laws.names)))
        for column, name in zip(values.T, self.known.numbers, strict=True):
            if name in NUMBERS:
                fast, far = NUMBERS[name].scale
                found[:, self.laws.names.index(name)] = column / (self.omega**fast * self.size**far)
        found[:, -1] = 1.0
        return found

    def swing(self, push: float, power: int) -> float:
        """Return about how far the law swings at resonance, in its unit: where it loses what the push brings.

        push: acceleration, over (Ω/ω_r)^power.
        """
        given: dict[str, Any] = {name: self.known.value(name) for name in NUMBERS} | {"amplitude": 1.0}
        reach = self.size * np.geomspace(1e-5, 1e4, 400)
        u = (np.arange(64) + 0.5) / 64 * np.pi - 0.5 * np.pi
        position = reach[:, None] * np.sin(u)
        springs = self.model.law.springs
        force = np.asarray(springs.force(given, position, 0.0 * position), dtype=float)
        stiffness = 2 / 64 * np.sum(force * np.sin(u), axis=1) / reach
        omega = np.sqrt(np.maximum(stiffness, 0.01 * self.omega**2))
        speed = omega[:, None] * reach[:, None] * np.cos(u)
        cycle = Cycle(reach, position, speed, reach[:, None] * np.cos(u) * np.pi / 64)
        lost = self.model.law.losses.dissipated(given, cycle)
        brought = np.pi * push * (omega / self.omega) ** power * reach
        enough = lost >= brought
        if given["coulomb"] and not np.any(~enough):
            return float(push / self.omega**2)
        first = np.flatnonzero(enough & (np.arange(reach.size) >= np.argmin(enough)))
        return float(reach[first[0] if first.size else -1])


def _gains(
    normal: _Normal, values: Array, kind: Kind, point: Through | None, rng: np.random.Generator, motion: Shown
) -> tuple[Array, list[str]]:
    """Return the gain of each law, (n,), NaN where a drawn one does not reach the point, and sentences."""
    known = normal.known
    if point is None:
        if "gain" in known.numbers:
            return np.abs(values[:, list(known.numbers).index("gain")]), []
        return np.ones(len(values)), []
    omega = 2 * np.pi * point.frequency_hz / normal.omega
    amplitude = np.full(len(values), point.amplitude)
    amplitude[1:] += point.std * rng.standard_normal(len(values) - 1)
    push, x, lane = push_needed(normal.numbers(values), omega, amplitude / normal.size, normal.laws)
    if not np.isfinite(push[0]) or push[0] <= 0:
        raise RecordingError(
            f"the law of this fit has no steady motion of {motion.of(point.amplitude)} at {point.frequency_hz:g} Hz; "
            "check the point's unit, or measure one nearer to the amplitudes of the record"
        )
    per = normal.size * normal.omega**2 / cast(float, point.level)
    gains = push * per / ((2 * np.pi * point.frequency_hz) ** 2 if kind == "base" else 1.0)
    lines = []
    if point.std == 0:
        lines.append(
            "the measured point is taken as exact; give the standard deviation of its amplitude, as in "
            "--through 3:12+-0.2, and the bands hold it"
        )
    first = np.zeros(1, dtype=np.intp)
    disturbed = maps_of(x[:1], rows_of(lane, first), normal.laws.equations, normal.laws.size)
    if largest_multiplier(disturbed, normal.laws.equations)[0] > 1 + 1e-6:
        lines.append(
            "by this law the measured motion would be unstable, so it cannot have been measured: check the point, or "
            "the law"
        )
    if lost := int(np.sum(~np.isfinite(push))):
        lines.append(f"{lost} of {len(push) - 1} laws drawn do not reach the measured point and were left out")
    return gains, lines


class _Gains(NamedTuple):
    levels: tuple[Level, ...]
    error: float
    harmonics: int


def _levels(
    normal: _Normal,
    values: Array,
    gains: Array,
    kind: Kind,
    levels: Array,
    band_hz: tuple[float, float],
    progress: Progress | None,
) -> _Gains:
    """Return the curve and the band of every level. values: of laws, the first the fit's own; gains: of them."""
    laws, power = normal.laws, 2 if kind == "base" else 0
    numbers = normal.numbers(values)
    lopsided = laws.equations.coordinates[0].parity == "all"
    fine = resolution_for(dry=laws.law.sticks, lopsided=lopsided)
    coarse = Resolution(((fine.sizes[0][0], fine.sizes[0][0]),), np.inf, stability=False)
    hertz = normal.omega / laws.natural
    window = (band_hz[0] / hertz, band_hz[1] / hertz)
    # Of a base the push in normal form is g b (Ω/ω_r)², of a torque g M/ω_r².
    pushes = np.outer(levels, gains) / normal.size / (1.0 if power else normal.omega**2)
    found, done, error, harmonics = [], 0, 0.0, 0
    for level, push in zip(levels, pushes, strict=True):
        scale = normal.swing(float(push[0]) * normal.size * normal.omega**2, power) / normal.size
        problem = driven(numbers, push, power, laws, np.full(push.size, scale))
        branch = follow(_some(problem, 0, 1), window, fine)
        error, harmonics = max(error, branch.error_estimate), max(harmonics, branch.harmonics)
        nominal, drawn = _physical(branch.branches[0], hertz, normal.size), list[Branch]()
        for begin in range(0, push.size, _TOGETHER):
            some = follow(_some(problem, begin, begin + _TOGETHER), window, coarse).branches
            drawn += [_physical(one, hertz, normal.size) for one in some]
            done += len(some)
            if progress is not None:
                progress(done, pushes.size)
        found.append(Level(float(level), nominal, band_of(nominal, drawn[0], drawn[1:])))
    return _Gains(tuple(found), error, harmonics)


_TOGETHER = 32


def _some(problem: Problem, begin: int, end: int) -> Problem:
    lane = jax.tree.map(lambda leaf: np.asarray(leaf)[begin:end], problem.lane)
    return problem._replace(lane=lane, rest=problem.rest[begin:end])


def _physical(branch: Branch, hertz: float, size: float) -> Branch:
    """Return a curve in Hz and in the unit of the motion."""

    def mark(one: Mark) -> Mark:
        return Mark(one.frequency_hz * hertz, one.amplitude * size, one.phase)

    return replace(
        branch,
        frequency_hz=branch.frequency_hz * hertz,
        amplitude=branch.amplitude * size,
        harmonics=branch.harmonics * size,
        folds=tuple(map(mark, branch.folds)),
        peak=None if branch.peak is None else mark(branch.peak),
        phase_90=None if branch.phase_90 is None else mark(branch.phase_90),
    )


# What it is worth, in words.


def _undetermined(known: Mechanics, kind: Kind, point: Through | None, gains: Array) -> tuple[str, ...]:
    """Return what the fit does not determine, and where what was needed of it is from."""
    if known.excitation == "none" and kind == "torque":
        off = float(np.std(gains[1:], ddof=1) / gains[0])
        return (
            "the free decay does not determine the inertia: stiffness and damping are known over it alone; what one "
            f"unit of the drive does is from the measured point, to {100 * off:.2g} %",
        )
    if point is None and kind == "base":
        return ("amplitudes are those of the motion against the base",)
    return ()


def _reach(one: Level) -> float:
    return float(np.max(one.branch.amplitude, initial=0.0))


def _extrapolated(known: Mechanics, one: Level, motion: Shown, drive: Shown) -> str:
    return (
        f"at {drive.of(one.level)} it swings by {motion.of(_reach(one))}, the record went to "
        f"{motion.of(known.largest)}: beyond that the law is extrapolated"
    )


def _of_bands(levels: Sequence[Level], drive: Shown) -> tuple[str, ...]:
    lines = []
    for one in levels:
        where = f"at {drive.of(one.level)}"
        if not one.branch.complete or "not" in one.branch.message:
            lines.append(f"{where} {one.branch.message}")
        if one.branch.peak is None:
            lines.append(f"{where} there is no peak inside the band of frequencies; widen it")
        if lost := one.band.draws - one.band.complete:
            lines.append(f"{where} {lost} of {one.band.draws} draws do not reach the end of the band")
        if 0 < one.band.folded < one.band.draws:
            lines.append(f"{where} {one.band.folded} of {one.band.draws} draws have folds")
    return tuple(lines)


# It becomes JSON.


def _mark(one: Mark | None, factor: float) -> dict[str, float] | None:
    return None if one is None else {"frequency_hz": one.frequency_hz, "amplitude": factor * one.amplitude}


def _curve(branch: Branch, factor: float) -> dict[str, Any]:
    return {
        "frequency_hz": branch.frequency_hz.tolist(),
        "amplitude": (factor * branch.amplitude).tolist(),
        "fundamental": (factor * branch.fundamental).tolist(),
        "phase_deg": np.degrees(branch.phase).tolist(),
        "stable": branch.stable.tolist(),
        "folds": [_mark(fold, factor) for fold in branch.folds],
        "peak": _mark(branch.peak, factor),
        "phase_90": _mark(branch.phase_90, factor),
        "complete": branch.complete,
        "message": branch.message,
    }


def _band(band: Band, factor: float) -> dict[str, Any]:
    def tube(one: Tube, by: float) -> dict[str, Any]:
        return {name: [finite(by * x) for x in getattr(one, name)] for name in ("low", "median", "high")}

    def marked(one: Marked | None) -> dict[str, Any] | None:
        if one is None:
            return None
        amplitude = one.amplitude.times(factor).to_json()
        return {"frequency_hz": one.frequency_hz.to_json(), "amplitude": amplitude, "draws": one.draws}

    sweeps = {
        name: {"amplitude": tube(tubes[0], factor), "phase_deg": tube(tubes[1], math.degrees(1.0))}
        for name, tubes in (("up", band.up), ("down", band.down))
    }
    return {
        "frequency_hz": band.frequency_hz.tolist(),
        **sweeps,
        "peak": marked(band.peak),
        "phase_90": marked(band.phase_90),
        "folds": [marked(fold) for fold in band.folds],
        "draws": band.draws,
        "complete": band.complete,
        "folded": band.folded,
    }


def _intervals(mark: Marked | None, factor: float) -> tuple[str, str]:
    if mark is None:
        return "-", "-"
    frequency, amplitude = mark.frequency_hz, mark.amplitude.times(factor)
    return interval(frequency.value, frequency.low, frequency.high), interval(
        amplitude.value, amplitude.low, amplitude.high
    )
