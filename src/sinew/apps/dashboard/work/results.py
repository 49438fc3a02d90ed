"""Results of a run: of one that has ended made once and read from then on, of one under way group by group."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sinew.analysis.runs import QUANTITIES
from sinew.apps.bench.bench_run import JOURNAL
from sinew.apps.dashboard.folders import CACHE, RECORDING, RESULTS, held_inside, name_in, unlinked
from sinew.bench.record.journal import is_being_written
from sinew.measure.errors import FileError, SinewError, SpecError
from sinew.measure.estimate import finite, number, shown_interval, span, typeset

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    from sinew.bench.record.journal import Stretch
    from sinew.plan.rig import RigSpec

_QUANTITIES = {name: (about.words, about.unit) for name, about in QUANTITIES.items()}
_QUANTITIES |= {"drive_amplitude_at_resonance_rad": ("lever amplitude at resonance", "°")}
"""Title and unit of what is found at each pretension."""


def run_results(folder: Path | str) -> dict[str, Any]:
    """Return what a run has found; the first time it is analysed, which writes results.nc and analysis.json beside it.

    `curves` and `damping` as of `LiveResults.update`; `parameters`: rows of `pretension_mm`, `quantity` (as in the
    results), `name` (in words), `estimate` (`{"value", "std", "interval90"}`) and `unit`; `document`: what `sinew
    analyse --json` says; `coupling`: of a bent head, as HTML; `notes`: sentences; `source`: of the samples, None where
    it is not known. A run that is under way gives what its finished groups say.
    Raises SinewError where there is no recording, or it cannot be analysed.
    """
    folder = unlinked(Path(folder))
    journal = folder / JOURNAL
    if is_being_written(journal):
        found = LiveResults(journal, most_at_once=10**6).update()
        return {
            **found,
            "parameters": list(_of_decays(found["damping"])),
            "document": None,
            "doubts": [],
            "source": None,
        }
    return _document(results_of(folder))


def recording_of(folder: Path) -> Path:
    """Return the recording of a run, made from its journal where there is none yet.

    Raises FileError where there is neither, or the run is under way; RecordingError where no group is whole.
    """
    from sinew.bench.record.conversion import convert

    recording, journal = unlinked(folder) / RECORDING, folder / JOURNAL
    if recording.is_file():
        return recording
    if not journal.is_file():
        raise FileError(f"{folder.name} holds no run; expected a {JOURNAL} or a {RECORDING} in it")
    if is_being_written(journal):
        raise FileError(f"{folder.name} is still being recorded; its files can be had when it has ended")
    return convert(journal, recording)


def load_own(folder: Path) -> "xr.Dataset":
    """Return the recording of a run, read through no link. Raises as `recording_of` and `load_recording`."""
    from sinew.measure.files.netcdf import load_recording

    with held_inside(folder.parent, recording_of(folder)) as path:
        return load_recording(path)


def results_of(folder: Path) -> "xr.Dataset":
    """Return the results that lie in a run's folder; they are made where there are none of the recording there.

    What the recording is, it says in its attributes; no sample is read where nothing is to be made.
    """
    from sinew.analysis.analysed import recording_rig
    from sinew.apps.recordings.stored import analyse_into, stored_results
    from sinew.measure.files.netcdf import load_results

    if (folder / RESULTS).is_file() and not (folder / RECORDING).exists() and not (folder / JOURNAL).exists():
        with held_inside(folder.parent, folder / RESULTS) as results:
            return load_results(results)
    recording_of(folder)
    about = _attributes(folder)
    about = about if "content_hash" in about.attrs else load_own(folder)
    rig, stored = recording_rig(about, None), None
    if (folder / RESULTS).is_file():
        with held_inside(folder.parent, folder / RESULTS) as results:
            stored = stored_results(results, about, rig)
    return analyse_into(folder, load_own(folder), rig) if stored is None else stored


def _attributes(folder: Path) -> "xr.Dataset":
    """Return a dataset with the attributes of a run's recording and nothing else."""
    from sinew.measure.files.netcdf import load_part

    with held_inside(folder.parent, folder / RECORDING) as recording:
        return load_part(recording, ())


