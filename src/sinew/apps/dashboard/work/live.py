"""Results of a run while it goes on: its finished groups, each analysed once."""

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sinew.apps.dashboard.operators import unlinked
from sinew.measure.errors import SinewError
from sinew.measure.estimate import finite

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    from sinew.bench.record.journal_reader import Stretch
    from sinew.plan.rig import RigSpec

MOST_AT_ONCE = 120
"""Groups that one update analyses unless told otherwise; the rest wait for the next."""

_STEADY = (
    "gain",
    "gain_std",
    "gain_measured_drive",
    "gain_measured_drive_std",
    "phase_lag_rad",
    "phase_std_rad",
    "phase_delay_std_rad",
    "settled",
    "saturated_share",
)
_DECAY = {
    "damping_ratio": "damping_ratio_std",
    "decay_frequency_hz": "decay_frequency_std_hz",
    "decay_rate_per_s": "decay_rate_std_per_s",
}

Place = tuple[float, float]
Key = tuple[int, int, int]


def measured_so_far(journal_path: str) -> dict[str, Any]:
    """Return what `LiveResults.update` says of a journal; its state stays in this process."""
    path = Path(journal_path)
    unlinked(path.parent)
    return _live(path, path.stat().st_ino if path.exists() else 0).update()


@lru_cache(maxsize=4)
def _live(path: Path, inode: int) -> "LiveResults":
    """Return what is known of a journal. inode: of the file, for a run may be deleted and another take its name."""
    return LiveResults(path)


@dataclass
class LiveResults:
    """What is known of a journal so far. A group that is measured again replaces what it said before."""

    path: Path
    steady: dict[Key, tuple[Place, int, dict[str, float]]] = field(default_factory=dict)
    decays: dict[Key, tuple[float, int, dict[str, float]]] = field(default_factory=dict)
    notes: dict[Key, str] = field(default_factory=dict)
    most_at_once: int = MOST_AT_ONCE

    def update(self) -> dict[str, Any]:
        """Analyse the groups that were finished since, and return all that is known.

        `curves`: of each pretension in increasing order `pretension_mm`, `frequency_hz`, and over it `gain` (mean of
        peaks over the commanded amplitude), `gain_measured_drive`, `phase` (lag behind the lever [deg]), each
        `{"value", "std", "interval90"}` of the mean over repeats, `repeats`, `settled`, `saturated_share`.
        `damping`: of each pretension with ring-downs `pretension_mm`, `damping_ratio`, `decay_frequency_hz`,
        `decay_rate_per_s`, `repeats`. `groups_done`: finished, `pending`: of them not yet analysed. `notes`: sentences
        on groups that could not be. Raises FileError where there is no journal.
        """
        from sinew.bench.record.journal_reader import JournalReader
        from sinew.plan.toml import parse_rig

        with JournalReader(self.path) as journal:
            rig, finished = parse_rig(journal.rig_toml), journal.finished()
        keys = {(i, parts[-1].session, parts[-1].attempt): parts for i, parts in finished.items()}
        for known in (self.steady, self.decays, self.notes):
            for gone in known.keys() - keys.keys():
                del known[gone]
        fresh = [key for key in keys if key not in self.steady and key not in self.decays and key not in self.notes]
        for batch in _batches({key: keys[key] for key in fresh[: self.most_at_once]}):
            self._take(batch, rig)
        return {
            "curves": _curves(list(self.steady.values())),
            "damping": _damping(list(self.decays.values())),
            "groups_done": len(keys),
            "pending": max(0, len(fresh) - self.most_at_once),
            "notes": [note for note in self.notes.values() if note],
        }

    def _take(self, batch: "dict[Key, list[Stretch]]", rig: "RigSpec") -> None:
        """Analyse some groups of one kind and one repeat."""
        from sinew.bench.record.conversion import recording_from_journal

        kind = next(iter(batch.values()))[-1].kind
        if kind not in ("steady", "ring-down"):
            self.notes |= dict.fromkeys(batch, "")
            return
        try:
            recording = recording_from_journal(self.path, {key[0] for key in batch})
            found = _steady(recording, rig) if kind == "steady" else _decays(recording, rig)
        except SinewError as trouble:
            if len(batch) == 1:
                self.notes[next(iter(batch))] = str(trouble)
                return
            for key, parts in batch.items():  # one that cannot be analysed must not hide the others
                self._take({key: parts}, rig)
            return
        for key, parts in batch.items():
            asked = parts[-1].asked
            place = (asked.pretension_mm, asked.frequency_hz)
            numbers = found.get(place if kind == "steady" else (asked.pretension_mm, float(asked.repeat)))
            if numbers is None:
                self.notes[key] = f"group {key[0] + 1} could not be analysed: it has holes, or lacks whole periods"
            elif kind == "steady":
                self.steady[key] = place, asked.repeat, numbers
            else:
                self.decays[key] = asked.pretension_mm, asked.repeat, numbers


