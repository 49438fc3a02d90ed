"""What a restructuring must not change: numbers and keys, recorded before and compared after.

    python -m campaigns.same_numbers record out/before
    python -m campaigns.same_numbers record out/after          (of the other tree)
    python -m campaigns.same_numbers compare out/before out/after

`record` runs the commands of `STEPS` as a user would and keeps what they print with --json and what they write: every
number of the paper's campaign, predictions, identifications, designs; of a bench in real time the keys alone. It takes
about eight minutes of one core. `compare` prints each number that moved beyond --rtol, each word that changed and each
key that was lost or added; exit status 1 unless all is the same. What may differ from one run to the next stands in
`VOLATILE`.
"""

import argparse
import csv
import json
import math
import os
import re
import resource
import shlex
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from tools.tree import ROOT

DATA = ROOT.parent / "shared" / "data"
"""Recordings that others measured; they are no part of this repository."""

VOLATILE = {
    "wall_s": "how long it took",
    "started": "when a run began",
    "versions": "of Sinew, Python and packages",
    "recording_versions": "the same",
    "content_hash": "is over attributes, versions among them",
    "recording_hash": "a content_hash",
    "effects_hash": "of a file whose last digits may differ",
}
"""Keys whose values are not compared, wherever they stand, and why; that they are there still is."""

FLOOR = 1e-3
"""A number smaller than this share of the largest in its array is compared relative to that share.

What cancels to nearly zero keeps the rounding of what it was made from: at an rtol of 1e-9 a difference of 1e-12 of the
array's scale is let pass. A number alone is its own array."""

WHOLE = 20_000
"""Up to so many values an array is kept whole; of a longer one `SAMPLES` of them, and its moments."""

SAMPLES = 2_000

TINY = """
name = "tiny"
[pretension]
pretension_mm = [2]
rest_s = 0.5
[sweep]
frequency_hz = [3]
settle_s = 1
periods = 3
repeats = 1
"""


@dataclass(frozen=True)
class Step:
    """One command line. data: what it reads of `DATA`. in_real_time: its numbers hang on the clock, so only its keys
    are compared."""

    name: str
    command: str
    data: str = ""
    in_real_time: bool = False


_LINES = r"""
check-paper: check paper --json
check-short: check short --json
reproduce: reproduce --out campaign --json
simulate: simulate first --seed 3 --out first.nc --json
simulate-without: simulate first --without repeatability --out bare.nc --json
analyse: analyse first.nc --out analysed --json
export: export first.nc --to csv --out first.csv --json
export-mat: export first.nc --to mat --out first.mat --json
predict-paper: predict paper --out predicted --json
predict-current: predict paper --pretension-mm 4 --mode current --backbone --json
predict-oscillator: predict --oscillator inertia_kg_m2=0.01,frequency_hz=3,damping_ratio=0.05,cubic_n_m_rad3=2 \
    --torque-n-m 0.3 --backbone --json
predict-joint: predict --section circle --outer-mm 50 --length-mm 120 --material dragon-skin-30 --pretension-mm 4 \
    --json
predict-against: predict paper --pretension-mm 2 --against first.nc --json
transfer: model paper --to control --pretension-mm 4 --amplitude-deg 5,10,20 --out transfer.json --json
joint: joint --section annulus --outer-mm 60 --inner-mm 30 --length-mm 95 --out tube.toml --json
compare: predict paper tube.toml --pretension-mm 4 --json
tune: tune paper --resonance-hz 3.2,3.6 --yaw-deg 7 --json
calibrate: calibrate paper first.nc --out mine.toml --json
predict-bands: predict mine.toml --pretension-mm 4 --bands 20 --json
identify-cubic: identify first.nc --pretension 2 --model cubic --out fitted --json
identify-tendon: identify first.nc --model tendon --json
design: design --stride-hz 0.7:1.1 --yaw-deg 7 --starts 2 --exact 2 --proposals 1 --shape circle --material base \
    --out designed --json
answer: report first.nc --answers --out answered --json
track: track paper --emulate --pretension-mm 4 --duration-s 8 --from-hz 2.7 --out tracked --json
analyse-beam < silicone_beam_dragonskin10/beam_gravity_V2_a.csv: analyse beam.csv --kind ring-down --time t_s \
    --response Tip-1_x_m:m --json
import-beam < silicone_beam_dragonskin10/beam_gravity_V2_a.csv: import beam.csv --kind ring-down --time t_s \
    --response Tip-1_x_m:m --out beam.nc --json
identify-beam < silicone_beam_dragonskin10/beam_load52_V2_a.csv: identify beam.csv --time t_s --output Tip-1_x_m:m \
    --excitation none --json
identify-pendulum < torsion_spring_pendulum/60.csv: identify pendulum.csv --rate 259.5 --model coulomb --output \
    angle_deg:deg --excitation none --json
identify-rod < rotary_pendulum_swing/pendulum_free_swing_data_01.txt: identify rod.csv --rate 1000 --model cubic \
    --output angle_deg:deg --excitation none --json
gait-markers < gait_mocap/bmclab_gait_c3d_markers.csv: design --walk markers.csv --gait-only --json
gait-sensors < qmt_walking_imu/walking.npz: design --walk sensors.npz --gait-only --json
@doctor: doctor --port bench --json
@run: run tiny.toml --port bench --out benched --json
@stop: stop --port bench --json
"""
"""A step in a line: its name, of what it reads, its command; `@` before one in real time."""

