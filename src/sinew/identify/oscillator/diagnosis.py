"""Sentences for a record that cannot be identified, or is not what it was said to be.

What makes a fit impossible (nothing moves, too short, sampled too slowly) is refused before it. What makes it wrong
(input and output swapped, another excitation) shows in a poor fit: then the alternatives are tried with the same model,
and one that leaves much less is named.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft, signal

from sinew.identify.oscillator.comparison import is_springless
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.least_squares import Covariance
from sinew.identify.oscillator.model import (
    MODELS,
    Fit,
    ask_fit,
    make_part,
    mechanical_parameters,
    oscillation,
    parameter_name,
)
from sinew.identify.oscillator.record import Excitation, Record, derivative_order, dominant_omega, is_step
from sinew.measure.arrays import Array, Mask, robust_std
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import Estimate, number

_FEWEST_PERIODS = 2.0
_FEWEST_SAMPLES = 4.0  # in a period
_FEW_SAMPLES = 8.0
_POOR = 0.1  # rms of the residuals over the output's
_MUCH_BETTER = 0.5  # of the rms
_ENOUGH = 6000  # samples that tell another excitation


def refuse_hopeless(record: Record) -> None:
    """Raise RecordingError where no model can be identified from the record, with what is missing."""
    if record.input is not None and np.ptp(record.input) <= 1e-12 * np.abs(record.input).max():
        raise RecordingError(
            f"the input is constant ({record.input[0]:.4g}); expected a drive that moves: is it the right column? "
            "For a free decay leave the input out and choose excitation none"
        )
    if np.ptp(record.output) <= 1e-12 * np.abs(record.output).max():
        raise RecordingError("the output is constant; is it the right column, and did the sensor run?")
    period = 2 * np.pi / dominant_omega(record)
    lasts = float(record.time_s[-1] - record.time_s[0])
    if lasts < _FEWEST_PERIODS * period and not _moves_without_spring(record):
        raise RecordingError(
            f"the record is too short to identify: {lasts:.3g} s hold {lasts / period:.1f} periods of its oscillation, "
            f"expected at least {_FEWEST_PERIODS:g}; record longer"
        )
    if period < _FEWEST_SAMPLES * record.step_s:
        raise RecordingError(
            f"sampling is too slow for the oscillation: {period / record.step_s:.1f} samples in a period of "
            f"{period:.3g} s, expected at least {_FEWEST_SAMPLES:g}, better {_FEW_SAMPLES:g}; sample faster"
        )


def _moves_without_spring(record: Record) -> bool:
    """Return whether a driven motion is one without a spring: even the stiffest that it allows would not swing once."""
    if record.input is None:
        return False
    try:
        found = fit(_most_moving(record), MODELS["linear"])
    except (RecordingError, SpecError):
        return False
    lasts = float(record.time_s[-1] - record.time_s[0])
    return is_springless(found) and _stiffness(found)[1].high * lasts**2 < (2 * np.pi) ** 2


def _stiffness(found: Fit) -> tuple[str, Estimate]:
    """Return name and value of the stiffness over the inertia."""
    return next((name, one) for name, one in found.parameters.items() if name.startswith("stiffness_per_s2"))


def diagnose(found: Fit, *, compared: bool = False) -> tuple[str, ...]:
    """Return what about a fit a person should know: sentences; none where nothing is suspicious.

    compared: whether the model won against others; how its residuals came out of their tests is in that verdict.
    """
    sentences = _reversed(found)
    omega = 2 * np.pi * found.natural_frequency_hz.value
    if not np.isfinite(omega):
        other = [] if is_springless(found) else _alternatives(found, compared)
        return (*sentences, *other, _without_frequency(found))
    samples = 1.0 / (found.natural_frequency_hz.value * max(record.step_s for record in found.records))
    if samples < _FEW_SAMPLES:
        sentences.append(f"sampling is slow for the resonance: {samples:.1f} samples in a period; sample faster")
    if found.damping_ratio.high < 0:
        sentences.append("the damping came out negative: energy is fed in, or input and output do not belong together")
    share = ask_fit(found).share
    if share > _POOR:
        sentences.append(f"the fit is poor: residuals are {100 * share:.0f} % of the output's standard deviation")
    if share > _POOR or found.damping_ratio.high < 0:
        sentences += _alternatives(found, compared)
    if any(is_step(record) for record in found.records):
        sentences.append(
            f"the input jumps between two samples, and when is known to {1e3 * found.records[0].step_s:.3g} ms: the "
            "intervals do not know of that"
        )
    return tuple(sentences)


def _without_frequency(found: Fit) -> str:
    name, stiffness = _stiffness(found)
    if stiffness.high < 0:
        return (
            f"the stiffness came out negative ({name} = {stiffness}): the model does not fit this record, or is a "
            "sensor's sign reversed?"
        )
    sentence = f"the stiffness is not told from zero ({name} = {stiffness}), so there is no natural frequency"
    if not is_springless(found):
        return sentence
    damping = next((one for name, one in found.parameters.items() if name.startswith("damping_per_s")), None)
    settles = f", whose rate settles in {1 / damping.value:.3g} s" if damping is not None and damping.low > 0 else ""
    return f"{sentence}: this moves as a mass without a spring, a cart or a positioner{settles}"


def _reversed(found: Fit) -> list[str]:
    """Return the question after a sensor's sign where the input acts the wrong way round."""
    first = found.records[0]
    name = parameter_name("gain", first.excitation, first.motion_unit, first.input_motion_unit)
    gains = [one for own, one in found.parameters.items() if own.split("[")[0] == name]
    if gains and all(one.high < 0 for one in gains):
        full = next((name for name in found.parameters if name.startswith(("inertia_", "mass_"))), None)
        what = "the input gain" if full is None else f"{full.split('_')[0]} and stiffness"
        return [f"{what} came out negative: is a sensor's sign reversed? Multiply input or output by -1"]
    if gains or first.input is None or first.excitation != "base" or ask_fit(found).share < _POOR:
        return []
    records = [_most_moving(record) for record in found.records]
    turned = [replace(record, input=-record.input) for record in records if record.input is not None]
    if _share(turned) < _MUCH_BETTER * _share(records):
        return ["with the input's sign reversed a linear joint leaves much less: is a sensor's sign reversed?"]
    return []


