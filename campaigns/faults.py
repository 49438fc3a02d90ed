"""Runs of the bench with everything that can go wrong: `python -m campaigns.faults`.

Each run is a short plan on the emulated bench in virtual time, with one fault, sometimes two, drawn from all kinds and
all moments; one run in four tracks a resonance. The table says how they ended; exit status 1 if something happened that
may not, see `campaigns.trial`.

With `--hostile` a line strikes answers in one way (`campaigns.scenario`) from a moment on; most runs are then ended by
the operator, so that the stop is struck as well. Where answers come late, twice, in another order or behind junk,
every reading in journal and recording is held against how the joint moved. Where they are false and signed, a false
value that might be true is believed by anybody: then the journal is read for what no motor and no head can do.
"""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial

from campaigns.options import campaign_parser, conclude, spread_of, spread_trials
from campaigns.scenario import PLANS, Scenario, draw_hostile, draw_scenario
from campaigns.trial import Verdict, judge
from sinew.measure.tasks import HERE, Spread
from sinew.plan.toml import load_rig, parse_plan
from sinew.twin.simulate import rest_tension

OUTCOMES = ("complete", "stopped", "refused", "raised")
"""How a run may end: all groups recorded; ended early, by itself; not begun; by an error that has no name."""

_WRONG = ("wrong readings", "impossible readings")
_UNSAFE = ("outside the safe state", "refused, and a torque", "the report says")

Draw = Callable[[int, int], Scenario]


def rest_tensions() -> dict[float, float]:
    """Return the tension of each tendon at rest [N] at every pretension of the plans [mm]."""
    plans = [parse_plan(f'name = "{name}"\n{body}') for name, body in PLANS.items()]
    ends = [plan.track.pretension_to_mm for plan in plans if plan.track is not None]
    visited = [mm for plan in plans for mm in plan.pretension.pretension_mm]
    asked = sorted({*visited, *(mm for mm in ends if mm is not None)})
    return dict(zip(asked, rest_tension(asked, load_rig("paper")).tolist(), strict=True))


def verdicts(seed: int, numbers: Sequence[int], spread: Spread = HERE, draw: Draw = draw_scenario) -> Iterator[Verdict]:
    """Yield what becomes of each run, in order. draw: returns the scenario of a seed and number."""
    yield from spread_trials(partial(_judge_number, draw, seed, rest_tensions()), numbers, spread=spread)


def _judge_number(draw: Draw, seed: int, tension_n: Mapping[float, float], number: int) -> Verdict:
    return judge(draw(seed, number), tension_n)


def table(done: Sequence[Verdict]) -> dict[str, dict[str, int]]:
    """Return, by kind of fault: runs, and of them those it struck in time, outcomes, and what may not happen.

    struck: the fault came before the run had ended. The last columns count runs, not readings.
    """
    kinds = sorted({verdict.kind for verdict in done})
    return {kind: _row([v for v in done if v.kind == kind]) for kind in kinds} | {"all": _row(done)}


def _row(done: Sequence[Verdict]) -> dict[str, int]:
    def having(*starts: str) -> int:
        return sum(any(start in what for what in v.violations for start in starts) for v in done)

    return {
        "runs": len(done),
        "struck": sum(v.struck for v in done),
        **{outcome: sum(v.outcome == outcome for v in done) for outcome in OUTCOMES},
        "rows": sum(v.readings.rows for v in done),
        "readings": sum(v.readings.checked for v in done),
        **{why: sum(v.happened.get(f"marked {why}", 0) for v in done) for why in ("stale", "impossible")},
        "wrong": having(*_WRONG),
        "unsafe": having(*_UNSAFE),
        "no sentence": having("no sentence"),
        "any violation": sum(bool(v.violations) for v in done),
    }


def text(rows: Mapping[str, Mapping[str, int]]) -> str:
    """Return a table as text."""
    cells = [["fault", *rows["all"]], *([kind, *map(str, row.values())] for kind, row in rows.items())]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join("  ".join(map(str.rjust, line, widths)) for line in cells)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the campaign, print its table, and return the exit status."""
    parser = campaign_parser("faults", __doc__, count=500, numbered=True, workers=1, verbose=True)
    parser.add_argument("--hostile", action="store_true", help="instead of faults: a line that lies")
    given = parser.parse_args(arguments)
    draw = draw_hostile if given.hostile else draw_scenario
    done: list[Verdict] = []
    for verdict in verdicts(given.seed, range(given.first, given.first + given.runs), spread_of(given), draw):
        done.append(verdict)
        if given.verbose:
            print(_line(verdict), file=sys.stderr, flush=True)
    wrong = [
        f"run {one.number} ({', '.join(one.faults) or 'no fault'}): {what}" for one in done for what in one.violations
    ]
    return conclude(given.out, text(table(done)), [asdict(one) for one in done], wrong)


def _line(verdict: Verdict) -> str:
    faults = ", ".join(verdict.faults) or "no fault"
    line = (
        f"{verdict.number} {verdict.mode}/{verdict.safe_state} {faults} -> {verdict.outcome} "
        f"({verdict.groups_done}/{verdict.groups}) {verdict.sentence} | {verdict.stop} {verdict.happened} "
        f"[{verdict.virtual_s:.1f} s in {verdict.wall_s:.1f} s]"
    )
    return "\n    !! ".join([line, *verdict.violations])


if __name__ == "__main__":
    sys.exit(main())
