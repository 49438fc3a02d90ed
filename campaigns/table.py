"""The campaign's table, from its verdicts: fault x outcome."""

from collections.abc import Sequence
from typing import Any

from campaigns.trial import Verdict
from sinew.emulator.faults import DRAWN_KINDS

OUTCOMES = ("complete", "stopped", "refused")
"""How a run may end: all groups recorded; ended early, by itself; not begun."""

_WRONG = "wrong readings"
_UNSAFE = ("outside the safe state", "refused, and a torque", "the report says")
_SPEECHLESS = "no sentence"


def table(verdicts: Sequence[Verdict]) -> dict[str, dict[str, int]]:
    """Return, by kind of fault: runs, and of them those it struck in time, outcomes, and what may not happen.

    struck: the fault came before the run had ended. The last columns count runs, not readings.
    """
    kinds = ["none", *DRAWN_KINDS, "two at once"]
    rows = {kind: _row([v for v in verdicts if v.kind == kind]) for kind in kinds}
    return {kind: row for kind, row in rows.items() if row["runs"]} | {"all": _row(verdicts)}


def summary(verdicts: Sequence[Verdict], seed: int) -> dict[str, Any]:
    """Return the campaign as one JSON document."""
    return {
        "seed": seed,
        "runs": len(verdicts),
        "violations": sum(bool(v.violations) for v in verdicts),
        "table": table(verdicts),
        "verdicts": [v.document() for v in verdicts],
    }


def text(verdicts: Sequence[Verdict]) -> str:
    """Return the table as text, and what violated it."""
    rows = table(verdicts)
    columns = list(rows["all"])
    head = ["fault", *(name.replace("_", " ") for name in columns)]
    cells = [head, *([kind, *(str(row[name]) for name in columns)] for kind, row in rows.items())]
    widths = [max(len(line[i]) for line in cells) for i in range(len(head))]
    lines = ["  ".join([line[0].ljust(widths[0]), *map(str.rjust, line[1:], widths[1:])]) for line in cells]
    lines.insert(1, "-" * len(lines[0]))
    lines.insert(len(lines) - 1, "-" * len(lines[0]))
    for verdict in verdicts:
        lines += [f"run {verdict.number} ({', '.join(verdict.faults) or 'no fault'}): {v}" for v in verdict.violations]
    return "\n".join(lines)


def _row(verdicts: Sequence[Verdict]) -> dict[str, int]:
    def having(*starts: str) -> int:
        return sum(any(start in what for what in v.violations for start in starts) for v in verdicts)

    return {
        "runs": len(verdicts),
        "struck": sum(v.struck for v in verdicts),
        **{outcome: sum(v.outcome == outcome for v in verdicts) for outcome in OUTCOMES},
        "rows_recorded": sum(v.readings.rows for v in verdicts),
        "readings_checked": sum(v.readings.checked for v in verdicts),
        "wrong": having(_WRONG),
        "unsafe": having(*_UNSAFE),
        "no_sentence": having(_SPEECHLESS),
        "any_violation": sum(bool(v.violations) for v in verdicts),
    }
