"""Competition of models for a record: held-out prediction first, the information criterion second.

A model stays in the race if it predicts what was held out no worse than the best predictor does (squared errors
compared in pairs, block by block, two standard errors). Of those that stay the smallest BIC wins, or a smaller model
whose BIC is within 2 of it. Where another damping law comes within a factor e³ = 20 of its evidence and is no mere
extension of it, the record cannot tell the two apart, and the verdict says so. Dry friction that adds nothing to
viscous damping is bounded. The winner's residuals are tested, and the verdict says how that came out; where even the
winner misses more than a tenth of the motion, and not by noise, no law is told.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.least_squares import restricted, solve
from sinew.identify.oscillator.model import (
    MODELS,
    SIGNIFICANT,
    VISCOUS,
    Fit,
    Model,
    ask_fit,
    get_model,
    make_layout,
    make_part,
)
from sinew.identify.oscillator.record import FEWEST, Record, dominant_omega
from sinew.identify.oscillator.track import LOCAL, PLACE
from sinew.measure.arrays import Array, Mask
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import Estimate
from sinew.measure.tasks import cores
from sinew.mechanics.laws import HISTORIES, TERMS, BoucWen, Cubic, DryFriction, Law, Linear, Pendulum, Viscous

Progress = Callable[[float, float], None]

# ---- the held-out part of a record, predicted by what the other part taught
#
# Three ways: a test range after the training range is reached by simulating on; one before it, or in another record, is
# predicted with the mechanics and rest position known and only its start sought, from its first two periods; and where
# no ranges are named, blocks all over the record are left out of the sum of squares while the simulation runs through
# them.


_LEFT_OUT = 40
_EVERY = 4  # block of them is held out
_SEEN_PERIODS = 2.0


@dataclass(frozen=True)
class Split:
    """A record and which of its samples teach and which test.

    record: from the first sample that is used on. kept, tested: shape (n,). apart: the record of a test range that
    comes before the training range, else None (then `tested` is empty). interleaved: whether blocks were chosen here.
    whole: of those the record as all samples tell it, for the fit to all of them, where it is not `record`; else None.
    """

    record: Record
    selected: Mask
    tested: Mask
    apart: Record | None = None
    interleaved: bool = False
    whole: Record | None = None


@dataclass(frozen=True)
class HeldOut:
    """A fit and how it predicts what it has not seen: measured less predicted, unit of the output, shape (t,)."""

    fit: Fit
    residual: Array

    @property
    def rmse(self) -> float:
        """Return the root mean square over the held-out samples."""
        return float(np.sqrt(np.mean(self.residual**2)))


def split_record(record: Record, train: tuple[int, int] | None, test: tuple[int, int] | None) -> Split:
    """Return how a record is divided. train, test: sample indices, half open, or None.

    Without a test range, what lies behind the training range is the test if it is a tenth of it or longer, else blocks
    of the training range. Raises SpecError for ranges that are not in the record.
    """
    train = _checked("train", train or (0, record.size), record.size)
    if test is None and record.size - train[1] >= 0.1 * (train[1] - train[0]) and train[1] < record.size - FEWEST:
        test = (train[1], record.size)
    if test is None:
        part = record.cut(*train)
        tested = _left_out(part)
        return Split(part, ~tested, tested, interleaved=True)
    test = _checked("test", test, record.size)
    if test[0] < train[0]:
        part = record.cut(*train)
        everything = np.ones(part.size, dtype=bool)
        return Split(part, everything, ~everything, record.cut(*test))
    part = record.cut(train[0], max(train[1], test[1]))
    index = np.arange(part.size) + train[0]
    return Split(part, index < train[1], (index >= test[0]) & (index < test[1]))


def _checked(name: str, found: tuple[int, int], size: int) -> tuple[int, int]:
    low, high = found
    if not 0 <= low < high <= size:
        raise SpecError(f"--{name} is {low}:{high}, expected A:B with 0 <= A < B <= {size}, the number of samples")
    if high - low < FEWEST:
        raise RecordingError(f"--{name} holds {high - low} samples, expected at least {FEWEST}; widen it")
    return low, high


def _left_out(record: Record) -> Mask:
    period = 2 * np.pi / dominant_omega(record) / record.step_s
    length = max(1, min(round(max(0.5 * period, record.size / _LEFT_OUT)), record.size // (2 * _EVERY)))
    block = np.arange(record.size) // length
    return np.asarray(block % _EVERY == _EVERY - 1)


def fit_and_predict(split: Split, model: Model | str, smaller: Fit | None = None) -> HeldOut:
    """Return the fit to the training samples, and what it leaves of the held-out ones.

    smaller: a fit of a smaller model to the same samples, at which the search begins.
    """
    found = fit(split.record, model, selected=[split.selected], smaller=smaller)
    if split.apart is not None:
        return HeldOut(found, split.apart.output - predict(found, split.apart))
    return HeldOut(found, found.residuals()[0][split.tested])


def predict(fitted: Fit, record: Record) -> Array:
    """Return the output of another record by a fit's mechanics and rest position, shape (n,), in its unit.

    Of several groups the record's own is taken, of several records in it the median rest position. Only where the
    record starts is not known; it is sought in the record's first two periods. A drift is not carried over.
    """
    mine = [i for i, part in enumerate(fitted.layout.parts) if part.record.group == record.group]
    mine = mine or list(range(len(fitted.layout.parts)))
    scales = fitted.layout.parts[mine[0]].scales
    part = make_part(record, fitted.model.resting("offset"), scales, fitted.frame, np.ones(record.size, dtype=bool))
    each = [fitted.layout.local(fitted.solution.values, i) for i in mine]
    known = each[0].copy()
    offset = PLACE["offset"]
    sizes = [one[offset] * fitted.layout.parts[i].unit_size for one, i in zip(each, mine, strict=True)]
    known[offset] = float(np.median(sizes)) / part.unit_size
    layout = make_layout(fitted.model.resting("offset"), [part])
    x = known[layout.column[0]].copy()
    free = np.array([k for k, entry in enumerate(layout.entries) if entry.local in ("start", "start_rate")])
    x[free] = 0.0
    seen = np.arange(record.size) < max(FEWEST, int(_SEEN_PERIODS * 2 * np.pi / scales.omega / record.step_s))
    x[free] = solve(restricted(layout.problem([seen]), x, free), x[free], tolerance=1e-8, max_evaluations=60).values
    return np.asarray(layout.outputs(x)[0] * part.unit_size)


# ---- the competition


_CLEAR, _HINT = 6.0, 2.0  # differences of BIC: told for certain; too small to add a term
_WORSE = 2.0  # standard errors of the paired difference of squared errors
_BLOCKS = 12
_HOPELESS = 1.5  # times the held-out error
_NEAR = 30.0  # a difference of BIC that another spring, or a better minimum, may still make up for
_SURE = 8.0  # standard deviations from zero of a term without which nothing needs to be tried
_REFINEMENTS = 3
_SMALL_SWING = 0.1  # rad: a pendulum's frequency changes by 0.06 % there
_USUAL_FITS = 18
_MOST_STEPS = 50_000  # of hysteresis: some ten seconds
_FACTS = 4.0  # of a swing: size and time of both its extremes
_MEMORY = "memory"  # of a loss factor, which unlike that of hysteresis has an end
_POOR, _SMOOTH = 0.1, 0.5  # residuals' share of the output, and correlation of neighbours, of a misfit that is no noise

SPRING, DRY = Law((Linear(),)), Viscous() + DryFriction()


@dataclass(frozen=True)
class Row:
    """One model's result: rmse over what was held out, in the unit of the output, and BIC over what was fitted.

    held_out: a fit and what it left of the held-out samples. squares: their mean square by block, shape (b,).
    """

    model: Model
    rmse_test: float
    bic: float
    held_out: HeldOut
    squares: Array


@dataclass(frozen=True)
class Choice:
    """The winner of a race.

    rivals: the other damping laws that the data cannot tell from it. rows: all, best first. impossible: what would have
    won, but only with numbers that nothing has (see `impossible_numbers`), or None.
    """

    best: Row
    rivals: tuple[Row, ...]
    rows: tuple[Row, ...]
    impossible: Row | None = None


@dataclass(frozen=True)
class Comparison:
    """Which model the data support.

    rows: best first. best: the fit of the winner, to all of the data where parts of it were held out once.
    decided: whether the damping law is told from the others. verdict: one sentence.
    dry_bound: where viscous damping is told from a loss factor and dry friction adds nothing to it, the upper end of
    the friction's 90 % interval, over the inertia, in the motion's unit per s²; else None.
    """

    rows: tuple[Row, ...]
    best: Fit
    decided: bool
    verdict: str
    dry_bound: float | None = None


def compare(split: Split, models: Sequence[Model]) -> Comparison:
    """Return which of the models a record supports. Raises RecordingError where none of them can be fitted."""
    race = _Race(split)
    race.add(models)
    return _finish(split, race.rows)


def compare_laws(split: Split, progress: Progress | None = None) -> Comparison:
    """Return the best of all damping laws and stiffness laws.

    With viscous damping the stiffness law is found, and whether the rest position of a free decay creeps; with these
    the damping laws compete; for those that come near, the spring is then made simpler and richer by a term. Hysteresis
    that yields is tried beside the best law where that is dry friction, its limit, or leaves what is no noise.
    progress: called with (done, total) fits; how many there will be is not known before.
    """
    race = _Race(split, progress)
    tried = [model for model in laws_to_try() if _goes_with(model, split.record)]
    race.add(model for model in tried if model.law.losses == VISCOUS)
    first = choose(race.rows).best.model
    if split.record.excitation == "none":
        race.add([first.resting("creep")])
        if choose(race.rows).best.model.rest == "creep":
            race.add([row.model.resting("creep") for row in race.rows])
            first = choose(race.rows).best.model
    springs = _springs_to_try(race.rows, first)
    race.add(one.resting(first.rest) for one in tried if one.law.springs in springs)
    for _ in range(_REFINEMENTS):  # of a law that comes near, the spring and the rest position
        if not race.add([model for row in _near(race.rows) for model in _neighbours(row, tried)]):
            break
    best = choose(race.rows).best
    if best.model.law.sticks or ask_fit(best.held_out.fit).white_p < SIGNIFICANT:
        race.add(_hysteresis(best))
    if progress is not None:
        progress(race.done, race.done)
    return _finish(split, race.rows)


class _Race:
    """A race that goes on: its rows, and how many fits it has made."""

    def __init__(self, split: Split, progress: Progress | None = None) -> None:
        self.rows: list[Row] = []
        self.done = 0
        self._split, self._progress = split, progress or (lambda done, total: None)

    def add(self, models: Iterable[Model]) -> bool:
        """Fit those models that have no row yet; return whether there were any.

        Those with equally many terms are fitted at once, on as many cores as there are. Raises RecordingError where
        there is no row then.
        """
        new = [model for model in dict.fromkeys(models) if all(row.model != model for row in self.rows)]
        refused: list[RecordingError] = []
        with ThreadPoolExecutor(cores()) as pool:
            for terms in sorted({len(model.law.terms) for model in new}):
                level = [model for model in new if len(model.law.terms) == terms]
                known = [_smaller(self.rows, model) for model in level]
                for model, found in zip(level, pool.map(self._fitted, level, known), strict=True):
                    if isinstance(found, RecordingError):
                        refused.append(found)
                    elif np.isfinite(found.rmse):
                        self.rows.append(Row(model, found.rmse, np.nan, found, _blocks(found.residual)))
                    self.done += 1
                    self._progress(self.done, max(_USUAL_FITS, self.done + 1))
        if not self.rows:
            raise refused[0] if refused else RecordingError("no model can be fitted to this record")
        return bool(new)

    def _fitted(self, model: Model, smaller: Fit | None) -> HeldOut | RecordingError:
        try:
            return fit_and_predict(self._split, model, smaller=smaller)
        except RecordingError as error:
            return error


def _hysteresis(best: Row) -> list[Model]:
    """Return the model of hysteresis with the best one's spring; none where its small steps would be too many."""
    model = get_model("bouc-wen-cubic" if best.model.law.has(Cubic) else "bouc-wen").resting(best.model.rest)
    part = best.held_out.fit.layout.parts[0]
    steps = part.record.size * np.ceil(part.record.step_s * part.scales.omega / model.law.phase)
    return [model] if steps <= _MOST_STEPS else []