def _alternatives(found: Fit, compared: bool) -> list[str]:
    """Return sentences on what the records fit much better: swapped columns, another excitation."""
    records, first = found.records, found.records[0]
    if first.input is None:
        other = "" if compared else "try --model auto; "
        return [
            f"a free decay of model {found.model.name} does not describe it; {other}was it driven, or did it start "
            "later than the record?"
        ]
    sentences = []
    stretches = [_where_it_moves(record) for record in records]
    left = [off[where] for off, where in zip(found.residuals(), stretches, strict=True)]
    records = tuple(record.cut(where.start, where.stop) for record, where in zip(records, stretches, strict=True))
    own = float(np.sqrt(np.mean(np.concatenate(left) ** 2))) / _deviation(records)
    if _share([_swapped(record) for record in records]) < _MUCH_BETTER * min(own, 1.0):
        sentences.append("input and output look swapped: the other way round a linear joint leaves much less")
    others: list[Excitation] = ["base", "lever"] if first.excitation in ("force", "torque") else ["force"]
    if first.excitation in ("base", "lever"):
        others.append("lever" if first.excitation == "base" else "base")
    plain = min(own, _share(records))
    better = {e: _share([replace(record, excitation=e) for record in records]) for e in others}
    best = min(better, key=lambda e: better[e])
    if better[best] < _MUCH_BETTER * plain:
        name = "force or torque" if best == "force" else best
        sentences.append(
            f"excitation {first.excitation} looks wrong: as {name} a linear joint leaves {100 * better[best]:.0f} % "
            f"instead of {100 * plain:.0f} %"
        )
    return sentences


def _where_it_moves(record: Record) -> slice:
    """Return the stretch of a long record in which the output moves most: enough to tell another excitation."""
    if record.size <= _ENOUGH:
        return slice(0, record.size)
    moved = np.concatenate([[0.0], np.cumsum((record.output - record.output.mean()) ** 2)])
    first = int(np.argmax(moved[_ENOUGH:] - moved[:-_ENOUGH]))
    return slice(first, first + _ENOUGH)


def _most_moving(record: Record) -> Record:
    where = _where_it_moves(record)
    return record.cut(where.start, where.stop)


def _swapped(record: Record) -> Record:
    assert record.input is not None
    return replace(
        record,
        input=record.output,
        output=record.input,
        input_unit=record.output_unit,
        output_unit=record.input_unit,
        excitation="force",
    )


