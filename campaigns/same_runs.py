"""The campaign of same runs: do runs of one plan on one rig, begun at other moments, find the same numbers?

Each run is a new program on a new emulated bench of one rig and seed, in virtual time. It begins at a moment of its
own within some cycles, and every wait of the program ends late by 60 µs in the mean, as on a computer that does other
things. Every number with a stated interval is held against the first run's: its difference lies within where it is no
larger than the two 90 % intervals together, the root of their summed squares. So are the numbers of the twin's own
recording of the plan, without scatter between repeats, which an emulated bench has not either. Current, duty's phase
and power of the drive have no interval in the results; how far they spread is printed.

An interval that holds more than what differs between runs (the grid of frequencies, delays, the voltage's unit) holds
more than 90 % of them: such numbers are marked with what their scatter is of their standard deviation.

    python -m campaigns.same_runs --runs 30 --seed 0 --workers 2
"""

import json
import math
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import xarray as xr

from campaigns.options import campaign_parser, spread_of, spread_trials
from campaigns.second_runs import Bench
from sinew.analysis.analysed import analyse_recording
from sinew.bench.record.conversion import recording_from_journal
from sinew.bench.record.journal import Journal
from sinew.bench.run import Runner
from sinew.emulator.found import VirtualPort
from sinew.hardware.bus import Bus, BusTiming
from sinew.hardware.rig import Rig
from sinew.measure.arrays import Array
from sinew.measure.estimate import NORMAL_90
from sinew.measure.tasks import HERE, Spread
from sinew.plan.plan import Plan
from sinew.plan.toml import dump_plan, dump_rig, load_plan, load_rig
from sinew.twin.parameters import Effects
from sinew.twin.simulate import rest_tension, simulate

BEHIND = {"ring_down": {"frequency_hz": [4.0, 4.0], "amplitude_deg": 20, "drive_s": 3, "record_s": 3, "repeats": 1}}
"""What follows the sweep of `quick`. A period of 4 Hz is a whole number of cycles: what begins on one is on an edge."""

_LATE_S = 60e-6
_MOMENTS_S = 0.02
Numbers = dict[str, list[list[float]]]
"""Value and half of the 90 % interval of every entry, by name; of what has no interval, NaN."""


class _RestlessPort(VirtualPort):
    """A port whose master wakes up late."""

    def __init__(self, bench: Bench, rng: np.random.Generator) -> None:
        super().__init__(bench.emulated)
        self._rng = rng

    def wait_until(self, time: float) -> None:
        super().wait_until(time + float(self._rng.exponential(_LATE_S)))


def the_plan() -> Plan:
    """Return the plan of all runs: `quick`, and a ring-down."""
    return Plan.model_validate(load_plan("quick").model_dump(exclude_none=True) | BEHIND)


def run(seed: int, number: int) -> xr.Dataset:
    """Return the recording of one run."""
    spec, plan, rng = load_rig("paper"), the_plan(), np.random.default_rng([seed, number])
    bench = Bench(spec, seed)
    bench.leave_alone(0.5 + float(rng.uniform(0.0, _MOMENTS_S)))
    port = _RestlessPort(bench, rng)
    timing = BusTiming(spec.wiring.baud, latency=1e-3 * spec.wiring.latency_ms)
    asked = plan.pretension.pretension_mm
    tension = dict(zip(asked, rest_tension(asked, spec).tolist(), strict=True))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "journal.sqlite"
        with Journal.create(path, dump_plan(plan), dump_rig(spec)) as journal:
            report = Runner(Rig(Bus(port, port, timing, retries=2), port, spec), port, plan, journal, tension).run()
        assert report.is_complete, report.sentence
        return recording_from_journal(path)


def numbers_of(recording: xr.Dataset) -> Numbers:
    """Return the numbers that a recording's analysis states, and those of the drive."""
    found = analyse_recording(recording, load_rig("paper"))
    out: Numbers = {}
    for name in map(str, found.data_vars):
        if "_std" in name or "_misfit" in name or name.endswith(("_low", "_high")) or found[name].dtype.kind != "f":
            continue
        half = _half_width(found, name)
        if half is not None and np.isfinite(found[name].values).all():
            out[name] = [found[name].values.ravel().tolist(), half.ravel().tolist()]
    for name in ("drive_current_rms_a", "drive_copper_w"):
        out[name] = [found[name].values.ravel().tolist(), [math.nan] * found[name].size]
    out["phase of the duty [°]"] = [duty_phases(recording), [math.nan] * found["gain"].size]
    return out


_OTHER_STD = {"phase_lag_rad": "phase_std_rad", "gain_measured_drive": "gain_measured_drive_std"}


