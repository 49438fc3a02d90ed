"""What records tell of the mechanics behind them: the fit, the document of `sinew identify`, and its tables."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import xarray as xr

from sinew.analysis.analysed import recording_rig
from sinew.analysis.signal.signals import read_signals, torsion_delay
from sinew.identify.forced import Forced, Mechanics, Through, mechanics_of, predict_fit
from sinew.identify.joint.fit import JointFit, fit_joint
from sinew.identify.oscillator.comparison import (
    Comparison,
    HeldOut,
    Progress,
    Split,
    compare,
    compare_laws,
    compare_segments,
    impossible_numbers,
    laws_to_try,
    split_record,
)
from sinew.identify.oscillator.diagnosis import (
    diagnose,
    refuse_hopeless,
    silenced,
    warn_of_noise,
    widen,
    window_force,
)
from sinew.identify.oscillator.model import Fit, Fitted, Model, get_model
from sinew.identify.oscillator.record import Excitation, Record, cut_to, free_part, make_record, telling, unwrapped
from sinew.identify.points import ResponsePoints
from sinew.identify.steady_fit import LevelPeak, ResponseFit, fit_response, peak_of_response
from sinew.measure.errors import RecordingError, SinewError, SpecError
from sinew.measure.estimate import Estimate, finite
from sinew.measure.files.netcdf import load_recording
from sinew.measure.recording import Segment, cut_recording
from sinew.measure.result import Field, Result, Rows
from sinew.mechanics.laws import TERMS, Pendulum, Quadratic, Viscous
from sinew.plan.rig import RigSpec
from sinew.solve.programs import configure

if TYPE_CHECKING:
    from sinew.identify.oscillator.posterior import Posterior

Range = tuple[int, int]

_LAWS = tuple(one for one in laws_to_try() if not one.law.has(Quadratic) and not one.law.has(Pendulum))
"""What competes for segments and steady states. A quadratic term is asked for by name: a rig's tendons are the same to
both sides, and a fundamental hardly shows it."""


@dataclass(frozen=True, repr=False)
class Residuals(Result):
    """Root mean square of what a fit leaves, in the unit of the record: where it was fitted, and where held out."""

    train: Annotated[float, Field("rms residual where it was fitted", "sentence", "[unit]")]
    test: Annotated[float | None, Field("rms residual where it was held out", "sentence", "[unit]")]


@dataclass(frozen=True, repr=False)
class ComparedModel(Result):
    """A model that competed: its held-out residual in the unit of the record, and Bayes' criterion."""

    model: Annotated[str, Field("compared")]
    rmse_test: Annotated[float | None, Field("held-out rmse", unit="[unit]")]
    bic: Annotated[float | None, Field("BIC")]