def _deviation(records: Sequence[Record]) -> float:
    """Return the root mean square of the outputs, each less its mean."""
    return float(np.sqrt(np.mean(np.concatenate([(r.output - r.output.mean()) ** 2 for r in records]))))


def _share(records: Sequence[Record]) -> float:
    """Return what a linear joint leaves of records, rms over the output's; inf where it cannot be fitted."""
    try:
        found = fit(records, MODELS["linear"])
    except (RecordingError, SpecError):
        return float("inf")
    return found.rmse / _deviation(records) if found.damping_ratio.high > 0 else float("inf")


# Noise on a measured force: where it is left out of the fit, and what it adds to an interval.
#
# A fit by output error simulates the measured input, its noise too. Under a drive that acts all the time that is a
# share of the drive. Where the force is silent most of the time, as in an impulse test, its sensor's noise rings the
# simulated joint long after the true motion has died, and a term that keeps small motions from ringing, dry friction
# before all, fits better for that reason alone. So the silent force is taken as its mean (the force window of modal
# testing, Ewins, Modal Testing, 2000), unless the measured one predicts the output better: then it was a force.
#
# The noise inside a pulse is an error in variables: of the noise of its samples the part that is slow enough to move
# the joint is fitted with the mechanics of a linear joint, held by how strong noise is, and the force is put right by
# it, so that two strokes agree with one joint, and the intervals are those of a fit that did not know it. (Of a pulse
# that is short beside the period that comes to two numbers, how strong it was and when; of a longer one the motion
# within tells more.) How strong all of them were together no residual shows; that goes into the interval of the gain.

_LOUD = 4.5  # standard deviations of the silent force: what is larger is a force
_SILENT = 0.6  # of the samples, at least, where the force is silent
_PEAK = 20.0  # standard deviations of the silent force that the largest one has, at least
_SKIRT = 0.5  # of a pulse's length that is kept on either side
_FEWEST_SKIRT = 3
_QUIET_BAND = 0.75  # of the highest frequency: beyond it a drive has nothing
_FLOOR = 0.01  # of the drive's largest spectral density: more is no noise
_TELLING = 0.25  # of the residuals' variance that noise of the input makes: worth a warning
_TOO_MUCH = 3.0  # of it: more than there is, so it was no noise
_BETWEEN = 0.3  # over the square of its samples: the share of a half sine that a spline through them may miss
_STROKE = 0.05  # of the strongest pulse: what is weaker is none
_ROUNDS = 3
_FURTHEST = 3.0  # standard deviations that a pulse is put right by
_FOLLOWS = 8.0  # natural frequencies: what is faster moves a joint by less than a sixtieth


@dataclass(frozen=True)
class Windowed:
    """A record whose silent force is its mean.

    noise: standard deviation of a sample of the silent force, in its unit. gain_std: of the gain, relative, by the
    noise inside the pulses. wider: by name, how much wider the other numbers of a fit are for not knowing what the
    pulses were. sentence: what was done, in words.
    """

    record: Record
    noise: float
    gain_std: float
    wider: dict[str, float]
    sentence: str


def silenced(record: Record) -> Record:
    """Return the record with its silent force taken as its mean; as it is where that is not silent."""
    loud = None if record.input is None else _loud(record.input)
    if record.input is None or loud is None:
        return record
    return replace(record, input=np.where(loud, record.input, record.input[~loud].mean()))


def window_force(record: Record, selected: Mask | None = None) -> Windowed | None:
    """Return the record with its silent force taken as its mean; None where it is not silent, or better as measured.

    selected: which samples of the output may be looked at, shape (n,); all where it is None.
    """
    if record.input is None or record.excitation not in ("force", "torque"):
        return None
    loud = _loud(record.input)
    if loud is None:
        return None
    mean = float(record.input[~loud].mean())
    noise = float(record.input[~loud].std())
    windowed, seen = silenced(record), None if selected is None else [selected]
    try:
        found, before = (
            fit(windowed, MODELS["linear"], selected=seen),
            fit(record, MODELS["linear"], selected=seen).rmse,
        )
    except RecordingError:
        return None
    left = found.rmse
    if not left < before:
        return None
    windowed, wider = _put_right(found, loud, mean, noise)
    unit = "" if record.input_unit == "1" else record.input_unit
    return Windowed(
        windowed,
        noise,
        _strength_std(record.input - mean, loud, noise),
        wider,
        f"the {record.excitation} is silent in {100 * float(np.mean(~loud)):.0f} % of the samples but for noise of "
        f"{number(noise, 2, unit)} rms; it was taken as its mean there, by which a linear joint leaves "
        f"{100 * (1 - left / before):.2g} % less",
    )