def _half_width(found: xr.Dataset, name: str) -> Array | None:
    """Return half of the 90 % interval that results state of a number, or None."""
    stem, _, unit = name.rpartition("_")
    for low, high in ((f"{name}_low", f"{name}_high"), (f"{stem}_low_{unit}", f"{stem}_high_{unit}")):
        if low in found:
            return np.asarray(0.5 * (found[high].values - found[low].values))
    parts = name.split("_")
    places = ["_".join([*parts[:i], "std", *parts[i:]]) for i in range(len(parts), 0, -1)]
    std = next((one for one in (_OTHER_STD.get(name, ""), *places) if one in found), None)
    return None if std is None else np.asarray(NORMAL_90 * found[std].values)


def duty_phases(recording: xr.Dataset) -> list[float]:
    """Return the lag of the duty's fundamental behind the command in each steady segment [°]."""
    ends = np.cumsum(recording["row_size"].values)
    lags = []
    for index in np.flatnonzero(recording["kind"].values == "steady"):
        where = slice(int(ends[index] - recording["row_size"].values[index]), int(ends[index]))
        turn = 2 * np.pi * float(recording["frequency_hz"].values[index]) * recording["time_s"].values[where]
        waves = np.stack([np.cos(turn), np.sin(turn), np.ones_like(turn)], axis=1)
        read = np.stack([recording[name].values[where] for name in ("drive_pwm", "drive_command_rad")], axis=1)
        duty, command = (a - 1j * b for a, b, _ in np.linalg.lstsq(waves, read, rcond=None)[0].T)
        lags.append(float(np.degrees(np.angle(command / duty))))
    return lags


def _try(seed: int, number: int) -> Numbers:
    if number < 0:
        quiet = Effects().without("repeatability")
        return numbers_of(simulate(the_plan(), "paper", seed=-number, effects=quiet))
    return numbers_of(run(seed, number))


def results(seed: int, numbers: Sequence[int], spread: Spread = HERE) -> Iterator[Numbers]:
    """Yield the numbers of each run, in order; of a negative number those of the twin."""
    yield from spread_trials(partial(_try, seed), numbers, spread=spread)


def within(first: Numbers, other: Numbers, name: str) -> list[bool]:
    """Return of each entry of a number whether it agrees with the first run's."""
    (x, h), (y, k) = np.array(first[name]), np.array(other[name])
    return [bool(one) for one in np.abs(y - x) <= np.hypot(h, k)]


def text(runs: Sequence[Numbers], twins: Sequence[Numbers]) -> str:
    """Return the table: how many runs and twins agree with the first run, number by number."""
    first, others = runs[0], runs[1:]
    rows: list[tuple[str, ...]] = [("", "within, runs", "within, twin", "scatter/std")]
    counts = np.zeros(4, dtype=int)
    spreads = []
    for name in first:
        x = np.array([one[name][0] for one in runs])
        half = np.array([one[name][1] for one in runs])
        if np.isnan(half).all():
            told = (x.mean(axis=0), x.std(axis=0, ddof=1), np.mean([one[name][0] for one in twins], axis=0))
            spreads.append("{}: mean {}, standard deviation over runs {}, twin {}".format(name, *map(_list, told)))
            continue
        ours = [hit for one in others for hit in within(first, one, name)]
        theirs = [hit for one in twins for hit in within(first, one, name)]
        counts += [sum(ours), len(ours), sum(theirs), len(theirs)]
        wide = x.std(axis=0, ddof=1) / (np.median(half, axis=0) / NORMAL_90)
        shares = (f"{100 * np.mean(ours):.0f} %", f"{100 * np.mean(theirs):.0f} %")
        rows.append((name, *shares, f"{np.median(wide):.2f} ({wide.min():.2f} to {wide.max():.2f})"))
    of_all = [f"{100 * counts[i] / counts[i + 1]:.1f} % of {counts[i + 1]}" for i in (0, 2)]
    rows.append(("all", *of_all, ""))
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([*lines, *spreads])


def _list(values: Array) -> str:
    return " ".join(f"{value:.4g}" for value in values)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the campaign, print its table, and return the exit status."""
    parser = campaign_parser("same_runs", __doc__, count=30, of="runs", workers=1)
    given = parser.parse_args(arguments)
    twins = max(1, given.runs // 3)
    done = list(results(given.seed, [*range(given.runs), *(-1 - i for i in range(twins))], spread_of(given)))
    table = text(done[: given.runs], done[given.runs :])
    if given.out is not None:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        given.out.write_text(json.dumps({"table": table, "numbers": done}, indent=1) + "\n", encoding="utf-8")
    print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
