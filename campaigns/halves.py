"""Halves of real decays: `python -m campaigns.halves FOLDER`.

Each record of the folder is analysed whole, then cut in the middle between the first and the last of its peaks that
stand out of the noise: the early part has the large swings, the late one the small. Both are analysed as if they were
records of their own. Printed: frequency and damping ratio of both with their 90 % intervals, and whether these meet. An
interval that knows of its model's misfit meets that of the other half though the oscillation is not linear.

A record is a table of numbers, of any separator, with or without a decimal comma and a header. Its first column is the
time, in seconds (microseconds where the steps exceed a thousand; a single column is sampled at 1 kHz), its stamps
straightened as those of an import; the response is the column that swings most. Rows with an empty field are left out,
of equal times the first is kept.
"""

import argparse
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sinew.analysis.decay.ring_down import RingDown, analyse_ring_down
from sinew.measure.arrays import Array
from sinew.measure.errors import SinewError, TimeError
from sinew.measure.estimate import Estimate
from sinew.measure.timing import straighten_times

QUANTITIES = ("frequency_hz", "damping_ratio")
_ENDINGS = (".csv", ".txt")


@dataclass(frozen=True)
class Halves:
    """What the two halves of a decay say of one quantity."""

    quantity: str
    early: Estimate
    late: Estimate

    @property
    def meet(self) -> bool:
        """Return whether the two 90 % intervals overlap."""
        return self.early.low <= self.late.high and self.late.low <= self.early.high


def halves_of(time_s: Array, values: Array, whole: RingDown, **of_response: object) -> list[Halves]:
    """Return frequency and damping ratio of both halves of a decay, both of shape (n,) as they were analysed whole.

    of_response: unit and is_rate, as for `analyse_ring_down`. Raises SinewError where a half cannot be analysed.
    """
    middle = 0.5 * (whole.peak_time_s[0] + whole.peak_time_s[-1])
    early = (time_s >= whole.start_s) & (time_s <= middle)
    late = (time_s >= middle) & (time_s <= whole.stop_s)
    first, second = (
        analyse_ring_down(time_s[part], values[part], **of_response)  # type: ignore[arg-type]
        for part in (early, late)
    )
    return [Halves(name, getattr(first, name), getattr(second, name)) for name in QUANTITIES]


def read_table(file: Path) -> tuple[Array, Array]:
    """Return time [s] and response of a table, shape (n,) each."""
    rows = []
    text = file.read_text(encoding="utf-8", errors="replace")
    comma = ";" in text and re.search(r"\d,\d", text) is not None
    for line in text.splitlines():
        fields = [one.strip().strip('"') for one in re.split(r"[;\t]" if comma else r"[,;\t]| +", line.strip())]
        fields = [one.replace(",", ".") if comma else one for one in fields if one]
        try:
            rows.append([_number(one) for one in fields])
        except ValueError:
            continue
    width = max({len(row) for row in rows}, key=[len(row) for row in rows].count)
    table = np.array([row for row in rows if len(row) == width])
    table = table[np.isfinite(table).all(axis=1)]
    if width == 1:
        return np.arange(table.shape[0]) / 1000.0, table[:, 0]
    time = table[:, 0]
    scale = 1e-6 if float(np.median(np.diff(time))) > 1000.0 else 1.0
    columns = table[:, 1:]
    with suppress(TimeError):  # rounded stamps: of equal ones the first is kept
        time = straighten_times(time, gaps="split").time_s
    kept = np.r_[True, np.diff(time) > 0]
    swing = columns - np.median(columns, axis=0)
    at = int(np.argmax(np.sum(np.abs(np.diff(swing, axis=0)), axis=0))) if columns.shape[1] > 1 else 0
    return scale * time[kept], columns[kept, at]


def _number(text: str) -> float:
    if re.fullmatch(r"\d+:\d+:\d+(\.\d+)?", text):
        hours, minutes, seconds = text.split(":")
        return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds)
    return float(text)


def tell(file: Path) -> tuple[list[Halves], str]:
    """Return the halves of a file's decay, and what to print of it."""
    try:
        time, values = read_table(file)
        whole = analyse_ring_down(time, values, unit="1")
    except (SinewError, ValueError) as error:
        return [], f"{file.name}: {error}"
    lines = [
        f"{file.name}: {whole.frequency_hz} Hz, D {whole.damping_ratio}, {whole.start_s:.4g} to {whole.stop_s:.4g} s; "
        f"exponential: {'yes' if whole.shape.exponential else 'no'}",
        *(f"  {remark}" for remark in (whole.misfit, whole.withheld, *whole.remarks) if remark),
        *(f"  mode: {mode.frequency_hz} Hz, D {mode.damping_ratio}" for mode in whole.modes),
    ]
    try:
        halves = halves_of(time, values, whole, unit="1")
    except SinewError as error:
        return [], "\n".join([*lines, f"  no pair: {error}"])
    lines += [f"  {one.quantity}: {one.early} | {one.late} {'meet' if one.meet else 'APART'}" for one in halves]
    return halves, "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the halves of every record in a folder, and how many meet."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="with tables of decays")
    asked = parser.parse_args(arguments)
    pairs: list[Halves] = []
    for file in sorted(one for one in asked.folder.rglob("*") if one.suffix in _ENDINGS):
        found, text = tell(file)
        pairs += found
        print(text, flush=True)
    print(f"{sum(one.meet for one in pairs)} of {len(pairs)} pairs of intervals meet")


if __name__ == "__main__":
    main()
