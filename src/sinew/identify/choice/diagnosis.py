"""Sentences for a record that cannot be identified, or is not what it was said to be.

What makes a fit impossible (nothing moves, too short, sampled too slowly) is refused before it. What makes it wrong
(input and output swapped, another excitation) shows in a poor fit: then the alternatives are tried with the same model,
and one that leaves much less is named.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sinew.identify.choice.comparison import ask_fit, is_springless
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.fitted import Fit
from sinew.identify.oscillator.model import MODELS, parameter_name
from sinew.identify.oscillator.record import FEWEST, Excitation, Record
from sinew.identify.oscillator.start import dominant_omega, is_step
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import Estimate

_FEWEST_PERIODS = 2.0
_FEWEST_SAMPLES = 4.0  # in a period
_FEW_SAMPLES = 8.0
_POOR = 0.1  # rms of the residuals over the output's
_MUCH_BETTER = 0.5  # of the rms
_FREE = 1 / 3  # of the rms: a hand's is more than that; a spring that is not quite right makes less of a difference
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


def suspicions(found: Fit, *, compared: bool = False) -> tuple[str, ...]:
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
    return (*sentences, *_in_hand(found))


def _without_frequency(found: Fit) -> str:
    name, stiffness = _stiffness(found)
    if stiffness.high < 0:
        return (
            f"the stiffness came out negative ({name} = {stiffness}): the model does not fit this record, or is a "
            "sensor's sign reversed?"
        )
    told = f"the stiffness is not told from zero ({name} = {stiffness}), so there is no natural frequency"
    if not is_springless(found):
        return told
    damping = next((one for name, one in found.parameters.items() if name.startswith("damping_per_s")), None)
    settles = f", whose rate settles in {1 / damping.value:.3g} s" if damping is not None and damping.low > 0 else ""
    return f"{told}: this moves as a mass without a spring, a cart or a positioner{settles}"


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


def _in_hand(found: Fit) -> list[str]:
    """Return a sentence where a free decay begins before it is free: without its begin the same model leaves far less.

    The begin ends at the first extreme after the largest swing, for it is there that a hand lets go.
    """
    record = found.records[0]
    if record.input is not None or len(found.records) > 1 or not found.natural_frequency_hz.value > 0:
        return []
    first = _second_extreme(record.output - np.median(record.output[-record.size // 4 :]))
    later = record.cut(first, record.size)
    if (later.time_s[-1] - later.time_s[0]) * found.natural_frequency_hz.value < _FEWEST_PERIODS:
        return []
    if np.count_nonzero(found.kept[0][first:]) < FEWEST:  # the largest swing lies behind what was fitted
        return []
    try:
        free = fit(later, found.model, kept=[found.kept[0][first:]])
    except RecordingError:
        return []
    both = found.kept[0].copy()
    both[:first] = False
    left = float(np.sqrt(np.mean(found.residuals()[0][both] ** 2)))
    if free.rmse >= _FREE * left or _share_of(free) > _POOR:
        return []
    frequency, damping = free.natural_frequency_hz.value, free.damping_ratio.value
    return [
        f"the first {later.time_s[0] - record.time_s[0]:.3g} s look not free (a hand?): without them the same model "
        f"leaves {left / free.rmse:.2g} times less of the rest, with {frequency:.4g} Hz and a damping ratio of "
        f"{damping:.3g}; begin at sample {first}"
    ]


def _second_extreme(swing: NDArray[np.float64]) -> int:
    """Return the sample of the first extreme after the largest swing, about zero."""
    first = int(np.argmax(np.abs(swing)))
    after = swing[first:] * np.sign(swing[first])
    crossing = int(np.argmax(after < 0))
    back = crossing + int(np.argmax(after[crossing:] > 0))
    return first + crossing + int(np.argmin(after[crossing : max(back, crossing + 1)]))


def _share_of(found: Fit) -> float:
    return found.rmse / _deviation(found.records)


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