STEPS = tuple(
    Step(name.lstrip("@"), command, data, in_real_time=name.startswith("@"))
    for head, command in (line.split(": ", 1) for line in _LINES.replace("\\\n    ", "").strip().splitlines())
    for name, _, data in [head.partition(" < ")]
)


def record(folder: Path, only: Sequence[str] = ()) -> bool:
    """Write into a folder what is compared: documents.json, arrays.npz, taken.json; return whether no command failed.

    only: the beginnings of the steps' names to which it is limited; all by default. A command that fails has no
    document, so that a comparison calls it lost.
    """
    folder.mkdir(parents=True, exist_ok=True)
    steps = [step for step in STEPS if _is_wanted(step.name, only)]
    documents: dict[str, Any] = {}
    arrays: dict[str, np.ndarray] = {}
    taken: dict[str, Any] = {"skipped": {}, "failed": {}, "in_real_time": []}
    with tempfile.TemporaryDirectory() as temporary:
        work = Path(temporary)
        (work / "tiny.toml").write_text(TINY, encoding="utf-8")
        with ExitStack() as bench:
            for step in steps:
                if step.data and not (DATA / step.data).is_file():
                    taken["skipped"][step.name] = f"{step.data} is not beside this repository"
                    print(f"{step.name}: skipped, {taken['skipped'][step.name]}", flush=True)
                    continue
                if step.data:
                    _provide(step, work)
                if step.in_real_time:
                    if "emulate" not in documents:
                        documents["emulate"] = bench.enter_context(_bench(work))
                    taken["in_real_time"] += ["emulate", step.name]
                before = set(work.rglob("*"))
                began, cpu_s = time.monotonic(), _children_s()
                try:
                    documents[step.name] = json.loads(_sinew(*shlex.split(step.command), work=work).stdout)
                except (RuntimeError, json.JSONDecodeError) as error:
                    taken["failed"][step.name] = str(error)
                    print(f"{step.name}: FAILED, {error}", flush=True)
                new = [path for path in sorted(set(work.rglob("*")) - before) if _is_kept(path)]
                documents[f"{step.name}/files"] = {path.relative_to(work).as_posix(): True for path in new}
                for path in () if step.in_real_time else new:
                    _take_file(f"{step.name}/{path.relative_to(work).as_posix()}", path, documents, arrays)
                spent = f"{time.monotonic() - began:.1f} s, {_children_s() - cpu_s:.1f} s of them computing"
                print(f"{step.name}: {spent}", flush=True)
        # A path of a temporary folder has another name each time.
        text = json.dumps(documents).replace(str(work.resolve()), "WORK").replace(str(work), "WORK")
    (folder / "documents.json").write_text(text, encoding="utf-8")
    (folder / "taken.json").write_text(json.dumps(taken, indent=1), encoding="utf-8")
    np.savez_compressed(folder / "arrays.npz", **arrays)  # type: ignore[arg-type]
    print(f"computing in all: {_children_s():.0f} s")
    return not taken["failed"]