def _batches(fresh: "dict[Key, list[Stretch]]") -> "list[dict[Key, list[Stretch]]]":
    """Return groups of one kind and repeat together: a pretension and frequency is there once at most."""
    found: dict[tuple[str, int], dict[Key, list[Stretch]]] = {}
    for key, parts in fresh.items():
        found.setdefault((parts[-1].kind, parts[-1].asked.repeat), {})[key] = parts
    return list(found.values())


def _steady(recording: "xr.Dataset", rig: "RigSpec") -> dict[Place, dict[str, float]]:
    """Return the numbers of each pretension [mm] and frequency [Hz] that could be analysed."""
    import numpy as np

    from sinew.analysis.sweep.response import estimate_response

    response = estimate_response(recording, rig)
    columns = response.columns | {"gain_std": response.nominal_gain_std * response.columns["gain"]}
    found = {}
    for p, f in np.ndindex(response.pretension_mm.size, response.frequency_hz.size):
        if np.isfinite(columns["gain"][p, f, 0]):
            place = float(response.pretension_mm[p]), float(response.frequency_hz[f])
            found[place] = {name: float(columns[name][p, f, 0]) for name in _STEADY}
    return found


def _decays(recording: "xr.Dataset", rig: "RigSpec") -> dict[Place, dict[str, float]]:
    """Return the numbers of each pretension [mm] and repeat that could be analysed."""
    import numpy as np

    from sinew.analysis.decay.ring_down import analyse_ring_downs

    results = analyse_ring_downs(recording, rig.inertia.head.value + rig.inertia.lever.value)
    found = {}
    for p, r in np.ndindex(*results["damping_ratio"].shape):
        if np.isfinite(results["damping_ratio"].values[p, r]):
            place = float(results["pretension_mm"].values[p]), float(r)
            found[place] = {name: float(results[name].values[p, r]) for name in (*_DECAY, *_DECAY.values())}
    return found


def _table(rows: list[tuple[int, dict[str, float]]], names: tuple[str, ...]) -> "dict[str, NDArray[Any]]":
    """Return each number over the repeats, (1, r), NaN where a repeat is not there yet."""
    import numpy as np

    width = max(repeat for repeat, _ in rows) + 1
    table = {name: np.full((1, width), np.nan) for name in names}
    for repeat, numbers in rows:
        for name in names:
            table[name][0, repeat] = numbers[name]
    return table


def _curves(steady: list[tuple[Place, int, dict[str, float]]]) -> list[dict[str, Any]]:
    import numpy as np

    places: dict[Place, list[tuple[int, dict[str, float]]]] = {}
    for place, repeat, numbers in steady:
        places.setdefault(place, []).append((repeat, numbers))
    curves: dict[float, dict[str, Any]] = {}
    names = ("frequency_hz", "gain", "gain_measured_drive", "phase", "repeats", "settled", "saturated_share")
    for pretension, frequency in sorted(places):
        rows = places[pretension, frequency]
        curve = curves.setdefault(pretension, {"pretension_mm": pretension, **{name: [] for name in names}})
        table = _table(rows, _STEADY)
        delay = shared_delay(table["phase_delay_std_rad"])
        curve["frequency_hz"].append(frequency)
        curve["gain"].append(mean_of(table["gain"], table["gain_std"]))
        curve["gain_measured_drive"].append(mean_of(table["gain_measured_drive"], table["gain_measured_drive_std"]))
        curve["phase"].append(mean_of(table["phase_lag_rad"], table["phase_std_rad"], delay, 180 / np.pi))
        curve["repeats"].append(len(rows))
        curve["settled"].append(all(numbers["settled"] == 1.0 for _, numbers in rows))
        share = max(numbers["saturated_share"] for _, numbers in rows)
        curve["saturated_share"].append(finite(share))
    return list(curves.values())


def _damping(decays: list[tuple[float, int, dict[str, float]]]) -> list[dict[str, Any]]:
    places: dict[float, list[tuple[int, dict[str, float]]]] = {}
    for pretension, repeat, numbers in decays:
        places.setdefault(pretension, []).append((repeat, numbers))
    rows = []
    for pretension in sorted(places):
        table = _table(places[pretension], (*_DECAY, *_DECAY.values()))
        row = {name: mean_of(table[name], table[std]) for name, std in _DECAY.items()}
        rows.append({"pretension_mm": pretension, **row, "repeats": len(places[pretension])})
    return rows


def shared_delay(delays: "NDArray[Any]") -> float:
    """Return what repeats share of the uncertainty of their lag: the mean of what is known, (1, r) [rad]."""
    import numpy as np

    known = delays[np.isfinite(delays)]
    return float(known.mean()) if known.size else 0.0


def mean_of(values: "NDArray[Any]", stds: "NDArray[Any]", shared: float = 0.0, scale: float = 1.0) -> dict[str, Any]:
    """Return the mean over repeats (1, r) with its interval. shared: standard uncertainty that all repeats share."""
    from sinew.analysis.signal.repeats import combine_repeats
    from sinew.measure.estimate import Estimate

    mean = combine_repeats(values, stds, systematic=shared)
    numbers = (mean.value[0], mean.std_of_value[0], mean.low[0], mean.high[0])
    return Estimate(*(float(number) * scale for number in numbers)).to_json()