def _loud(force: Array) -> Mask | None:
    """Return where there is a force, with its skirts, shape (n,); None where it is not silent most of the time."""
    off = np.abs(force - np.median(force))
    noise = robust_std(off)
    if not 0 < _PEAK * noise < float(off.max()):
        return None
    found = np.zeros(force.size, dtype=bool)
    for first, last in _stretches(off > _LOUD * noise):
        skirt = max(_FEWEST_SKIRT, math.ceil(_SKIRT * (last - first)))
        found[max(0, first - skirt) : last + skirt] = True
    return found if float(np.mean(~found)) >= _SILENT else None


def _stretches(mask: Mask) -> list[tuple[int, int]]:
    """Return begin and end, half open, of every stretch of a mask that is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _put_right(found: Fit, loud: Mask, mean: float, noise: float) -> tuple[Record, dict[str, float]]:
    """Return the record with its pulses as the output says they were, as far as noise can have done it, and how much
    wider each number is for it.

    One step of Gauss and Newton for the mechanics and the errors of the pulses together, held by their priors.
    """
    record = found.records[0]
    assert record.input is not None
    shapes, std = _errors(found, record.input - mean, loud, noise)
    responses = np.stack([_response(found, shape) for shape in shapes], axis=1) * std
    seen = found.selected[0]  # a stroke behind these samples moves none of them, so it stays as it was measured
    jacobian = np.concatenate([found.solution.jacobian * found.layout.parts[0].unit_size, responses[seen]], axis=1)
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    size[-std.size :] = np.hypot(size[-std.size :], found.rmse)  # a stroke that moves nothing has its prior alone
    residual, moved = found.residuals()[0][seen], np.zeros(std.size)
    left, held = max(found.rmse, 1e-300), np.zeros((std.size, jacobian.shape[1]))
    for _ in range(_ROUNDS):  # the less they leave, the less the noise of the output holds them
        held[:, -std.size :] = left * np.eye(std.size)
        table, wanted = np.concatenate([jacobian, held]) / size, np.concatenate([residual, np.zeros(std.size)])
        step = np.linalg.lstsq(table, wanted, rcond=1e-12)[0] / size
        moved = np.clip(step[-std.size :], -_FURTHEST, _FURTHEST)
        left = max(float(np.sqrt(np.mean((residual - jacobian @ step) ** 2))), 1e-300)
    alone = np.linalg.norm(np.linalg.pinv(table[: residual.size, : -std.size], rcond=1e-12), axis=1)
    together = np.linalg.norm(np.linalg.pinv(table, rcond=1e-12), axis=1)[: -std.size]
    names = [entry.local for entry in found.layout.entries]
    wider = {name: max(1.0, float(b / a)) for name, a, b in zip(names, alone, together, strict=True) if name != "gain"}
    return replace(record, input=record.input + np.tensordot(moved * std, shapes, 1)), wider


def _errors(found: Fit, force: Array, loud: Mask, noise: float) -> tuple[Array, Array]:
    """Return the errors that the pulses of a force may have, shape (e, n), and the standard deviation of each, (e,).

    The noise of a loud stretch is white, so its cosine transform is white, too; of that the joint follows the slow
    part. Between its samples a stroke may have been stronger, and later, than a spline through them.
    """
    record, pulses = found.records[0], _stretches(loud)
    index = np.arange(force.size)
    own = [np.where((index >= a) & (index < b), force, 0.0) for a, b in pulses]
    strongest = max(abs(float(one.sum())) for one in own)
    own = [one for one in own if abs(float(one.sum())) > _STROKE * strongest]
    between = [_BETWEEN / (float(np.sum(np.abs(one))) / float(np.abs(one).max())) ** 2 for one in own]
    late = [_BETWEEN * record.step_s * 0.1] * len(own)
    shapes, std = [*own, *(-np.gradient(one, record.time_s) for one in own)], [*between, *late]
    hertz = found.layout.parts[0].scales.omega / (2 * np.pi)
    for first, end in pulses:
        waves = min(end - first, 2 + math.ceil(2 * _FOLLOWS * hertz * (end - first) * record.step_s))
        rows = np.zeros((waves, force.size))
        rows[:, first:end] = fft.idct(np.eye(end - first)[:waves], norm="ortho", axis=1)
        shapes, std = [*shapes, *rows], [*std, *([noise] * waves)]
    return np.stack(shapes), np.array(std)


def _response(found: Fit, force: Array) -> Array:
    """Return what a further force adds to the output of a linear fit, in its unit, shape (n,)."""
    part, record = found.layout.parts[0], found.records[0]
    assert record.input is not None
    pushed = make_part(
        replace(record, input=record.input + force), found.model, part.scales, found.frame, part.selected
    )
    layout = replace(found.layout, parts=(pushed,))
    return np.asarray(layout.outputs(found.solution.values)[0] * part.unit_size - found.predicted[0])


def _strength_std(force: Array, loud: Mask, noise: float) -> float:
    """Return the relative standard deviation of the gain that pulses, each as strong as its area, tell by their noise:
    of areas A_p of n_p samples the slope of least squares has the variance σ² Σ n_p A_p² / (Σ A_p²)²."""
    pulses = _stretches(loud)
    area = np.array([float(force[a:b].sum()) for a, b in pulses])
    size = np.array([b - a for a, b in pulses])
    return noise * float(np.sqrt(size @ area**2)) / float(area @ area)


def widen(found: Fit, windowed: Windowed) -> Fit:
    """Return a fit to a windowed record whose intervals know of the noise inside the pulses."""
    names = [entry.local for entry in found.layout.entries]
    factor = np.array([windowed.wider.get(name, 1.0) for name in names])
    matrix = found.covariance.matrix * np.outer(factor, factor)
    for k in (k for k, name in enumerate(names) if name == "gain"):
        matrix[k, k] += (windowed.gain_std * float(found.solution.values[k])) ** 2
    certainty = Covariance(matrix, found.covariance.degrees_of_freedom)
    frequency, damping = oscillation(found.layout, found.solution, certainty)
    parameters = mechanical_parameters(found.layout, found.solution, certainty)
    return replace(
        found, covariance=certainty, parameters=parameters, natural_frequency_hz=frequency, damping_ratio=damping
    )


def warn_of_noise(found: Fit) -> list[str]:
    """Return a sentence where noise of a force that acts all the time makes much of what a fit leaves.

    Its density is that of the input in the highest quarter of the frequencies, if that is far below the drive's; white
    noise of the density S makes a motion of the variance S g²/(4 d k), or a rate of S g²/(4 d).
    """
    first = found.records[0]
    if first.excitation not in ("force", "torque") or derivative_order(first.output_unit) > 1:
        return []
    if not found.natural_frequency_hz.value > 0 or not found.damping_ratio.value > 0:
        return []
    share = _noise_share(found, found.records)
    if not _TELLING < share < _TOO_MUCH:
        return []
    return [
        f"noise of the input, by its highest frequencies, makes about {100 * min(share, 1.0):.0f} % of what the "
        "fit leaves: damping and friction take part of it for their own; average the input, or measure it with less"
    ]


def _noise_share(found: Fit, records: Sequence[Record]) -> float:
    density = float(np.median([_noise_density(record) for record in records]))
    local = dict(zip((entry.local for entry in found.layout.entries), found.solution.values, strict=True))
    gain = float(local.get("gain", 0.0)) * found.layout.parts[0].scales.physical("gain")
    omega = 2 * np.pi * found.natural_frequency_hz.value
    damping = 2 * found.damping_ratio.value * omega
    size = omega**2 if derivative_order(records[0].output_unit) == 0 else 1.0
    return density * gain**2 / (4 * damping * size) / max(found.rmse, 1e-300) ** 2


def _noise_density(record: Record) -> float:
    """Return the one-sided spectral density of the input's noise [unit²/Hz]; zero where it does not show."""
    assert record.input is not None
    length = min(1024, record.size)
    frequency, density = signal.welch(record.input, 1.0 / record.step_s, nperseg=length)
    floor = float(np.median(density[frequency > _QUIET_BAND * frequency[-1]]))
    return floor if floor < _FLOOR * float(density.max()) else 0.0