@contextmanager
def _bench(work: Path) -> Iterator[Any]:
    """Play a bench behind a port, and give the document that says that a master can open it."""
    command = [*_entry(), "emulate", "--link", "bench", "--seed", "1", "--for", "600", "--json"]
    with subprocess.Popen(command, cwd=work, env=_environment(), stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield json.loads(process.stdout.readline())
        finally:
            process.terminate()
            process.communicate()


def _entry() -> list[str]:
    """Return how the command `sinew` of this very tree begins, which need not be the one that is installed."""
    script = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]["sinew"]
    module, function = script.split(":")
    return [sys.executable, "-c", f"import sys; from {module} import {function}; sys.exit({function}())"]


def _environment() -> dict[str, str]:
    path = os.pathsep.join([str(ROOT / "src"), *os.environ.get("PYTHONPATH", "").split(os.pathsep)])
    return {**os.environ, "PYTHONPATH": path, "MPLBACKEND": "agg", "COLUMNS": "100"}


def _sinew(*arguments: str, work: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Return what a command line ended with. Raises RuntimeError with what it said where it was refused."""
    done = subprocess.run(
        [*_entry(), *arguments], cwd=work, env=_environment(), capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"sinew {shlex.join(arguments)} ended with {done.returncode}: {done.stderr[-2000:]}")
    return done


def _provide(step: Step, work: Path) -> None:
    """Put a recording of others where the step looks for it."""
    name = next(word for word in shlex.split(step.command) if word.endswith((".csv", ".npz")))
    if step.data.endswith(".txt"):  # its two lines of header say the rate and what is below
        text = (DATA / step.data).read_text(encoding="utf-8").split("\n", 2)[2]
        (work / name).write_text("angle_deg\n" + text, encoding="utf-8")
    else:
        (work / name).write_bytes((DATA / step.data).read_bytes())


def _is_kept(path: Path) -> bool:
    """Whether a path is a file that stays: not of SQLite's journal, of a run's socket or of the bench."""
    return path.is_file() and not path.is_symlink() and not path.name.endswith(("-wal", "-shm", ".lock", ".clock"))


def _take_file(name: str, path: Path, documents: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    """Add what a written file holds: JSON and TOML as documents, NetCDF and CSV as arrays; others stand by name."""
    match path.suffix:
        case ".json":
            documents[name] = json.loads(path.read_text(encoding="utf-8"))
        case ".toml":
            documents[name] = tomllib.loads(path.read_text(encoding="utf-8"))
        case ".csv":
            with path.open(encoding="utf-8", newline="") as file:
                head, *rows = csv.reader(file)
            columns = {column: _column(cells) for column, cells in zip(head, zip(*rows, strict=True), strict=True)}
            documents[name] = {column: _take(f"{name}:{column}", values, arrays) for column, values in columns.items()}
        case ".nc":
            with xr.open_dataset(path, decode_times=False) as dataset:
                documents[name] = {"attributes": _plain(dataset.attrs), "variables": {}}
                for variable, data in dataset.variables.items():
                    held = _take(f"{name}:{variable}", data.values, arrays)
                    about = {"dims": list(data.dims), "attributes": _plain(data.attrs)}
                    documents[name]["variables"][str(variable)] = about | held


def _column(cells: Sequence[str]) -> np.ndarray:
    """Return a column of a table as numbers, an empty cell as NaN; as words where one is no number."""
    try:
        return np.array([float(cell or "nan") for cell in cells])
    except ValueError:
        return np.array(cells)


def _take(name: str, values: np.ndarray, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    """Keep an array, or of a long one an even choice and its moments; return what is a document's."""
    about: dict[str, Any] = {"shape": list(values.shape), "dtype": str(values.dtype)}
    if values.dtype.kind not in "fiub":
        return about | {"words": [str(value) for value in values.ravel()]}
    flat = values.ravel().astype(float)
    if flat.size <= WHOLE:
        arrays[name] = flat
        return about
    arrays[name] = flat[np.linspace(0, flat.size - 1, SAMPLES).round().astype(int)]
    known = flat[np.isfinite(flat)]
    mean_square = float(np.mean(known**2))
    return about | {"least": known.min(), "greatest": known.max(), "mean_square": mean_square, "known": known.size}


def _plain(attributes: Any) -> dict[str, Any]:
    return {str(name): getattr(value, "tolist", lambda value=value: value)() for name, value in attributes.items()}


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


# ---- comparison


@dataclass
class Difference:
    """What two records differ in, each as lines to print. numbers: how many were compared; greatest: the largest
    relative difference and where. Only `remarks` and `added` are no reason to worry."""

    numbers: int = 0
    greatest: float = 0.0
    where: str = ""
    moved: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    added: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    @property
    def is_none(self) -> bool:
        """Whether nothing moved, changed or was lost."""
        return not (self.moved or self.changed or self.lost)


Leaf = float | str | bool | None


def difference(
    before: dict[str, Any], after: dict[str, Any], *, rtol: float = 1e-9, keys_only: Sequence[str] = ()
) -> Difference:
    """Return how two sets of documents differ.

    before, after: JSON documents or arrays by name. rtol: what numbers may move by, relative, see `FLOOR`.
    keys_only: names of documents whose values hang on the clock: of them keys and kinds of values are compared.
    """
    told = Difference()
    for name in sorted(before.keys() - after.keys()):
        told.lost.append(name)
    told.added += sorted(after.keys() - before.keys())
    for name in sorted(before.keys() & after.keys()):
        one, other = dict(_leaves(before[name], name)), dict(_leaves(after[name], name))
        _compare_keys(one, other, told)
        if name not in keys_only:
            _compare_leaves(one, other, rtol, told)
    return told


def _leaves(value: Any, path: str) -> Iterator[tuple[str, Leaf]]:
    """Yield every value that holds no other, with its path; an empty list or object counts as one."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(None if key in VOLATILE else inner, f"{path}/{key}")
    elif isinstance(value, list | np.ndarray):
        for index, inner in enumerate(value):
            yield from _leaves(inner, f"{path}[{index}]")
    elif value is None or isinstance(value, bool | str):
        # Some attributes are whole documents as text.
        inner = _document(value) if isinstance(value, str) else None
        yield from [(path, value)] if inner is None else _leaves(inner, path)
    else:
        yield path, float(value)


def _document(text: str) -> Any:
    if not text.startswith(("{", "[")):
        return None
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return None


def _family(path: str) -> str:
    """Return a path without its indices: where all rows of a list stand together."""
    return re.sub(r"\[\d+\]", "[]", path)


def _kinds(leaves: dict[str, Leaf]) -> dict[str, set[str]]:
    kinds: dict[str, set[str]] = {}
    for path, value in leaves.items():
        kind = "nothing" if value is None else {float: "number", str: "text", bool: "truth"}[type(value)]
        kinds.setdefault(_family(path), set()).add(kind)
    return kinds


def _compare_keys(one: dict[str, Leaf], other: dict[str, Leaf], told: Difference) -> None:
    before, after = _kinds(one), _kinds(other)
    told.lost += sorted(before.keys() - after.keys())
    told.added += sorted(after.keys() - before.keys())
    for family in sorted(before.keys() & after.keys()):
        # A number may be unknown in one run and known in the next; a word does not become a number.
        if (before[family] ^ after[family]) - {"nothing"} and {"nothing"} not in (before[family], after[family]):
            kinds = [" or ".join(sorted(kinds)) for kinds in (before[family], after[family])]
            told.changed.append(f"{family}: was {kinds[0]}, is {kinds[1]}")


def _compare_leaves(one: dict[str, Leaf], other: dict[str, Leaf], rtol: float, told: Difference) -> None:
    scales: dict[str, float] = {}
    for path, value in one.items():
        if isinstance(value, float) and math.isfinite(value):
            family = _family(path)
            scales[family] = max(scales.get(family, 0.0), abs(value))
    short: Counter[str] = Counter()
    for path, value in one.items():
        if path not in other:
            short[_family(path)] += 1
            continue
        now = other[path]
        if isinstance(value, float) and isinstance(now, float):
            told.numbers += 1
            off = relative_difference(value, now, scales.get(_family(path), 0.0))
            if off > told.greatest:
                told.greatest, told.where = off, path
            if off > rtol:
                told.moved.append(f"{path}: {value!r} -> {now!r} ({off:.2g})")
        elif value != now or type(value) is not type(now):
            told.changed.append(f"{path}: {value!r} -> {now!r}")
    families = set(map(_family, other))
    told.lost += [f"{family}: {count} fewer" for family, count in short.items() if family in families]
    longer = Counter(_family(path) for path in other.keys() - one.keys())
    told.changed += [f"{family}: {count} more" for family, count in longer.items() if family in scales]


def relative_difference(before: float, after: float, scale: float) -> float:
    """Return by how much a number moved, relative to the larger of both, or to `FLOOR` of its array's scale.

    NaN is the same as NaN, an infinity as itself; either against anything else is infinitely far.
    """
    if before == after or (math.isnan(before) and math.isnan(after)):
        return 0.0
    if not (math.isfinite(before) and math.isfinite(after)):
        return math.inf
    return abs(after - before) / max(abs(before), abs(after), FLOOR * scale)


def compare(before: Path, after: Path, *, rtol: float, only: Sequence[str] = ()) -> Difference:
    """Return how two recorded folders differ."""
    records = [_load(folder, only) for folder in (before, after)]
    taken = [json.loads((folder / "taken.json").read_text(encoding="utf-8")) for folder in (before, after)]
    told = difference(*records, rtol=rtol, keys_only=taken[0]["in_real_time"])
    for folder, one in zip((before, after), taken, strict=True):
        told.remarks += [f"{folder}: {name} was skipped: {why}" for name, why in one["skipped"].items()]
    return told


def _load(folder: Path, only: Sequence[str]) -> dict[str, Any]:
    documents: dict[str, Any] = json.loads((folder / "documents.json").read_text(encoding="utf-8"))
    with np.load(folder / "arrays.npz") as arrays:
        documents |= {f"{name}:values": arrays[name] for name in arrays.files}
    return {name: value for name, value in documents.items() if _is_wanted(name, only)}


def _is_wanted(name: str, only: Sequence[str]) -> bool:
    return not only or name.startswith(tuple(only))


def report(told: Difference, most: int) -> str:
    """Return the difference as text, at most so many lines of each kind."""
    lines = [f"{told.numbers} numbers compared; greatest relative difference {told.greatest:.2g} {told.where}".rstrip()]
    for title, found in (
        ("numbers moved", told.moved),
        ("words changed", told.changed),
        ("lost", told.lost),
        ("added", told.added),
        ("remarks", told.remarks),
    ):
        lines.append(f"{title}: {len(found)}")
        lines += [f"  {line}" for line in found[:most]]
        if len(found) > most:
            lines.append(f"  ... and {len(found) - most} more")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Record or compare, and return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m campaigns.same_numbers", description=__doc__)
    ways = parser.add_subparsers(dest="way", required=True)
    recording = ways.add_parser("record", help="write what is compared into a folder")
    recording.add_argument("folder", type=Path)
    comparing = ways.add_parser("compare", help="compare two such folders")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    comparing.add_argument("--rtol", type=float, default=1e-9, help="what a number may move by, relative [1e-9]")
    comparing.add_argument("--most", type=int, default=200, help="lines of each kind [200]")
    for way in (recording, comparing):
        way.add_argument("--only", nargs="+", default=[], metavar="NAME", help="steps whose names begin so")
    given = parser.parse_args(arguments)
    if given.way == "record":
        return 0 if record(given.folder, given.only) else 1
    told = compare(given.before, given.after, rtol=given.rtol, only=given.only)
    print(report(told, given.most))
    return 0 if told.is_none else 1


if __name__ == "__main__":
    sys.exit(main())