@dataclass(frozen=True, repr=False)
class Identified(Result):
    """What was found, and what it was found from.

    parameters: of the law, by name with its unit. message: `sentences` in one line. mechanics: the law with its
    covariance, as `sn.predict` of a fit takes it. compared: what competed, the best first. peaks: of each level of a
    stepped sine. posterior: the numbers by the draws of NUTS, where they were asked for; draws: those.
    sentences: the verdict first. fit: of one degree of freedom, or None. split, held_out: of one record, what was held
    out and how it was predicted. joint: of the tendon joint, or None. response: of a stepped sine.
    """

    model: Annotated[str, Field("", "detail")]
    natural_frequency_hz: Annotated[Estimate, Field("natural frequency")]
    damping_ratio: Annotated[Estimate, Field("damping ratio")]
    parameters: Annotated[Mapping[str, Estimate], Field("")]
    rmse: Annotated[Residuals, Field("")]
    unit: Annotated[str, Field("", "detail")]
    converged: Annotated[bool, Field("", "detail")]
    message: Annotated[str, Field("", "detail")]
    unidentifiable: Annotated[tuple[str, ...], Field("", "sentence")]
    compared: Annotated[Rows[ComparedModel], Field("")]
    mechanics: Annotated[Mechanics | None, Field("", "detail")] = None
    peaks: Annotated[Rows[LevelPeak] | None, Field("")] = None
    posterior: Annotated[Mapping[str, Estimate] | None, Field("", "detail")] = None
    sentences: tuple[str, ...] = ()
    fit: Fit | None = None
    split: Split | None = None
    held_out: HeldOut | None = None
    joint: JointFit | None = None
    draws: "Posterior | None" = None
    response: ResponseFit | None = None

    def heading(self) -> str:
        """Return the model's name."""
        return f"model {self.model}"

    def closing(self) -> list[str]:
        """Return the verdict and what else there is to know, a sentence each."""
        return [f"{one[:1].upper()}{one[1:]}." for one in self.sentences if one]

    def predict(
        self,
        *,
        torque: float | Sequence[float] | None = None,
        base: float | Sequence[float] | None = None,
        through: Through | Sequence[float] | None = None,
        band_hz: tuple[float, float] | None = None,
        draws: int = 100,
        seed: int = 0,
        progress: "Progress | None" = None,
    ) -> Forced:
        """Return the steady response to levels of a drive, with 90 % bands, as `sinew.identify.forced.predict_fit`.

        torque: levels of what pushes; base: by how much the base moves instead, an angle in degrees. through:
        (frequency [Hz], amplitude, its standard deviation, level) of one measured steady motion, without which a free
        decay tells nothing of a push; the last two may be left out. band_hz: frequencies. draws, seed: of the bands.
        """
        return predict_fit(
            self.to_dict(),
            torque=torque,
            base=base,
            through=through,
            band_hz=band_hz,
            draws=draws,
            seed=seed,
            progress=progress,
        )