def _goes_with(model: Model, record: Record) -> bool:
    """Return whether a model can be told from a plainer one: a pendulum only by an angle that swings far."""
    if not model.law.has(Pendulum):
        return True
    return record.output_unit == "rad" and 0.5 * float(np.ptp(record.output)) > _SMALL_SWING


def _springs_to_try(rows: Sequence[Row], first: Model) -> set[Law]:
    """Return the springs that damping laws are tried with: the best under viscous damping, and those without numbers of
    their own unless they are hopeless, for a damping law can do what a stiffness term had mimicked. Without a spring
    that is told from none it is the linear one."""
    plain = {row.model.law.springs: row for row in rows if not row.model.law.bends and row.model.rest == first.rest}
    linear = plain.get(SPRING)
    if linear is not None and is_springless(linear.held_out.fit):
        return {SPRING}
    best = min(row.rmse_test for row in rows if row.model == first)
    return {first.law.springs} | {one for one, row in plain.items() if row.rmse_test <= _HOPELESS * best}


def is_springless(found: Fit) -> bool:
    """Return whether a driven motion is described by a fit whose stiffness is not told from zero."""
    driven = found.records[0].excitation != "none"
    return driven and np.isnan(found.natural_frequency_hz.value) and ask_fit(found).share < _POOR


