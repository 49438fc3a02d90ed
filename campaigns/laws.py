"""The choice of a damping law, put to the test: `python -m campaigns.laws --seeds 20`.

Oscillations with hidden numbers (see `campaigns.law_signals`) go through what `sinew identify --model auto` does.
Whether their law can be told at all is decided without noise: the model of every other law that fits the clean record
best leaves a misfit; the difference of the information criterion that it makes in noise of the known size is what is to
be expected. From 20 on nine of ten draws of the noise exceed the 6 that decide (a difference of Δ scatters by 2√Δ), and
the law can be told; below 2 it cannot; what lies between is counted apart. Dry friction that is too small to be seen is
no law of its own: there the viscous law with a bound on the friction is right, where the bound holds the truth.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from campaigns.law_signals import (
    EXCITATIONS,
    LAWS,
    DampingLaw,
    Kind,
    Truth,
    clean_record,
    draw_truth,
    noisy_record,
)
from campaigns.options import TWO, asked_seeds, spread_of, spread_trials, trial_parser
from sinew.identify.choice.comparison import Comparison, compare_laws, laws_to_try, split_record
from sinew.identify.oscillator.fit import fit
from sinew.identify.oscillator.fitted import Fit
from sinew.identify.oscillator.model import Model, Rest
from sinew.identify.oscillator.record import Record
from sinew.mechanics.laws import BoucWen, Drag, DryFriction, LossFactor

CAN, CANNOT = 20.0, 2.0
Margin = Literal["can tell", "between", "cannot tell"]
Verdict = Literal["picked", "cannot tell", "bounded", "wrong"]
_EXTEND_VISCOUS: tuple[DampingLaw, ...] = ("coulomb", "drag")
MARGINS: tuple[Margin, ...] = ("can tell", "between", "cannot tell")
VERDICTS: tuple[Verdict, ...] = ("picked", "cannot tell", "bounded", "wrong")


@dataclass(frozen=True)
class Outcome:
    """What came of one oscillation.

    evidence: expected difference of the criterion to the nearest law. chosen: the law that is reported; model: its
    name. verdict: picked; cannot tell; bounded (viscous, and dry friction below a bound that holds the truth); wrong.
    own_misfit: what the generating law leaves of the clean record, over the noise.
    """

    truth: Truth
    seed: int
    evidence: float
    chosen: DampingLaw | Literal["hysteresis"]
    model: str
    verdict: Verdict
    own_misfit: float
    sentence: str

    @property
    def margin(self) -> Margin:
        """Return whether the law can be told."""
        return "can tell" if self.evidence > CAN else "cannot tell" if self.evidence < CANNOT else "between"


def expected_margin(clean: Record, truth: Truth, samples: int) -> tuple[float, float]:
    """Return (expected difference of the criterion to the nearest other law, own misfit over the noise).

    samples: that teach. Every law is given the richest stiffness law (and, in a decay, a creeping rest position) at the
    price of the generating one's, so the difference is rather too small. A law that contains the generating one (dry
    friction or drag beside viscous damping) is no other law.
    """
    noise = math.radians(truth.noise_deg) ** 2
    score = {}
    rests: tuple[Rest, ...] = ("offset", "creep") if truth.kind == "decay" else ("offset",)
    viscous = {rest: _fitted(clean, "viscous", rest, []) for rest in rests}
    for law in LAWS:
        fits = [one for rest, plain in viscous.items() for one in _fitted(clean, law, rest, plain)]
        left = min(one.rmse for one in fits if _law_of(one.model) == law) ** 2
        score[law] = (samples * math.log(noise + left) + (law in _EXTEND_VISCOUS) * math.log(samples), left)
    contained = _EXTEND_VISCOUS if truth.law == "viscous" else ()
    others = [one for law, (one, _) in score.items() if law != truth.law and law not in contained]
    own, misfit = score[truth.law]
    return min(others) - own, math.sqrt(misfit / noise)


def _law_of(model: Model) -> DampingLaw | Literal["hysteresis"]:
    if model.law.has(BoucWen):
        return "hysteresis"
    if model.law.has(Drag):
        return "drag"
    return "coulomb" if model.law.has(DryFriction) else "loss-factor" if model.law.has(LossFactor) else "viscous"


def _fitted(clean: Record, law: DampingLaw, rest: Rest, viscous: Sequence[Fit]) -> list[Fit]:
    """Return the fits of a law with springs of more and more terms; viscous: the same of that law, to begin at."""
    fits = list(viscous)
    for model in laws_to_try():
        if _law_of(model) == law and not (viscous and law == "viscous"):
            known = [one for one in fits if set(one.model.law.bends) <= set(model.law.bends)]
            fits.append(fit(clean, model.resting(rest), smaller=min(known, key=lambda one: one.rmse, default=None)))
    return fits


def run_trial(law: DampingLaw, kind: Kind, cubic: bool, seed: int) -> Outcome:
    """Return what comes of one oscillation."""
    truth = draw_truth(law, kind, cubic, seed)
    clean = clean_record(truth)
    split = split_record(noisy_record(clean, truth, seed), None, None)
    evidence, own = expected_margin(clean, truth, int(split.kept.sum()))
    found = compare_laws(split)
    chosen = found.best.model
    return Outcome(
        truth, seed, evidence, _law_of(chosen), chosen.name, _verdict(found, truth), own, found.verdict
    )  # fmt: skip


def _verdict(found: Comparison, truth: Truth) -> Verdict:
    if not found.decided:
        return "cannot tell"
    told = _law_of(found.best.model)
    if told == truth.law:
        return "picked"
    bound = found.dry_bound
    if truth.law == "coulomb" and told == "viscous" and bound is not None and truth.dry <= bound:
        return "bounded"
    return "wrong"


def table(outcomes: Sequence[Outcome]) -> str:
    """Return law x excitation as a Markdown table: counts of the verdicts, by whether the law can be told."""
    head = " | ".join(f"{margin}: {' / '.join(VERDICTS)}" for margin in MARGINS)
    lines = [f"| law | excitation | {head} |", "|---|---|" + "---|" * len(MARGINS)]
    rows: list[tuple[str, str, Iterable[Outcome]]] = [
        (law, kind, [one for one in outcomes if (one.truth.law, one.truth.kind) == (law, kind)])
        for law in LAWS
        for kind in EXCITATIONS
    ]
    for law, kind, mine in [*rows, ("all", "all", outcomes)]:
        own = list(mine)
        if own:
            cells = [" / ".join(str(count) for count in _counts(own, margin)) for margin in MARGINS]
            lines.append(f"| {law} | {kind} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _counts(outcomes: Sequence[Outcome], margin: Margin) -> list[int]:
    mine = [one.verdict for one in outcomes if one.margin == margin]
    return [mine.count(verdict) for verdict in VERDICTS]


def main() -> None:
    """Run the trials and print the table."""
    each = "oscillations for each law, excitation and spring"
    parser = trial_parser("laws", "Is the damping law found?", count=20, of=each, workers=TWO)
    parser.add_argument("--law", choices=LAWS, action="append", help="only this law")
    parser.add_argument("--excitation", choices=EXCITATIONS, action="append", help="only this excitation")
    parser.add_argument("--verbose", action="store_true", help="print every trial")
    chosen = parser.parse_args()
    trials = [
        (law, kind, cubic, seed)
        for seed in asked_seeds(chosen)
        for law in chosen.law or LAWS
        for kind in chosen.excitation or EXCITATIONS
        for cubic in (False, True)
    ]
    outcomes = []
    for outcome in spread_trials(run_trial, *zip(*trials, strict=True), spread=spread_of(chosen)):
        outcomes.append(outcome)
        if chosen.verbose:
            print(_line(outcome), flush=True)
    print(table(outcomes))
    told = [one for one in outcomes if one.margin == "can tell"]
    print(f"\npicked where it can be told: {np.mean([one.verdict == 'picked' for one in told]):.1%} of {len(told)}")
    print(f"wrong and decided: {sum(one.verdict == 'wrong' for one in outcomes)} of {len(outcomes)}")


def _line(one: Outcome) -> str:
    t = one.truth
    return (
        f"{one.seed:4d} {t.law:11s} {t.kind:6s} cubic {t.cubic:.2f} f {t.frequency_hz:.2f} D {t.damping_ratio:.3f} dry "
        f"{t.dry_share:.2f} noise {t.noise_deg:.2f} held {int(t.held)}: evidence {one.evidence:8.1f} own misfit "
        f"{one.own_misfit:.3f} -> {one.verdict}, {one.model}"
    )


if __name__ == "__main__":
    main()