def read_found(folder: Path) -> dict[str, Any]:
    """Return what the results in a run's folder say, as the index of runs keeps it: see `work.runs.read_run`.

    `found` and `untold` where they are of this recording, `analysed`, `remark`; `source`, `rig`, `plan` and, where the
    recording says it, `started`.
    Raises FileError where recording or results are damaged.
    """
    from sinew.analysis.analysed import figures_document

    about = _attributes(folder).attrs if (folder / RECORDING).exists() else {}
    state: dict[str, Any] = {"analysed": False, "remark": "not analysed yet"}
    if (folder / RESULTS).exists():
        with held_inside(folder.parent, folder / RESULTS) as path:
            document, results = figures_document(path)
        if about and results.attrs.get("recording_hash") != about.get("content_hash"):
            state["remark"] = "its results are of another recording; they are made anew when it is opened"
        else:
            about = about or results.attrs
            state |= {"found": _found(document, results), "analysed": True, "remark": "", "untold": _untold(results)}
    said = {
        "source": str(about.get("source", "")),
        **{one: name_in(str(about.get(one, ""))) for one in ("rig", "plan")},
    }
    said["started"] = str(about.get("started", ""))
    return state | {key: value for key, value in said.items() if value}


def _found(document: dict[str, Any], results: "xr.Dataset") -> list[dict[str, Any]]:
    """Return what results say at each pretension, in increasing order, of what the index keeps."""
    measured = results["pretension_mm"].values.ravel().tolist() if "pretension_mm" in results else []
    # Also one at which nothing could be determined: a search finds what was measured there.
    rows: dict[float, dict[str, Any]] = {mm: {"pretension_mm": mm} for mm in measured if math.isfinite(mm)}
    for row in _parameters(document, results):
        if row["quantity"] in QUANTITIES and row["estimate"]["value"] is not None:
            at = rows.setdefault(row["pretension_mm"], {"pretension_mm": row["pretension_mm"]})
            at[row["quantity"]] = row["estimate"]
    return [rows[pretension] for pretension in sorted(rows)]


def _untold(results: "xr.Dataset") -> str:
    """Return why results hold no resonance, of the first pretension and repeat; empty where they do not say."""
    if "gain" not in results:
        return "no sweep"
    first = str(results.attrs.get("resonance_notes", "")).partition("\n")[0]
    return re.sub(r"^\S+ mm, repeat \d+: ", "", first)


def _document(results: "xr.Dataset") -> dict[str, Any]:
    from sinew.analysis.analysed import recording_result

    found = recording_result(results)
    document = found.to_dict()
    curves = list(_curves(results)) if "gain" in results else []
    notes = [str(results.attrs.get(name, "")) for name in ("resonance_notes", "ring_down_notes")]
    return {
        "curves": curves,
        "damping": _of_torsion(document),
        "parameters": _parameters(document, results),
        "document": document,
        "coupling": "".join(one._repr_html_() for one in (found.pose, found.coupling) if one),
        "doubts": [one["sentence"] for one in document["doubts"]],
        "notes": [note for note in notes if note],
        "source": results.attrs.get("source"),
    }


def _curves(results: "xr.Dataset") -> Iterator[dict[str, Any]]:
    """Yield the response at each pretension, as a run under way has it."""

    columns = {str(name): row.values for name, row in results.data_vars.items() if row.dims == results["gain"].dims}
    relative = columns["amplitude_std_rad"] / np.where(columns["amplitude_rad"] > 0, columns["amplitude_rad"], np.nan)
    columns["gain_std"] = columns["gain"] * relative
    for p, pretension in enumerate(results["pretension_mm"].values):
        curve = _begun_curve(float(pretension))
        for f, frequency in enumerate(results["frequency_hz"].values):
            if np.isfinite(columns["gain"][p, f]).any():
                _add_point(curve, float(frequency), {name: values[p, f][None] for name, values in columns.items()})
        if curve["frequency_hz"]:
            yield curve