def identify(
    record: Record | ResponsePoints | Sequence[Record] | Sequence[ResponsePoints] | xr.Dataset | str | Path,
    model: str = "auto",
    *,
    excitation: Excitation | None = None,
    pretension_mm: float | None = None,
    rig: RigSpec | str | Path | None = None,
    start_s: float | None = None,
    stop_s: float | None = None,
    train: Range | None = None,
    test: Range | None = None,
    posterior: bool = False,
    chain: Sequence[str] = (),
    seed: int = 0,
    progress: Progress | None = None,
) -> Identified:
    """Return stiffness, damping law and nonlinearity behind an oscillation, with intervals, and which model it is.

    record: from `sn.make_record`, several of the same mechanics, or a recording (or the path of one, NetCDF); or the
    steady states of a stepped sine from `sn.points_of_table`, a group for each level of the drive.
    model: a name of `sn.MODELS`; "auto" chooses, or says what cannot be told; "tendon" is the whole joint of a rig's
    recording. excitation: what the drive of a foreign recording is. pretension_mm: which of a rig's recording [mm];
    else its smallest. rig: where model tendon begins; else the recording's own.
    start_s, stop_s: the stretch to take, in the record's own time [s]; without them, and without train and test, the
    free part of a free decay is found. train, test: samples of that stretch to fit and to predict, indices from 0, half
    open; else every fourth block is held out once. posterior: intervals by NUTS are added, in minutes.
    chain: what else the measuring chain of steady states may add: phase, background_real, background_imag.
    seed: of draws. progress: called with (done, total).
    Raises RecordingError where the record tells nothing, SpecError where it does not go with what is asked.

    >>> import numpy as np
    >>> import sinew as sn
    >>> t = np.arange(0, 4, 0.01)
    >>> noise = np.random.default_rng(0).normal(0, 0.003, t.size)
    >>> swing = 0.35 * np.exp(-1.2 * t) * np.cos(2 * np.pi * 3 * t) + noise
    >>> found = sn.identify(sn.make_record(t, swing, output_unit="rad"), "linear")
    >>> round(found.fit.natural_frequency_hz.value, 1)
    3.0
    >>> hertz = np.linspace(2, 4, 9)
    >>> sine = 0.1 / (9 - hertz**2 + 0.3j * hertz)
    >>> steps = sn.points_of_table(hertz, abs(sine), np.angle(sine), 0.1 * np.ones(9), excitation="force")
    >>> round(sn.identify(steps, "linear").response.natural_frequency_hz.value, 2)
    3.0
    """
    if isinstance(record, (str, Path)):
        record = load_recording(record)
    options: dict[str, object] = {"train": train, "test": test, "pretension_mm": pretension_mm}
    options |= {"start_s": start_s, "stop_s": stop_s, "posterior": posterior or None, "chain": chain or None}
    given = [name for name, value in options.items() if value is not None]
    if model == "tendon":
        if not isinstance(record, xr.Dataset):
            raise SpecError("model tendon needs the recording of a rig; choose cubic or auto")
        if given:
            raise SpecError(f"{given[0]} does not go with model tendon, which is fitted to all of a recording")
        if excitation not in (None, "lever"):
            raise SpecError(f"the excitation is {excitation}, but a rig is driven by its lever; leave it out")
        begin = recording_rig(record, rig)
        if begin is None:
            raise SpecError("model tendon needs a rig and the recording names none; name one")
        return identified_joint(fit_joint([record], begin, progress=progress))
    if isinstance(record, xr.Dataset):
        cut = cut_recording(record, start_s, stop_s)
        records = recording_records(cut, excitation, pretension_mm)
        foreign = record.attrs.get("source") == "import"
    else:
        several: list[Record | ResponsePoints]
        several = [record] if isinstance(record, (Record, ResponsePoints)) else list(record)
        if points := [one for one in several if isinstance(one, ResponsePoints)]:
            if other := [name for name in given if name != "chain"]:
                raise SpecError(f"{other[0]} is for samples over time, these are steady states; leave it out")
            return _of_points(points, model, chain, progress)
        records = [cut_to(one, start_s, stop_s) for one in several if isinstance(one, Record)]
        foreign = True
        if not records:
            raise SpecError("found no record, expected those of sn.make_record or sn.points_of_table, or a recording")
    if chain:
        raise SpecError("chain is for steady states, these are samples over time; leave it out")
    if foreign:
        counted = train is not None or test is not None
        records = [telling(unwrapped(one), counted=counted) for one in records]
    remarks: tuple[str, ...] = ()
    if foreign and len(records) == 1 and train is None and test is None:
        free = free_part(records[0])
        if start_s is None and stop_s is None:
            records = [free]
        elif free.time_s[0] > records[0].time_s[0]:
            remarks = (f"the fit probably starts before the release; try --start {free.time_s[0]:.4g}",)
    remarks = (*remarks, *unit_remarks(records[0]), *records[0].notes)
    found = find_mechanics(records, model, train, test, remarks=remarks, progress=progress)
    if not posterior:
        return found
    from sinew.identify.oscillator.posterior import sample_posterior  # numpyro, where it is installed

    assert found.fit is not None
    # Of two chains: intervals to a tenth of a standard deviation.
    sampled = sample_posterior(found.fit, seed=seed, draws=500, warmup=300, progress=progress)
    said = (*found.sentences, f"posterior: {sampled.message}")
    return replace(found, posterior=sampled.estimates, draws=sampled, message="; ".join(said), sentences=said)