def _near(rows: Sequence[Row]) -> list[Row]:
    """Return of every damping law the row with the most evidence, if it may still win."""
    rows = _with_criterion(rows)
    lowest = min(row.bic for row in rows)
    laws = dict.fromkeys(model.law.losses for model in laws_to_try())
    best = (min((r for r in rows if r.model.law.losses == law), key=lambda r: r.bic, default=None) for law in laws)
    return [row for row in best if row is not None and row.bic < lowest + _NEAR]


def _neighbours(row: Row, tried: Sequence[Model]) -> Iterable[Model]:
    """Return the models with terms less, where those may be nothing, and with a term more; of a pendulum none."""
    model, found = row.model, row.held_out.fit
    names = [entry.local for entry in found.layout.entries]

    def surely(local: str) -> bool:
        k = names.index(local)
        return bool(abs(found.solution.values[k]) > _SURE * found.covariance.std[k])

    ladder = [one for one in tried if one.law.losses == model.law.losses and not one.law.has(Pendulum)]
    at = next((i for i, one in enumerate(ladder) if one.law.springs == model.law.springs), len(ladder))
    for less in ladder[:at] if at < len(ladder) else ():
        if not any(surely(term) for term in set(model.law.bends) - set(less.law.bends)):
            yield less.resting(model.rest)
    if at + 1 < len(ladder) and not is_springless(found):
        yield ladder[at + 1].resting(model.rest)
    if model.rest == "creep" and not surely("drift"):
        yield model.resting("offset")


