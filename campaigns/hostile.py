"""A hostile line between driver and devices: `python -m campaigns.hostile`.

Each run is a short plan on the emulated bench in virtual time, over a line that strikes answers in one way
(`campaigns.lies`) from a moment on, drawn with the seed; most are then ended by the operator, so that the stop is
struck as well. The table says how they ended and how many answers were marked as stale or impossible. Exit status 1 if
something happened that may not: a traceback, a run without end, an end outside the safe state or without a sentence, a
report that says more than is true, or a reading taken for valid that was stale or impossible.

Where answers come late, twice, in another order or behind junk, every reading in journal and recording is held against
how the joint moved. Where they are false and signed, a false value that might be true is believed by anybody: then the
journal is read for what no motor and no head can do.
"""

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from campaigns.faults import collected, concluded, rest_tensions
from campaigns.lies import LIE_KINDS, Lies
from campaigns.options import campaign_parser, spread_of, spread_trials
from campaigns.scenario import Scenario, draw_scenario
from campaigns.trial import Verdict, judge
from sinew.measure.tasks import HERE, Spread

_EARLY_S, _LATE_S = (0.0, 4.0), (7.0, 11.0)  # when it becomes hostile: set-up and pull; levelling and swing
_EARLY = 0.7  # of the runs, which are cheap
_OUTCOMES = ("complete", "stopped", "refused", "raised")


def draw_hostile(seed: int, number: int) -> Scenario:
    """Return run `number` of the campaign with that seed; kinds take turns."""
    rng = np.random.default_rng([seed, number, 19])
    start = float(rng.uniform(*(_EARLY_S if rng.random() < _EARLY else _LATE_S)))
    stop = float("inf") if rng.random() < 0.5 else start + float(rng.uniform(0.1, 4.0))
    share = float(10 ** rng.uniform(-2.0, 0.0))
    lies = Lies(
        LIE_KINDS[number % len(LIE_KINDS)], round(share, 4), round(start, 3), round(stop, 3), int(rng.integers(1 << 31))
    )
    interrupt = start + float(rng.uniform(0.2, 1.5)) if rng.random() < 0.95 else float("inf")
    drawn = draw_scenario(seed, number).without_faults()
    mode = drawn.mode if rng.random() < 0.5 else "position"
    return replace(drawn, plan="one frequency", mode=mode, lies=lies, interrupt_s=round(interrupt, 3))


def verdicts(seed: int, numbers: Sequence[int], spread: Spread = HERE) -> Iterator[Verdict]:
    """Yield what becomes of each run, in order."""
    yield from spread_trials(partial(_judge_number, seed, rest_tensions()), numbers, spread=spread)


def _judge_number(seed: int, tension_n: Mapping[float, float], number: int) -> Verdict:
    return judge(draw_hostile(seed, number), tension_n)


def table(done: Sequence[Verdict]) -> str:
    """Return the runs by kind, and what may not happen."""
    head = ["line", "runs", *_OUTCOMES, "struck", "readings", "stale", "impossible", "violations"]
    rows = [head, *(_row(kind, [v for v in done if v.kind == kind]) for kind in LIE_KINDS), _row("all", done)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    for verdict in done:
        lines += [f"run {verdict.number} ({', '.join(verdict.faults)}): {what}" for what in verdict.violations]
    return "\n".join(lines)


def _row(name: str, done: Sequence[Verdict]) -> list[str]:
    counts = [sum(v.outcome == outcome for v in done) for outcome in _OUTCOMES]
    happened = [sum(v.happened.get(what, 0) for v in done) for what in ("struck", "marked stale", "marked impossible")]
    checked, bad = sum(v.readings.checked for v in done), sum(bool(v.violations) for v in done)
    return [name, *map(str, (len(done), *counts, happened[0], checked, *happened[1:], bad))]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a campaign, print its table, and return the exit status."""
    given = campaign_parser("hostile", __doc__, count=300, numbered=True, workers=1, verbose=True).parse_args(arguments)
    done = collected(verdicts(given.seed, range(given.first, given.first + given.runs), spread_of(given)), given, _line)
    return concluded(done, table(done), [v.document() for v in done], given.out)


def _line(verdict: Verdict) -> str:
    return (
        f"{verdict.number} {verdict.mode}/{verdict.safe_state} {', '.join(verdict.faults)} -> "
        f"{verdict.outcome}: {verdict.sentence} | {verdict.stop} {verdict.happened} "
        f"[{verdict.virtual_s:.1f} s in {verdict.wall_s:.1f} s]"
    )


if __name__ == "__main__":
    sys.exit(main())
