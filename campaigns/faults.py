"""Runs of the bench with everything that can go wrong: `python -m campaigns.faults`.

Each run is a short plan on the emulated bench in virtual time, with one fault, sometimes two, drawn from all kinds and
all moments; one run in four tracks a resonance. The table says how they ended; exit status 1 if something happened that
may not, see `campaigns.trial`.
"""

import json
import sys
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

from campaigns.options import campaign_parser, spread_of, spread_trials
from campaigns.scenario import PLANS, draw_scenario
from campaigns.table import summary, text
from campaigns.trial import Verdict, judge
from sinew.measure.tasks import HERE, Spread


def rest_tensions() -> dict[float, float]:
    """Return the tension of each tendon at rest [N] at every pretension of the plans [mm]."""
    from sinew.plan.toml import load_rig, parse_plan
    from sinew.twin.simulate import rest_tension

    plans = [parse_plan(f'name = "{name}"\n{body}') for name, body in PLANS.items()]
    ends = [plan.track.pretension_to_mm for plan in plans if plan.track is not None]
    visited = [mm for plan in plans for mm in plan.pretension.pretension_mm]
    asked = sorted({*visited, *(mm for mm in ends if mm is not None)})
    return dict(zip(asked, rest_tension(asked, load_rig("paper")).tolist(), strict=True))


def verdicts(seed: int, numbers: Sequence[int], spread: Spread = HERE) -> Iterator[Verdict]:
    """Yield what becomes of each run, in order."""
    yield from spread_trials(partial(_judge_number, seed, rest_tensions()), numbers, spread=spread)


def _judge_number(seed: int, tension_n: Mapping[float, float], number: int) -> Verdict:
    return judge(draw_scenario(seed, number), tension_n)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a campaign, print its table, and return the exit status."""
    given = campaign_parser("faults", __doc__, count=500, numbered=True, workers=1, verbose=True).parse_args(arguments)
    done = collected(verdicts(given.seed, range(given.first, given.first + given.runs), spread_of(given)), given, _line)
    return concluded(done, text(done), summary(done, given.seed), given.out)


def collected(runs: Iterable[Verdict], given: Namespace, line: Callable[[Verdict], str]) -> list[Verdict]:
    """Return the verdicts of all runs, told on stderr as they come: a line for each with --verbose, else how many."""
    done: list[Verdict] = []
    for verdict in runs:
        done.append(verdict)
        if given.verbose:
            bad = "".join(f"\n    !! {violation}" for violation in verdict.violations)
            print(f"{line(verdict)}{bad}", file=sys.stderr, flush=True)
        elif sys.stderr.isatty():
            print(f"\r{len(done)} of {given.runs}", end="", file=sys.stderr, flush=True)
    return done


def concluded(done: Sequence[Verdict], table: str, document: object, out: Path | None) -> int:
    """Print a campaign's table, write its document where a file is asked for, and return the exit status."""
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    print(table)
    return 1 if any(verdict.violations for verdict in done) else 0


def _line(verdict: Verdict) -> str:
    faults = ", ".join(verdict.faults) or "no fault"
    return (
        f"{verdict.number} {verdict.mode}/{verdict.safe_state} {faults} -> {verdict.outcome} "
        f"({verdict.groups_done}/{verdict.groups}) {verdict.sentence} | {verdict.stop} "
        f"[{verdict.virtual_s:.1f} s in {verdict.wall_s:.1f} s]"
    )


if __name__ == "__main__":
    sys.exit(main())