def _begun_curve(pretension_mm: float) -> dict[str, Any]:
    names = ("frequency_hz", "gain", "gain_measured_drive", "phase", "repeats", "settled", "saturated_share")
    return {"pretension_mm": pretension_mm, **{name: [] for name in names}}


def _add_point(curve: dict[str, Any], frequency_hz: float, table: "dict[str, NDArray[Any]]") -> None:
    """Add the means at a frequency to a curve. table: numbers over the repeats, (1, r), NaN where there is none."""

    there = np.isfinite(table["gain"][0])
    delays = table["phase_delay_std_rad"]
    known = delays[np.isfinite(delays)]
    shared = float(known.mean()) if known.size else 0.0  # what repeats share of the uncertainty of their lag
    curve["frequency_hz"].append(frequency_hz)
    curve["gain"].append(_mean_of(table["gain"], table["gain_std"]))
    curve["gain_measured_drive"].append(_mean_of(table["gain_measured_drive"], table["gain_measured_drive_std"]))
    curve["phase"].append(_mean_of(table["phase_lag_rad"], table["phase_std_rad"], shared, 180 / np.pi))
    curve["repeats"].append(int(there.sum()))
    curve["settled"].append(bool((table["settled"][0, there] == 1.0).all()))
    curve["saturated_share"].append(finite(float(table["saturated_share"][0, there].max())))


def _row(pretension_mm: float, quantity: str, estimate: dict[str, Any]) -> dict[str, Any]:
    name, unit = _QUANTITIES[quantity]
    if unit == "°":
        turned = [None if x is None else math.degrees(x) for x in (estimate["std"], *estimate["interval90"])]
        value = None if estimate["value"] is None else math.degrees(estimate["value"])
        estimate = {"value": value, "std": turned[0], "interval90": turned[1:]}
    return {"pretension_mm": pretension_mm, "quantity": quantity, "name": name, "estimate": estimate, "unit": unit}


def _parameters(document: dict[str, Any], results: "xr.Dataset") -> list[dict[str, Any]]:
    return [*_of_resonances(document), *_of_decays(_of_torsion(document)), *_of_constants(results)]


