"""This is where the fits of `sinew identify` become what it tells: a document, and sentences."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sinew.apps.console import write_json
from sinew.measure.errors import RecordingError, SpecError

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from sinew.identify.choice.comparison import Comparison
    from sinew.identify.choice.held_out import HeldOut, Split
    from sinew.identify.decay.backbone import Backbone
    from sinew.identify.joint.fit import JointFit
    from sinew.identify.oscillator.fitted import Fit
    from sinew.identify.oscillator.model import Model
    from sinew.identify.oscillator.posterior import Posterior
    from sinew.identify.oscillator.record import Record
    from sinew.plan.rig import RigSpec


Range = tuple[int, int]
Progress = Callable[[float, float], None]

# A rig's tendons are the same to both sides: a quadratic term is asked for by name.
_SEGMENT_LAWS = ("linear", "loss-factor", "coulomb", "cubic", "loss-factor-cubic", "coulomb-cubic")


@dataclass
class Found:
    """What was found, and what it was found from.

    document: as `--json` prints it. sentences: those of its `message`, the verdict first.
    fit: of one degree of freedom, or None. split, held_out: of one record, what was held out and how it was predicted.
    joint: of the tendon joint, or None. posterior: draws, where they were asked for.
    """

    document: dict[str, Any]
    sentences: list[str]
    fit: "Fit | None" = None
    split: "Split | None" = None
    held_out: "HeldOut | None" = None
    joint: "JointFit | None" = None
    posterior: "Posterior | None" = None


def find_mechanics(
    records: "Sequence[Record]",
    model: str,
    train: Range | None,
    test: Range | None,
    *,
    remarks: Sequence[str] = (),
    progress: Progress | None = None,
) -> Found:
    """Return what records of one degree of freedom tell. remarks: sentences on the input, put behind the verdict.

    Raises RecordingError and SpecError where they tell nothing.
    """
    from sinew.identify.choice.diagnosis import refuse_hopeless
    from sinew.identify.choice.held_out import split_record
    from sinew.identify.oscillator.model import get_model
    from sinew.twin.cache import configure

    configure()
    wanted = None if model == "auto" else get_model(model)
    for record in records:
        refuse_hopeless(record)
    if len(records) > 1:
        if train is not None or test is not None:
            raise SpecError("--train and --test are for one record; this recording has several segments")
        if len(records) > 2:
            return _of_segments(records, wanted, remarks, progress)
        remarks = [*remarks, "of two segments the first was fitted; three and more are fitted together"]
    split = split_record(records[0], train, test)
    taught = [int(k) for k in split.kept.nonzero()[0][[0, -1]]]
    refuse_hopeless(split.record.cut(taught[0], taught[1] + 1))
    return _of_record(split, wanted, remarks, progress)


def _of_record(split: "Split", wanted: "Model | None", remarks: Sequence[str], progress: Progress | None) -> Found:
    from sinew.identify.choice.comparison import compare, compare_laws

    compared = compare_laws(split, progress) if wanted is None else compare(split, [wanted])
    found = _of_comparison(compared, remarks)
    found.split, found.held_out = split, compared.rows[0].held_out
    return found


def _of_segments(
    records: "Sequence[Record]", wanted: "Model | None", remarks: Sequence[str], progress: Progress | None
) -> Found:
    """Return what several segments of a rig with the same mechanics tell; every third is held out in turn."""
    from sinew.identify.choice.comparison import compare_segments

    models = _SEGMENT_LAWS if wanted is None else (wanted,)
    compared = compare_segments(records, models, varying=(), progress=progress)
    levels = dict.fromkeys(record.group.split(",")[0] for record in records)
    told = f"{len(records)} segments at {' and '.join(levels)} were fitted together, each third of them held out once"
    return _of_comparison(compared, [told, *remarks])


def _of_comparison(compared: "Comparison", remarks: Sequence[str]) -> Found:
    from sinew.identify.choice.diagnosis import suspicions

    best, row = compared.best, compared.rows[0]
    told = [
        compared.verdict,
        *remarks,
        best.message,
        *_impossible(best),
        *suspicions(best, compared=len(compared.rows) > 1),
    ]
    rows = [
        {"model": one.model.name, "rmse_test": _number(one.rmse_test), "bic": _number(one.bic)} for one in compared.rows
    ]
    return Found(_fit_part(best, row.rmse_test, told) | {"compared": rows}, told, fit=best)


def _impossible(best: "Fit") -> list[str]:
    """Return a sentence where a friction or a loss factor is negative for certain."""
    from sinew.identify.choice.comparison import impossible_numbers

    words = {"coulomb": "dry friction", "loss_factor": "loss factor"}
    negative = impossible_numbers(best)
    return [
        f"the {word} came out negative, which nothing has: the damping depends on amplitude or frequency in another way"
        for start, word in words.items()
        if any(name.startswith(start) for name in negative)
    ]


def find_joint(recording: "xr.Dataset", rig: "RigSpec", progress: Progress | None = None) -> Found:
    """Return what the recording of a rig tells of its tendon joint."""
    from sinew.identify.joint.fit import fit_joint
    from sinew.twin.cache import configure

    configure()
    joint = fit_joint([recording], rig, progress=progress)
    whole = joint.document()
    document = {key: one for key, one in whole.items() if key not in _OWN_KEYS}
    named = dict(zip(joint_names(joint), (one.to_json() for one in joint.parameters.values()), strict=True))
    document["parameters"] = named | {name: one.to_json() for name, one in joint.derived.items()}
    levels = ", ".join(f"{one:g}" for one in joint.pretension_mm)
    at = f"natural frequency and damping ratio are those at {joint.pretension_mm[0]:g} mm"
    told = [f"the tendon joint was fitted to {len(joint.segments)} segments at {levels} mm; {at}", joint.message]
    document["message"] = "; ".join(told)
    return Found(document, told, joint=joint)


_OWN_KEYS = ("units", "derived", "by_pretension")
"""Of a joint fit's document what other models have not; here it stands under `parameters`."""