def find_mechanics(
    records: Sequence[Record],
    model: str,
    train: Range | None,
    test: Range | None,
    *,
    remarks: Sequence[str] = (),
    progress: Progress | None = None,
) -> Identified:
    """Return what records of one degree of freedom tell. remarks: sentences on the input, put behind the verdict.

    Raises RecordingError and SpecError where they tell nothing.
    """
    configure()
    wanted = None if model == "auto" else get_model(model)
    for record in records:
        refuse_hopeless(record)
    if len(records) > 1:
        if train is not None or test is not None:
            raise SpecError("train and test are for one record; this recording has several segments")
        if len(records) > 2:
            return _of_segments(records, wanted, remarks, progress)
        remarks = [*remarks, "of two segments the first was fitted; three and more are fitted together"]
    split = split_record(records[0], train, test)
    measured, windowed = split.record, window_force(split.record, split.selected)
    if windowed is not None:
        apart = None if split.apart is None else silenced(split.apart)
        split = replace(split, record=windowed.record, apart=apart)
        if split.interleaved:  # the last fit is to all samples, so they all put its force right
            windowed = window_force(measured) or windowed
            split = replace(split, whole=windowed.record)
        remarks = [*remarks, windowed.sentence]
    first, last = (int(k) for k in split.selected.nonzero()[0][[0, -1]])
    refuse_hopeless(split.record.cut(first, last + 1))
    compared = compare_laws(split, progress) if wanted is None else compare(split, [wanted])
    if windowed is None:
        remarks = [*remarks, *warn_of_noise(compared.best)]
    else:
        compared = replace(compared, best=widen(compared.best, windowed))
    return replace(_of_comparison(compared, remarks), split=split, held_out=compared.rows[0].held_out)


def _of_segments(
    records: Sequence[Record], wanted: Model | None, remarks: Sequence[str], progress: Progress | None
) -> Identified:
    """Return what several segments of a rig with the same mechanics tell; every third is held out in turn."""
    models = _LAWS if wanted is None else (wanted,)
    compared = compare_segments(records, models, progress)
    levels = dict.fromkeys(record.group.split(",")[0] for record in records)
    sentence = (
        f"{len(records)} segments at {' and '.join(levels)} were fitted together, each third of them held out once"
    )
    return _of_comparison(compared, [sentence, *remarks])


def _of_comparison(compared: Comparison, remarks: Sequence[str]) -> Identified:
    best, row = compared.best, compared.rows[0]
    lines = [
        compared.verdict,
        *remarks,
        best.message,
        *_impossible(best),
        *diagnose(best, compared=len(compared.rows) > 1),
    ]
    rows = Rows(ComparedModel(one.model.name, finite(one.rmse_test), finite(one.bic)) for one in compared.rows)
    return replace(_identified(best, row.rmse_test, lines, rows), fit=best)


# What a stepped sine tells: models compared, the mechanics, where it resonates.

_GAIN, _CLOSE = 2.0, 6.0  # of the criterion: what a term more has to gain; odds of 20 to 1


def _of_points(
    groups: Sequence[ResponsePoints], model: str, chain: Sequence[str], progress: Progress | None
) -> Identified:
    """Return the mechanics behind one stepped sine, or several levels of it with the same mechanics."""
    models = _LAWS if model == "auto" else (get_model(model),)
    fits: list[ResponseFit] = []
    refused: SinewError | None = None
    for done, one in enumerate(models):
        if progress is not None:
            progress(done, len(models))
        try:
            fits.append(fit_response(groups, one, chain=chain))
        except (RecordingError, SpecError) as error:
            refused = refused or error
    if not fits:
        assert refused is not None
        raise refused
    best, verdict = _chosen(fits, compared=model == "auto")
    peaks = [peak_of_response(best, part=part) for part in range(len(groups))]
    lines = [verdict, *groups[0].notes, best.message, *best.tests.sentences()]
    lines += [f"at a drive of {one.input_amplitude:.3g}: {one.reason}" for one in peaks if one.reason]
    ranked = sorted(fits, key=lambda fit: (fit is not best, fit.bic()))
    rows = Rows(ComparedModel(one.model.name, None, one.bic()) for one in ranked)
    return replace(
        _identified(best, None, lines, rows),
        peaks=Rows(peaks),
        response=best,
    )