def laws_to_try() -> tuple[Model, ...]:
    """Return every damping law with every stiffness law, less what is asked for by name or tried beside a winner."""
    return tuple(model for model in MODELS.values() if not any(term.by_name for term in model.law.terms))


def _smaller(rows: Sequence[Row], model: Model) -> Fit | None:
    """Return the best fit of the models that a model extends, or whose viscous damping it replaces; None without."""
    extended = [
        row.held_out.fit
        for row in rows
        if row.model.law.losses in (VISCOUS, model.law.losses, *([DRY] if model.law.has(BoucWen) else []))
        and (row.model.law.springs == SPRING or set(row.model.law.springs.terms) <= set(model.law.springs.terms))
        and row.model.rest in ("offset", model.rest)
    ]
    return min(extended, key=lambda one: one.rmse, default=None)


def _finish(split: Split, rows: Sequence[Row]) -> Comparison:
    choice = choose(rows)
    final = choice.best.held_out.fit
    if split.interleaved:
        final = fit(split.whole or split.record, choice.best.model, guess=final)
    return conclude(choice, final)


def _blocks(residual: Array) -> Array:
    size = max(1, residual.size // _BLOCKS)
    count = residual.size // size
    return np.asarray((residual[: count * size] ** 2).reshape(count, size).mean(axis=1))


def criterion(found: Fit, independent: float, swings: float = np.inf) -> float:
    """Return the information criterion n ln(mean squared residual) + m ln n + 2m(m + 1)/(4s - m - 1).

    independent: n, how many independent residuals there are; swings: s; the same for all models that are compared. The
    last term is Akaike's for small samples (Hurvich and Tsai 1989): however densely it is sampled, a swing tells four
    things of the mechanics, size and time of both its extremes, and from three swings nine numbers can be told of any.

    What a loss factor saw before the record (`memory`, 0 after steady swinging, 1 after a long rest) costs what it was
    narrowed down by, at most as much as another number: -2 ln(std √2π); nothing where the record does not tell it; and
    the square of its distance from there, for a past that cannot have been is no explanation.
    """
    whole = float(np.log(independent))
    count = sum(entry.local not in HISTORIES for entry in found.layout.entries)
    cost = 2.0 * count * (count + 1) / max(_FACTS * swings - count - 1, 1.0)
    for entry, std, value in zip(found.layout.entries, found.covariance.std, found.solution.values, strict=True):
        if entry.local not in HISTORIES:
            cost += whole
            continue
        noise = -2 * np.log(max(float(std), 1e-12) * np.sqrt(2 * np.pi)) if np.isfinite(std) else 0.0
        beyond = float(value - np.clip(value, *LOCAL[entry.local].start)) if entry.local == _MEMORY else 0.0
        cost += float(np.clip(noise, 0.0, whole)) + beyond**2
    return float(independent * np.log(max(found.rmse, 1e-300) ** 2) + cost)


def choose(rows: Sequence[Row]) -> Choice:
    """Return the winner of a race. rows: of the same data; their BIC is set here."""
    rows = _with_criterion(rows)
    possible = [row for row in rows if not impossible_numbers(row.held_out.fit.parameters)] or rows
    staying = _staying(possible)
    lowest = min(row.bic for row in staying)
    best = min((row for row in staying if row.bic < lowest + _HINT), key=_plainness)
    rivals = [row for row in staying if _rivals(row, best, staying)]
    if any(row.model.law.losses == VISCOUS for row in rivals):  # nothing speaks against the plainest law
        plain = min((row for row in rivals if row.model.law.losses == VISCOUS), key=lambda row: row.bic)
        best, rivals = plain, [best, *(row for row in rivals if row.model.law.losses != VISCOUS)]
    stays = [id(row) for row in staying]
    rows.sort(key=lambda row: (row is not best, id(row) not in stays, row.bic))
    names = [row.model.name for row in rows]  # of two rest positions the better
    shown = tuple(row for i, row in enumerate(rows) if row.model.name not in names[:i])
    everyone = min(_staying(rows), key=lambda row: row.bic)
    beaten = everyone.bic < best.bic - _CLEAR and all(everyone is not row for row in possible)
    return Choice(best, tuple(rivals), shown, everyone if beaten else None)


def impossible_numbers(parameters: Mapping[str, Estimate]) -> list[str]:
    """Return the damping numbers of a fit that are negative for certain, beyond their 90 % interval.

    parameters: of a fit to records or to steady states.
    """
    damping = tuple(number.name for term in TERMS if term.lost for number in term.numbers if number.positive)
    return [name for name, one in parameters.items() if name.startswith(damping) and one.high < 0]


def _with_criterion(rows: Sequence[Row]) -> list[Row]:
    # Misfit makes residuals smooth, so the number that are independent is the best model's, the same for all.
    best = min((row.held_out.fit for row in rows), key=lambda one: one.rmse)
    lasts = sum(float(record.time_s[-1] - record.time_s[0]) for record in best.records)
    omega = best.layout.parts[0].scales.omega  # of the motion, whether or not a spring makes it
    swings = lasts * omega / (2 * np.pi)
    return [replace(row, bic=criterion(row.held_out.fit, best.effective_samples, swings)) for row in rows]


def conclude(choice: Choice, final: Fit, what: str = "record") -> Comparison:
    """Return the comparison with its verdict. final: the winner's fit to all of the data, which are called `what`."""
    bound, words = _dry_bound(choice)
    question = ask_fit(final)
    if question.share > _POOR and question.neighbours > _SMOOTH and len(choice.rows) > 1:
        sentence = (
            f"cannot tell the damping law, for no model describes this {what}: {choice.best.model.name}, which leaves "
            f"least, misses {100 * question.share:.0f} % of the output's standard deviation; {question.telling()}"
        )
        return Comparison(choice.rows, final, False, sentence)
    verdict = f"{_verdict(choice, what)}{words}{_impossible(choice)}{_begins_late(final)}; {question.telling()}"
    return Comparison(choice.rows, final, not choice.rivals, verdict, bound)


def _plainness(row: Row) -> tuple[int, bool, float]:
    return len(row.model.mechanics("none")), row.model.law.has(Pendulum), row.bic


def _staying(rows: Sequence[Row]) -> list[Row]:
    converged = [row for row in rows if row.held_out.fit.converged] or list(rows)
    first = min(converged, key=lambda row: row.rmse_test)
    return [row for row in converged if not _is_worse(row.squares, first.squares)]


def _is_worse(one: Array, other: Array) -> bool:
    """Return whether one model's squared errors are larger than another's beyond chance; by block, shape (b,)."""
    difference = one - other
    if one.size < 4:
        return bool(difference.mean() > 0.1 * float(other.mean()))
    error = float(difference.std(ddof=1)) / np.sqrt(one.size)
    return bool(difference.mean() > _WORSE * error and difference.mean() > 0.01 * float(other.mean()))


def _rivals(row: Row, best: Row, staying: Sequence[Row]) -> bool:
    """Return whether another damping law has nearly the evidence of the best and is no mere extension of it."""
    if row.model.law.losses == best.model.law.losses or row.bic > best.bic + _CLEAR:
        return False
    if not any(number.absent for number in row.model.law.losses.numbers):
        return True
    # Friction and drag extend viscous damping, and are no rivals where they add nothing to it.
    return not any(other.model.law.losses == VISCOUS and other.bic <= row.bic for other in staying)


def _impossible(choice: Choice) -> str:
    """Return the words on a model that is out of the race because a damping number of it is negative."""
    if choice.impossible is None:
        return ""
    found = choice.impossible.held_out.fit
    name = impossible_numbers(found.parameters)[0]
    return (
        f"; {choice.impossible.model.name} leaves less but is out of the race: its {name} = "
        f"{found.parameters[name].value:.3g} is negative beyond its interval, which nothing has"
    )


def _begins_late(found: Fit) -> str:
    """Return the words where what seems to creep is over within a period: the motion was not free yet."""
    record = found.records[0]
    lasts = float(record.time_s[-1] - record.time_s[0])
    for name, one in found.nuisance.items():
        creep_s = lasts * float(np.exp(min(one.value, 50.0)))
        if name.startswith("creep_time") and creep_s * found.natural_frequency_hz.value < 1.0:
            return f"; what creeps is over in {creep_s:.2g} s, less than a period: if it was not free yet, begin later"
    return ""


def _dry_bound(choice: Choice) -> tuple[float | None, str]:
    """Return how much dry friction there may be beside viscous damping that is told, and the words for it."""
    best = choice.best.model
    if choice.rivals or best.law.losses != VISCOUS:
        return None, ""
    same = [row for row in choice.rows if row.model.law.sticks and row.model.law.springs == best.law.springs]
    if not same:
        return None, ""
    ends = {name: one.high for name, one in same[0].held_out.fit.parameters.items() if name.startswith("coulomb")}
    over = [name for name in ends if name.split("[")[0].endswith("per_s2")]
    shown = [name for name in ends if name not in over] or over  # in full, where the inertia is known
    if not np.isfinite([ends[name] for name in over]).all():
        return None, ""
    largest = max(shown, key=lambda name: ends[name])
    sentence = f"; dry friction, if there is any, is below {largest} = {max(ends[largest], 0.0):.3g}"
    return max(0.0, *(ends[name] for name in over)), sentence


def _verdict(choice: Choice, what: str) -> str:
    best, rivals, rows = choice.best, choice.rivals, choice.rows
    loss, stiffness = (one.in_words() for one in (best.model.law.losses, best.model.law.springs))
    stiffness = "a motion without a spring" if is_springless(best.held_out.fit) else stiffness
    law = f"{loss}{' and a creeping rest position' if best.model.rest == 'creep' else ''}"
    if rivals:
        others = " or ".join(dict.fromkeys(row.model.law.losses.in_words() for row in rivals))
        return (
            f"cannot tell {loss} from {others} in this {what} (BIC within {_CLEAR:g}, held-out "
            f"errors alike); {stiffness} with {law} is reported"
        )
    if len(rows) == 1:
        return f"{stiffness} with {law} was fitted; no other model was tried"
    second = min((row for row in rows if row is not best), key=lambda row: row.bic)
    gain = second.bic - best.bic
    criterion_says = f"BIC smaller by {gain:.3g}" if gain > 0 else f"whose smaller BIC (by {-gain:.3g}) counts less"
    return (
        f"{stiffness} with {law} is preferred: held-out rmse {best.rmse_test:.3g} against {second.rmse_test:.3g} of "
        f"{second.model.name}, {criterion_says}"
    )


# Models compete for several segments of one experiment: every third of them is held out in turn.
#
# A joint that was recorded at many frequencies is one joint: the segments share its mechanics. A model is fitted to two
# thirds of the segments and predicts the others, of which only the start is sought, from their first two periods. The
# information criterion is that of the fit to all segments. What decides is the same as for one record.

_FOLDS = 3
_FEWEST = 3


def compare_segments(
    records: Sequence[Record],
    models: Sequence[Model | str],
    progress: Progress | None = None,
) -> Comparison:
    """Return which of the models several segments of one experiment support.

    records: three or more. progress: called with (done, total) fits.

    rows[0].rmse_test is over the held-out segments, each of which was held out once.
    Raises SpecError for fewer than three segments, RecordingError where no model can be fitted to them.
    """
    records = tuple(records)
    if len(records) < _FOLDS:
        raise SpecError(f"found {len(records)} segments, expected at least {_FOLDS}; record more of them")
    tried = [get_model(m) if isinstance(m, str) else m for m in models]
    rows: list[Row] = []
    refused: list[RecordingError] = []
    for done, model in enumerate(tried):
        try:
            rows.append(_segment_row(records, model))
        except RecordingError as error:
            refused.append(error)
        if progress is not None:
            progress(done + 1, len(tried))
    rows = [row for row in rows if np.isfinite(row.rmse_test)]
    if not rows:
        raise refused[0] if refused else RecordingError("no model can be fitted to these segments")
    choice = choose(rows)
    return conclude(choice, choice.best.held_out.fit, f"recording ({len(records)} segments)")


def _segment_row(records: Sequence[Record], model: Model) -> Row:
    whole = fit(records, model)
    residuals: list[Array] = [np.zeros(0)] * len(records)
    for fold in range(_FOLDS):  # of three segments in turn the third, the first, the second
        held = range((fold - 1) % _FOLDS, len(records), _FOLDS)
        taught = fit([record for i, record in enumerate(records) if i not in held], model)
        for i in held:
            residuals[i] = records[i].output - predict(taught, records[i])
    squares = np.array([float(np.mean(r**2)) for r in residuals])
    together = np.concatenate(residuals)
    return Row(model, float(np.sqrt(np.mean(together**2))), np.nan, HeldOut(whole, together), squares)