def _of_torsion(document: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the rows of the ring-downs that could be analysed."""
    return [row for row in document.get("ring_down", []) if "damping_ratio" in row]


def _of_resonances(document: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for rows in (document.get("resonance", []), document.get("energy", {}).get("pretensions", [])):
        for row in rows:
            for quantity in _QUANTITIES:
                if quantity in row and row[quantity]["value"] is not None:
                    yield _row(row["pretension_mm"], quantity, row[quantity])


def _of_decays(decays: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    for row in decays:
        for quantity in ("damping_ratio", "decay_frequency_hz", "decay_rate_per_s"):
            if quantity in row:
                yield _row(row["pretension_mm"], quantity, row[quantity])


def _of_constants(results: "xr.Dataset") -> Iterator[dict[str, Any]]:
    """Yield the paper's stiffness and damping constant, whose repeats alone tell how certain they are."""

    for quantity in ("paper_stiffness_n_m_rad", "paper_damping_n_m_s_rad"):
        if quantity not in results:
            continue
        for p, pretension in enumerate(results["pretension_mm"].values):
            values = results[quantity].values[p][None]
            if np.isfinite(values).any():
                yield _row(float(pretension), quantity, _mean_of(values, np.full(values.shape, np.nan)))


def prediction_of_run(folder: Path | str) -> dict[str, Any]:
    """Return what was to be expected of a run that has a journal: `plan` and `rig`, its texts, and `curves` as of
    `prediction_for_plan`. Raises FileError where there is no journal."""
    from sinew.apps.dashboard.work.design import prediction_for_plan
    from sinew.bench.record.journal import JournalReader

    with JournalReader(unlinked(Path(folder)) / JOURNAL) as journal:
        plan, rig = journal.plan_toml, journal.rig_toml
    return {"plan": plan, "rig": rig, "curves": prediction_for_plan(plan, rig)["curves"]}


# Measured points are held against a prediction: which of them miss it.
#
# The uncertainty that counts is that of the difference, at 90 %: the measured interval's end towards the prediction and
# the band's edge towards the point, each as a distance from its own middle, added in quadrature. Both leave one honest
# point in ten outside.

LEAST_SHARE, LEAST_LAG_DEG = 0.10, 10.0
"""Without a band: how far a gain, as a share of the predicted one, and a lag may be off whatever its own interval."""

_BEYOND = 0.01  # of a frequency: how far outside a predicted curve its end still counts
_PLAINLY = 10.0  # times its uncertainty: from here on a tenth of it tells nothing
_FAR = 100.0  # times: so far off that the interval, of few repeats, is to be doubted before the number
_UNITS = {"gain": "", "phase": "°"}


@dataclass(frozen=True)
class Verdict:
    """What the prediction says of one point.

    predicted: the nearest stable motion at its frequency. low, high: the band there; None without one. off: measured
    less predicted, in degrees or as the gain itself. half: of the 90 % interval of that difference. misses: whether
    it is too far off. sentence: by how much, "+12 %, 2.1 of its uncertainty".
    """

    predicted: float
    low: float | None
    high: float | None
    off: float
    half: float
    misses: bool
    sentence: str


def judge(what: str, curve: dict[str, Any], frequency_hz: float, estimate: dict[str, Any]) -> Verdict | None:
    """Return what a predicted curve says of a measured point; None where one of them leaves it open.

    what: gain or phase. curve: as `sinew.apps.dashboard.hub.Results` has it. estimate: as JSON holds it. With a band a
    point misses if it is farther off than the uncertainty of the difference; without one it must be off by more than
    its own interval and by more than `LEAST_SHARE` of the gain or `LEAST_LAG_DEG`.
    """
    value, (low, high) = estimate["value"], estimate["interval90"]
    if value is None or low is None or high is None:
        return None
    at = np.clip(frequency_hz, np.min(curve["frequency_hz"]), np.max(curve["frequency_hz"]))
    motions = _motions(curve, what, at) if abs(at - frequency_hz) <= _BEYOND * frequency_hz else []
    if not motions:
        return None
    offs = [_difference(what, value, motion) for motion in motions]
    off, predicted = min(zip(offs, motions, strict=True), key=lambda pair: abs(pair[0]))
    own = value - low if off > 0 else high - value
    band = _band(curve, what, at)
    if band is None:
        allowed = LEAST_SHARE * abs(predicted) if what == "gain" else LEAST_LAG_DEG
        half = own
        misses = abs(off) > max(half, allowed)
    else:
        edge = _difference(what, band[1], predicted) if off > 0 else -_difference(what, band[0], predicted)
        half = math.hypot(own, max(0.0, edge))
        misses = abs(off) > half
    first, last = band or (None, None)
    return Verdict(predicted, first, last, off, half, bool(misses), _in_words(what, off, predicted, half))


def _motions(curve: dict[str, Any], what: str, at: float) -> list[float]:
    """Return the stable motions at a frequency, all of them where none is stable; a curve with folds has several."""
    x, y = np.asarray(curve["frequency_hz"], float), np.asarray(curve[what], float)
    stable = np.asarray(curve.get("stable") or np.ones(x.size, bool), bool)
    if x.size == 1:
        return [float(y[0])]
    low, high = np.minimum(x[:-1], x[1:]), np.maximum(x[:-1], x[1:])
    parts = np.flatnonzero((low <= at) & (at <= high))
    steady = parts[stable[parts] & stable[parts + 1]]
    found = []
    for i in steady if steady.size else parts:
        share = 0.0 if x[i] == x[i + 1] else (at - x[i]) / (x[i + 1] - x[i])
        found.append(float(y[i] + share * (y[i + 1] - y[i])))
    return found


def _band(curve: dict[str, Any], what: str, at: float) -> tuple[float, float] | None:
    """Return the ends of the band at a frequency; None where there is none."""
    ends = [np.array(curve.get(f"{what}_{end}") or [], dtype=float) for end in ("low", "high")]
    if not all(end.size for end in ends):
        return None
    x = np.asarray(curve["frequency_hz"], float)
    order = np.argsort(x, kind="stable")
    low, high = (float(np.interp(at, x[order], end[order])) for end in ends)
    return (low, high) if math.isfinite(low) and math.isfinite(high) else None


def _difference(what: str, one: float, other: float) -> float:
    """Return one less the other; of lags the nearer way round, in degrees."""
    return one - other if what == "gain" else (one - other + 180.0) % 360.0 - 180.0


def _in_words(what: str, off: float, predicted: float, half: float) -> str:
    by = f"{100 * off / abs(predicted):+.0f} %" if what == "gain" and predicted else f"{off:+.0f}{_UNITS[what]}"
    if not half > 0:
        return typeset(by)
    times = abs(off) / half
    if times > _FAR:
        return typeset(f"{by}, more than {_FAR:g} times its uncertainty")
    return typeset(f"{by}, {times:.{0 if times >= _PLAINLY else 1}f} of its uncertainty")


# The points of a run, each with what is said of it.


def judged(predicted: Sequence[dict[str, Any]], measured: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return measured curves with `gain_verdict` and `phase_verdict`, one `Verdict` or None for each point."""
    curves = {curve["pretension_mm"]: curve for curve in predicted}
    made = []
    for one in measured:
        curve = curves.get(one["pretension_mm"])
        points = {what: zip(one["frequency_hz"], one[what], strict=True) for what in _UNITS}
        verdicts = {
            f"{what}_verdict": [None if curve is None else judge(what, curve, at, value) for at, value in points[what]]
            for what in _UNITS
        }
        made.append({**one, **verdicts})
    return made


def misses(measured: Sequence[dict[str, Any]]) -> list[str]:
    """Return a sentence for each point that misses its prediction, the farthest by its uncertainty first."""
    found = []
    for one in measured:
        for what, unit in _UNITS.items():
            for at, value, verdict in zip(one["frequency_hz"], one[what], one[f"{what}_verdict"], strict=True):
                if verdict is not None and verdict.misses:
                    predicted = span(verdict.low, verdict.high, unit) if verdict.low is not None else ""
                    predicted = predicted or number(verdict.predicted, 3, unit)
                    name = {"gain": "gain", "phase": "lag"}[what]
                    where = f"{one['pretension_mm']:g} mm, {at:g} Hz"
                    said = f"{where}: {name} {shown_interval(value, unit)}, predicted {predicted}: {verdict.sentence}"
                    found.append((abs(verdict.off) / verdict.half if verdict.half else math.inf, typeset(said)))
    return [said for _, said in sorted(found, key=lambda row: -row[0])]


def count_misses(measured: Sequence[dict[str, Any]]) -> str:
    """Return how many points miss, in one sentence; empty where none could be judged."""
    verdicts = [v for one in measured for what in _UNITS for v in one[f"{what}_verdict"] if v is not None]
    count = sum(verdict.misses for verdict in verdicts)
    if not verdicts:
        return ""
    if not count:
        return f"None of {len(verdicts)} judged values misses its prediction."
    verb = "misses" if count == 1 else "miss"
    by_chance = " One in ten does by chance." if any(v.low is not None for v in verdicts) else ""
    return f"{count} of {len(verdicts)} judged values {verb} the prediction.{by_chance}"


# A run's files are made for who takes them along.

FILES = {"recording": "recording.nc", "csv": "recording.csv", "mat": "recording.mat", "report": "report.html"}
"""What can be had, and the name of its file."""


def download(folder: Path | str, kind: str) -> Path:
    """Return where a run's recording, CSV table, MATLAB file or report is, made where it is not yet.

    Made files lie in the cache of the run's folder; one that is older than its recording is made anew, whole or not
    at all. Raises SpecError for an unknown kind; FileError and RecordingError as `recording_of`.
    """
    from sinew.measure.files.formats import export_recording

    folder = Path(folder)
    if kind not in FILES:
        raise SpecError(f"found a file of kind {kind!r}, expected one of {', '.join(FILES)}")
    recording = recording_of(folder)
    if kind == "recording":
        return recording
    path = folder / CACHE / FILES[kind]
    if path.is_file() and path.stat().st_mtime_ns >= recording.stat().st_mtime_ns:
        return path
    path.parent.mkdir(exist_ok=True)
    if kind == "report":
        _report(folder, path)
    else:
        export_recording(load_own(folder), path, kind)
    return path


def _report(folder: Path, path: Path) -> None:
    from sinew.analysis.analysed import recording_rig
    from sinew.paper.report import draw_figures, write_report

    recording, results = load_own(folder), results_of(folder)
    figures = draw_figures(recording, results, path.with_name("figures"), formats=("png",))
    rebuild = str(recording.attrs.get("command", ""))
    write_report(path.parent, results=results, figures=figures, rig=recording_rig(recording, None), rebuild=rebuild)


# A run that is under way is analysed group by group, each once.

MOST_AT_ONCE = 120
"""Groups that one update analyses unless told otherwise; the rest wait for the next."""

_DECAY = {
    "damping_ratio": "damping_ratio_std",
    "decay_frequency_hz": "decay_frequency_std_hz",
    "decay_rate_per_s": "decay_rate_std_per_s",
}


def measured_so_far(journal_path: str) -> dict[str, Any]:
    """Return what `LiveResults.update` says of a journal; its state stays in this process."""
    path = Path(journal_path)
    unlinked(path.parent)
    return _live(path, path.stat().st_ino if path.exists() else 0).update()


@lru_cache(maxsize=4)
def _live(path: Path, inode: int) -> "LiveResults":
    """Return what is known of a journal. inode: of the file, for a run may be deleted and another take its name."""
    return LiveResults(path)


class _Group(NamedTuple):
    """What a group of steady swings or decays says. numbers: by name, of its one repeat; note: where it says none."""

    kind: str
    pretension_mm: float
    frequency_hz: float
    repeat: int
    numbers: dict[str, float]
    note: str = ""


@dataclass
class LiveResults:
    """What is known of a journal so far, by group, session and attempt: one that is measured again is another."""

    path: Path
    most_at_once: int = MOST_AT_ONCE
    groups: dict[tuple[int, int, int], _Group] = field(default_factory=dict)

    def update(self) -> dict[str, Any]:
        """Analyse the groups that were finished since, and return all that is known.

        `curves`: of each pretension in increasing order `pretension_mm`, `frequency_hz`, and over it `gain` (mean of
        peaks over the commanded amplitude), `gain_measured_drive`, `phase` (lag behind the lever [deg]), each
        `{"value", "std", "interval90"}` of the mean over repeats, `repeats`, `settled`, `saturated_share`.
        `damping`: of each pretension with ring-downs `pretension_mm`, `damping_ratio`, `decay_frequency_hz`,
        `decay_rate_per_s`, `repeats`. `groups_done`: finished, `pending`: of them not yet analysed. `notes`: sentences
        on groups that could not be. Raises FileError where there is no journal.
        """
        from sinew.bench.record.journal import JournalReader
        from sinew.plan.toml import parse_rig

        with JournalReader(self.path) as journal:
            rig, finished = parse_rig(journal.rig_toml), journal.finished()
        last = {(i, parts[-1].session, parts[-1].attempt): parts[-1] for i, parts in finished.items()}
        self.groups = {key: group for key, group in self.groups.items() if key in last}
        fresh = [key for key in last if key not in self.groups]
        for key in fresh[: self.most_at_once]:
            self.groups[key] = self._analysed(key[0], last[key], rig)
        return {
            "curves": self._curves(),
            "damping": self._damping(),
            "groups_done": len(last),
            "pending": max(0, len(fresh) - self.most_at_once),
            "notes": [group.note for group in self.groups.values() if group.note],
        }

    def _analysed(self, index: int, part: "Stretch", rig: "RigSpec") -> _Group:
        from sinew.bench.record.conversion import recording_from_journal

        group_key = part.kind, part.planned.pretension_mm, part.planned.frequency_hz, part.planned.repeat
        analyse = {"steady": _steady, "ring-down": _decay}.get(part.kind)
        if analyse is None:
            return _Group(*group_key, {})
        try:
            numbers = analyse(recording_from_journal(self.path, {index}), rig)
        except SinewError as trouble:
            return _Group(*group_key, {}, str(trouble))
        lacks = f"group {index + 1} could not be analysed: it has holes, or lacks whole periods"
        return _Group(*group_key, numbers, "" if numbers else lacks)

    def _known(self, kind: str) -> list[_Group]:
        """Return the groups of a kind that say something, in increasing order."""
        known = (group for group in self.groups.values() if group.kind == kind and group.numbers)
        return sorted(known, key=lambda group: (group.pretension_mm, group.frequency_hz, group.repeat))

    def _curves(self) -> list[dict[str, Any]]:
        curves = []
        for pretension, level in groupby(self._known("steady"), key=lambda group: group.pretension_mm):
            curves.append(_begun_curve(pretension))
            for frequency, repeats in groupby(level, key=lambda group: group.frequency_hz):
                _add_point(curves[-1], frequency, _table(list(repeats)))
        return curves

    def _damping(self) -> list[dict[str, Any]]:
        rows = []
        for pretension, level in groupby(self._known("ring-down"), key=lambda group: group.pretension_mm):
            repeats = list(level)
            table = _table(repeats)
            row = {name: _mean_of(table[name], table[std]) for name, std in _DECAY.items()}
            rows.append({"pretension_mm": pretension, **row, "repeats": len(repeats)})
        return rows


def _steady(recording: "xr.Dataset", rig: "RigSpec") -> dict[str, float]:
    """Return the numbers of a recording of one steady swing; none where it could not be analysed."""

    from sinew.analysis.sweep.response import estimate_response

    response = estimate_response(recording, rig)
    columns = response.columns | {"gain_std": response.nominal_gain_std * response.columns["gain"]}
    numbers = {name: float(column.flat[0]) for name, column in columns.items()}
    return numbers if np.isfinite(numbers["gain"]) else {}


def _decay(recording: "xr.Dataset", rig: "RigSpec") -> dict[str, float]:
    """Return the numbers of a recording of one free decay; none where it could not be analysed."""

    from sinew.analysis.decay.ring_down import analyse_ring_downs

    results = analyse_ring_downs(recording, rig.inertia.head.value + rig.inertia.lever.value)
    damping = results["damping_ratio"].values
    measured = np.argwhere(np.isfinite(damping))  # of a repeat that is not the first, those before are empty
    names = (*_DECAY, *_DECAY.values())
    return {name: float(results[name].values[tuple(measured[0])]) for name in names} if measured.size else {}


def _table(groups: list[_Group]) -> "dict[str, NDArray[Any]]":
    """Return each number over the repeats, (1, r), NaN where a repeat is not there yet."""

    width = max(group.repeat for group in groups) + 1
    table = {name: np.full((1, width), np.nan) for name in groups[0].numbers}
    for group in groups:
        for name, one in group.numbers.items():
            table[name][0, group.repeat] = one
    return table


def _mean_of(values: "NDArray[Any]", stds: "NDArray[Any]", shared: float = 0.0, scale: float = 1.0) -> dict[str, Any]:
    """Return the mean over repeats (1, r) with its interval. shared: standard uncertainty that all repeats share."""
    from sinew.analysis.signal.repeats import combine_repeats
    from sinew.measure.estimate import Estimate

    mean = combine_repeats(values, stds, systematic=shared)
    numbers = (mean.value[0], mean.std_of_value[0], mean.low[0], mean.high[0])
    return Estimate(*(float(number) * scale for number in numbers)).to_json()