def _chosen(fits: Sequence[ResponseFit], *, compared: bool) -> tuple[ResponseFit, str]:
    """Return the model that the points support, by BIC, the plainer where a term gains little, and the verdict."""
    points = fits[0].points
    levels = f" at {len(points)} levels" if len(points) > 1 else ""
    count = f"{sum(one.size for one in points)} steady states{levels}"
    if not compared:
        return fits[0], f"model {fits[0].model.name} was fitted to {count}"
    sound = [fit for fit in fits if fit.converged and not impossible_numbers(fit.parameters)] or list(fits)
    best = min(sound, key=lambda fit: fit.bic())
    within = [fit for fit in sound if _terms(fit) <= _terms(best) and fit.bic() < best.bic() + _GAIN]
    best = min(within, key=lambda fit: (len(_terms(fit)), fit.bic()))
    close = [fit for fit in sound if not _terms(best) <= _terms(fit) and fit.bic() < best.bic() + _CLOSE]
    if not close:
        return best, f"{count} support model {best.model.name}"
    others = " and ".join(fit.model.name for fit in close)
    return best, f"cannot tell {best.model.name} from {others}: their BIC is within {_CLOSE:g}"


def _terms(fit: ResponseFit) -> frozenset[str]:
    return frozenset(fit.model.mechanics(fit.points[0].excitation))


def _impossible(best: Fit) -> list[str]:
    """Return a sentence where a friction or a loss factor is negative for certain."""
    words = {n.name: n.word for term in TERMS if term.lost and not isinstance(term, Viscous) for n in term.numbers}
    negative = impossible_numbers(best.parameters)
    return [
        f"the {word} came out negative, which nothing has: the damping depends on amplitude or frequency in another way"
        for start, word in words.items()
        if any(name.startswith(start) for name in negative)
    ]


def identified_joint(joint: JointFit) -> Identified:
    """Return what a fit tells of the tendon joint, frequency and damping at its smallest pretension."""
    levels = ", ".join(f"{one:g}" for one in joint.pretension_mm)
    at = f"natural frequency and damping ratio are those at {joint.pretension_mm[0]:g} mm"
    lines = (f"the tendon joint was fitted to {len(joint.segments)} segments at {levels} mm; {at}", joint.message)
    named = dict(zip(joint_names(joint), joint.parameters.values(), strict=True))
    return Identified(
        model="tendon",
        natural_frequency_hz=joint.at_pretension("natural_frequency_hz", joint.pretension_mm[0]),
        damping_ratio=joint.at_pretension("damping_ratio", joint.pretension_mm[0]),
        parameters=named | joint.derived,
        rmse=Residuals(joint.rmse["gyro_rad_s"], None),
        unit="rad/s",
        converged=joint.converged,
        message="; ".join(lines),
        unidentifiable=tuple(joint.unidentifiable),
        compared=Rows(),
        sentences=lines,
        joint=joint,
    )


def joint_names(joint: JointFit) -> tuple[str, ...]:
    """Return the names of the fitted parameters of a tendon joint: the rig's, with their units."""
    units = {name: parameter.unit for name, parameter in joint.rig.parameters()}
    return tuple(_with_unit(name, units.get(name, "1")) for name in joint.parameters)


def _with_unit(name: str, unit: str) -> str:
    """Return a rig's name of a parameter with its unit at the end: "tendons.head_radius" gives "..._m"."""
    token = unit.lower().replace("^", "").replace("*", "_").replace("/", "_per_").replace(" ", "")
    return name if unit == "1" else f"{name}_{token}"


def _identified(
    best: Fitted, rmse_test: float | None, said: Sequence[str], compared: Rows[ComparedModel]
) -> Identified:
    return Identified(
        model=best.model.name,
        natural_frequency_hz=best.natural_frequency_hz,
        damping_ratio=best.damping_ratio,
        parameters=best.parameters | (best.nuisance if isinstance(best, ResponseFit) else {}),
        rmse=Residuals(best.rmse, None if rmse_test is None else finite(rmse_test)),
        unit=best.unit,
        converged=best.converged,
        message="; ".join(said),
        unidentifiable=tuple(best.unidentifiable),
        compared=compared,
        mechanics=mechanics_of(best),
        sentences=tuple(said),
    )