def joint_names(joint: "JointFit") -> tuple[str, ...]:
    """Return the names of the fitted parameters of a tendon joint: the rig's, with their units."""
    units = {name: parameter.unit for name, parameter in joint.rig.parameters()}
    return tuple(_with_unit(name, units.get(name, "1")) for name in joint.parameters)


def _with_unit(name: str, unit: str) -> str:
    """Return a rig's name of a parameter with its unit at the end: "tendons.head_radius" gives "..._m"."""
    token = unit.lower().replace("^", "").replace("*", "_").replace("/", "_per_").replace(" ", "")
    return name if unit == "1" else f"{name}_{token}"


def _fit_part(best: "Fit", rmse_test: float | None, told: Sequence[str]) -> dict[str, Any]:
    return {
        "model": best.model.name,
        "parameters": {name: one.to_json() for name, one in best.parameters.items()},
        "natural_frequency_hz": best.natural_frequency_hz.to_json(),
        "damping_ratio": best.damping_ratio.to_json(),
        "rmse": {"train": _number(best.rmse), "test": None if rmse_test is None else _number(rmse_test)},
        "unit": best.unit,
        "converged": best.converged,
        "message": "; ".join(told),
        "unidentifiable": list(best.unidentifiable),
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


# `sinew identify` adds what an option asks for: profiles, a bootstrap over repeats, a posterior.

_NONLINEAR = ("loss_factor", "coulomb", "quadratic", "cubic")
_DRAWS, _WARMUP = 500, 300  # of each of two chains: intervals to a tenth of a standard deviation


def add_profiles(found: Found, progress: Progress) -> None:
    """Add the key `profile`: intervals of the nonlinear numbers by their profile likelihood, by name."""
    from sinew.identify.oscillator.profile import interval90

    fit = _fit_of(found, "--profile")
    chosen = [name for name in fit.parameters if name.startswith(_NONLINEAR)]
    if not chosen:
        found.sentences.append(f"model {fit.model.name} has no nonlinear number to profile")
    told: dict[str, Any] = {}
    for done, name in enumerate(chosen):
        progress(done, len(chosen))
        interval = interval90(fit, name)
        if interval is None:
            found.sentences.append(f"the profile of {name} bounds it on neither side")
            continue
        told[name] = interval.to_json()
        for end, side in ((interval.low, "below"), (interval.high, "above")):
            if not math.isfinite(end):
                found.sentences.append(f"the profile of {name} does not bound it {side}")
    found.document["profile"] = told


def add_bootstrap(found: Found, resamples: int, seed: int, progress: Progress) -> None:
    """Add the key `bootstrap`: the numbers with the intervals that the scatter of whole repeats gives."""
    from sinew.identify.oscillator.bootstrap import bootstrap_repeats

    fit = _fit_of(found, "--bootstrap")
    scatter = bootstrap_repeats(fit.records, fit.model, resamples=resamples, seed=seed, progress=progress)
    found.document["bootstrap"] = {name: one.to_json() for name, one in scatter.estimates.items()}
    found.sentences.append(f"bootstrap: {scatter.message}")


def add_posterior(found: Found, seed: int, progress: Progress) -> None:
    """Add the key `posterior`: the numbers by the draws of NUTS."""
    from sinew.identify.oscillator.posterior import sample_posterior

    fit = _fit_of(found, "--posterior")
    posterior = sample_posterior(fit, seed=seed, draws=_DRAWS, warmup=_WARMUP, progress=progress)
    found.posterior = posterior
    found.document["posterior"] = {name: one.to_json() for name, one in posterior.estimates.items()}
    found.sentences.append(f"posterior: {posterior.message}")


def _fit_of(found: Found, option: str) -> "Fit":
    if found.fit is None:
        raise SpecError(f"{option} is for models of one degree of freedom; leave it out with model tendon")
    return found.fit


# `sinew identify` draws its figures and writes its page.

_FORMATS = ("png", "pdf")


def write_pages(found: Found, folder: Path, *, about: str, rebuild: str, origins: list[tuple[str, str]]) -> Path:
    """Write fit.json, figures and fit.html into a folder and return the path of the page.

    Raises FileError where the folder cannot be written.
    """
    from sinew.figures.fit_page import write_fit_page
    from sinew.figures.style import save_figure

    paths = []
    for name, figure in _figures(found).items():
        paths += save_figure(figure, folder / "figures", name, _FORMATS)
    write_json(found.document, folder / "fit.json")
    return write_fit_page(
        folder,
        found.document,
        sentences=found.sentences,
        figures=paths,
        about=about,
        rebuild=rebuild,
        origins=origins,
    )


def _figures(found: Found) -> "dict[str, Figure]":
    drawn = _joint_figures(found.joint) if found.joint is not None else {}
    if found.fit is not None:
        drawn = _fit_figures(found, found.fit)
    return {name: figure for name, figure in drawn.items() if figure is not None}


def _fit_figures(found: Found, fit: "Fit") -> "dict[str, Figure | None]":
    import math

    from sinew.figures.corner import cloud_of, draw_corner
    from sinew.figures.fit_data import draw_backbone, draw_fit, traces_of
    from sinew.figures.fit_page import draw_residuals
    from sinew.identify.oscillator.fitted import swing_of
    from sinew.identify.oscillator.start import dominant_omega

    record = fit.records[0]
    frequency = fit.natural_frequency_hz.value
    if not math.isfinite(frequency):
        frequency = dominant_omega(record) / (2 * math.pi)
    traces = traces_of(fit, found.split, found.held_out)
    cloud = cloud_of(fit)
    if found.posterior is not None:
        cloud = cloud.drawn(found.posterior.names, found.posterior.draws)
    return {
        "fit_data": draw_fit(traces, frequency),
        "residuals": draw_residuals(traces, frequency),
        "corner": draw_corner(cloud),
        "backbone": draw_backbone(swing_of(fit), _decay(fit), record.motion_unit),
    }


def _decay(fit: "Fit") -> "Backbone | None":
    """Return the backbone of the first free decay without a model, or None where the record is none."""
    from sinew.identify.decay.backbone import fit_backbone
    from sinew.identify.oscillator.record import derivative_order

    record = fit.records[0]
    if record.input is not None or derivative_order(record.output_unit):
        return None
    try:
        return fit_backbone(record.time_s, record.output)
    except RecordingError:
        return None


def _joint_figures(joint: "JointFit") -> "dict[str, Figure | None]":
    import numpy as np

    from sinew.figures.corner import Cloud, draw_corner
    from sinew.figures.fit_data import draw_fit, draw_over_pretension, traces_of_joint
    from sinew.figures.fit_page import draw_residuals

    traces = traces_of_joint(joint)
    first = joint.at_pretension("natural_frequency_hz", joint.pretension_mm[0]).value
    count = len(joint.parameters)
    value = np.array([one.value for one in joint.parameters.values()])
    cloud = Cloud(joint_names(joint), value, joint.covariance.matrix[:count, :count])
    kept = [k for k in range(count) if np.isfinite(cloud.covariance[k, k]) and cloud.covariance[k, k] > 0]
    pretension = draw_over_pretension(joint) if len(joint.pretension_mm) > 1 else None
    return {
        "fit_data": draw_fit(traces, first, "rate"),
        "residuals": draw_residuals(traces, first),
        "corner": draw_corner(cloud.take(kept)),
        "pretension": pretension,
    }
