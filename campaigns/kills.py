"""Runs killed with SIGKILL at random moments: `python -m campaigns.kills --runs 50`.

Every other one tracks a resonance (`sinew track`). Every interrupted run is gone on with, killed again while it
resumes, and completed in the end; see `campaigns.series`.
The table says how soon the motors were stopped, what the journals lack, and whether all was completed; exit status 1 if
something happened that may not. Takes real time: about 12 s for each kill.
"""

import json
import os
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from campaigns.options import campaign_parser
from campaigns.series import Kill, Series, kill_series

MOST_MISSING = 100
"""Half a second at 200 Hz."""

MOST_STOPPED_MS = 100.0
"""From the last instruction to the last motor's stop."""

_KILLS_EACH = 4


def run_series(kills: int, seed: int = 0) -> Iterator[Series]:
    """Yield series until there have been so many kills."""
    number = left = 0
    left = kills
    while left > 0:
        with tempfile.TemporaryDirectory() as folder:
            series = kill_series(number, min(left, _KILLS_EACH), Path(folder), seed)
        left -= len(series.kills)
        number += 1
        yield series


def violations(series: Sequence[Series]) -> list[str]:
    """Return what happened that may not."""
    found = [f"series {one.number}: {wrong}" for one in series for wrong in one.wrong]
    for kill in _kills(series):
        where = f"series {kill.series}, killed {kill.after_s:.2f} s after {kill.how} began"
        found += [f"{where}: {wrong}" for wrong in kill.wrong]
        if kill.heard_ms > MOST_STOPPED_MS:
            found.append(f"{where}: motors stopped {kill.heard_ms:.1f} ms after the last instruction")
        if kill.missing is not None and kill.missing > MOST_MISSING * kill.over:
            found.append(f"{where}: {kill.missing} samples are missing of {kill.over} kills")
        if not kill.is_sound:
            found.append(f"{where}: the journal makes no valid recording")
    found += [f"series {one.number} was not completed" for one in series if not one.is_complete]
    return found


def table(series: Sequence[Series]) -> str:
    """Return what became of all kills, as text."""
    kills = _kills(series)
    phases = Counter(f"{kill.how}, {kill.phase}" for kill in kills)
    lines = [f"{len(kills)} kills in {len(series)} runs, {sum('resume' in kill.how for kill in kills)} while resuming"]
    lines += [f"  {count:3d}  {phase}" for phase, count in sorted(phases.items())]
    under = [kill for kill in kills if not np.isnan(kill.stopped_ms)]
    lines.append(f"motors under torque with a watchdog at {len(under)} kills, all stopped by it:")
    lines.append(f"  from the last instruction  {_spread([kill.heard_ms for kill in under])} ms")
    lines.append(f"  from the kill              {_spread([kill.stopped_ms for kill in under])} ms")
    lines.append(f"  the lever went on by       {_spread([kill.turned_deg for kill in under])}°")
    missing = [kill.missing / kill.over for kill in kills if kill.missing is not None]
    lines.append(f"samples missing in the journal for each kill {_spread(missing)} of at most {MOST_MISSING}")
    sound = sum(kill.is_sound for kill in kills)
    lines.append(f"journal sound, and its recording valid: {sound} of {len(kills)}")
    complete = sum(one.is_complete for one in series)
    lines.append(f"completed by --resume: {complete} of {len(series)}")
    own = Counter(re.sub(r"\d+ ms", "… ms", end) for one in series for end in one.ended if end != "complete")
    lines += [f"  ended by itself {count} times: {sentence}" for sentence, count in own.most_common()]
    refused, stopped = (sum(bool(getattr(one, name)) for one in series) for name in ("refused", "stopped"))
    lines.append(f"a fresh run refused because torque was on {refused} times; `sinew stop` let go {stopped} times")
    slipped = max((one.slipped_s for one in series), default=0.0)
    lines.append(f"emulated time held up by at most {slipped:.2f} s; load average {os.getloadavg()[0]:.1f}")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the campaign, print its table, and return the exit status."""
    given = campaign_parser("kills", __doc__, count=50, verbose=True).parse_args(arguments)
    done: list[Series] = []
    for series in run_series(given.runs, given.seed):
        done.append(series)
        if given.verbose:
            for kill in series.kills:
                print(json.dumps(kill.document()), file=sys.stderr)
            print(series.number, series.ended, series.refused, series.stopped, file=sys.stderr, flush=True)
    wrong = violations(done)
    if given.out is not None:
        given.out.write_text(json.dumps([asdict(one) for one in done], indent=1) + "\n", encoding="utf-8")
    print(table(done))
    for sentence in wrong:
        print(f"!! {sentence}")
    return 1 if wrong else 0


def _kills(series: Sequence[Series]) -> list[Kill]:
    return [kill for one in series for kill in one.kills]


def _spread(values: Sequence[float]) -> str:
    if not len(values):
        return "(none)"
    return f"median {np.nanmedian(values):.1f}, largest {np.nanmax(values):.1f}"


if __name__ == "__main__":
    sys.exit(main())