# A recording of a rig, or a foreign one, becomes the records that are fitted.

_MOST_SEGMENTS = 9
_Row = tuple[Segment, slice]


def unit_remarks(record: Record) -> tuple[str, ...]:
    """Return what is odd about the units of a record, a sentence each.

    Raises SpecError where the input cannot be what it is said to be.
    """
    unit, kind = record.input_unit, record.excitation
    if kind in ("base", "lever") and unit in _EFFORTS:
        raise SpecError(
            f"the input is in {unit}, which is no motion, but the excitation is {kind}; choose force or torque, or "
            "name the column of the motion"
        )
    if kind in ("force", "torque") and unit in ("rad", "m", "rad/s", "m/s"):
        return (f"the input is in {unit}, which is no {kind}: is it the motion of a base or a lever?",)
    other = {"force": "N*m", "torque": "N"}.get(kind)
    if unit == other:
        return (f"the input is in {unit}, which is no {kind}; it was taken as {_EFFORTS[unit]}",)
    return ()


_EFFORTS = {"N": "a force", "N*m": "a torque"}


def recording_records(
    recording: xr.Dataset, excitation: Excitation | None, pretension_mm: float | None
) -> list[Record]:
    """Return the records in a recording: of an import its longest segment, of a rig the segments of one pretension.

    Of a rig, the steady segments of the first repeat, evenly thinned to nine, under the lever's measured angle; where
    there are none, its ring-downs. Sensor delays are those of the recording's rig.
    """
    signals = read_signals(recording, recording_rig(recording, None))
    response, drive, rows = signals.response, signals.drive, signals.segments
    if recording.attrs.get("source") == "import":
        if pretension_mm is not None:
            raise SpecError("a pretension is for the recording of a rig; this one was imported; leave it out")
        if excitation is None and drive is not None:
            raise SpecError("the recording has a drive; say its excitation: force, torque, base or lever, or none")
        rows = [max(rows, key=lambda row: row[1].stop - row[1].start)]
    else:
        excitation = excitation or "lever"
        rows = _of_pretension(rows, pretension_mm)
    chosen = excitation or "none"
    frequency = rows[0][0].frequency_hz
    delay = torsion_delay(signals.budget, frequency if frequency > 0 else 3.0) - signals.budget.drive_delay_s
    return [
        make_record(
            signals.time_s[where],
            response.values[where],
            None if chosen == "none" or drive is None else drive.values[where],
            excitation=chosen,
            output_unit=response.unit,
            input_unit="1" if chosen == "none" or drive is None else drive.unit,
            output_delay_s=delay,
            group=f"{segment.pretension_mm:g} mm",
        )
        for segment, where in rows
    ]


def _of_pretension(rows: list[_Row], pretension_mm: float | None) -> list[_Row]:
    levels = sorted({row[0].pretension_mm for row in rows})
    level = levels[0] if pretension_mm is None else min(levels, key=lambda one: abs(one - pretension_mm))
    if pretension_mm is not None and abs(level - pretension_mm) > 1e-6:
        listed = ", ".join(f"{one:g}" for one in levels)
        raise SpecError(f"the pretension asked for is {pretension_mm:g} mm, the recording has {listed}")
    mine = [row for row in rows if row[0].pretension_mm == level]
    steady = [row for row in mine if row[0].kind == "steady"]
    decays = [row for row in mine if row[0].kind == "ring-down"]
    if not steady and not decays:
        raise RecordingError("the recording holds neither steady segments nor ring-downs; there is nothing to fit")
    taken = [row for row in steady if row[0].repeat == steady[0][0].repeat] or decays
    step = max(1, -(-len(taken) // _MOST_SEGMENTS))
    return taken[::step]
