"""`sinew identify`: the mechanics of an oscillation from its recording."""

import re
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from sinew.apps import console
from sinew.apps.console import (
    Columns,
    ColumnTime,
    Gaps,
    Json,
    Keep,
    Rate,
    Run,
    Scheduler,
    Start,
    Stop,
    Workers,
    flag,
    option,
)
from sinew.measure.errors import FileError, SinewError, SpecError, TimeError
from sinew.measure.estimate import shown
from sinew.measure.result import Table

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from sinew.identify.identified import Identified
    from sinew.identify.oscillator.record import Excitation, Record
    from sinew.identify.points import ResponsePoints
    from sinew.measure.files.names import Table as CsvTable
    from sinew.measure.tasks import Spread

    Array = np.ndarray[tuple[int], np.dtype[np.float64]]

EXCITATIONS = ("force", "torque", "base", "lever", "none")
KINDS = ("samples", "stepped")


def identify(
    context: typer.Context,
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...", help="A table of any lab, a recording of Sinew (NetCDF), several, or a folder."
        ),
    ],
    time: ColumnTime = None,
    input_: Annotated[str | None, option("COL[:unit]", "Column of what drives it.", "--input", "--drive")] = None,
    output: Annotated[str | None, option("COL[:unit]", "Column of how it moves.", "--output", "--response")] = None,
    excitation: Annotated[str | None, option("|".join(EXCITATIONS), "What the input is; none is a free decay.")] = None,
    model: Annotated[str, option("MODEL", "What to fit: auto, tendon (of a rig's recording), or {models}.")] = "auto",
    start: Start = None,
    stop: Stop = None,
    train: Annotated[str | None, option("A:B", "Samples to fit: indices from 0, half open.")] = None,
    test: Annotated[str | None, option("A:B", "Samples to predict, held out of the fit.")] = None,
    gaps: Gaps = "refuse",
    run: Run = None,
    columns: Columns = None,
    rate: Rate = None,
    pretension: Annotated[float | None, option("MM", "Of a rig's recording; else its smallest.")] = None,
    rig: Annotated[str | None, option("RIG", "Where model tendon begins; else the recording's rig.")] = None,
    posterior: Annotated[
        bool, flag("--posterior", "Add the posterior by NUTS: minutes; needs the extra posterior.")
    ] = False,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the posterior's draws.")] = 0,
    kind: Annotated[str, option("|".join(KINDS), "What FILE holds: samples, or steady states of a sine.")] = "samples",
    frequency: Annotated[
        str | None, option("COL", "Of steady states: column of frequencies; else frequency_hz.")
    ] = None,
    phase: Annotated[str | None, option("COL[:unit]", "Of steady states: column of phases; else phase_deg.")] = None,
    chain: Annotated[
        str | None, option("phase,background", "Of steady states: what the measuring chain may add; a constant.")
    ] = None,
    scheduler: Scheduler = None,
    workers: Workers = 1,
    keep: Keep = None,
    out: Annotated[Path | None, option("DIR", "Folder for fit.json, fit.html and figures.")] = None,
    json: Json = False,
) -> None:
    """Identify stiffness, damping law and nonlinearity.

    Each with an interval; which model the data support is said. Without --train and --test the fit is to all
    samples, and every fourth block of them is held out once to compare models. With --model auto the stiffness law
    and the damping law are chosen, or it says what cannot be told. Of a free decay the free part is found, unless
    --start, --stop, --train or --test choose one. Several files, or a folder (of runs, or of recordings), are a row
    each, by workers side by side, and --out takes the document of each as it comes; a file that tells nothing is a
    row that says why.

    \b
    a force sweep, figures too:
      sinew identify a.csv --time t --input u:N --output x:mm --excitation force --out out/a
    a free decay:
      sinew identify b.csv --time t_s --output angle:deg --excitation none
    volts in, volts out, no time column, fitted on the first half and tested on the second:
      sinew identify c.csv --rate 600 --input u:V --output y:V --excitation force --train 0:4000 --test 4000:8000
    a moving base:
      sinew identify d.csv --time t --input base:mm --output tip:mm --excitation base --model loss-factor
    a recording of a rig, one pretension as one degree of freedom, or all of it as the tendon joint:
      sinew identify recording.nc --pretension 4 --model cubic
      sinew identify recording.nc --model tendon --out out/joint
    a folder of runs, by four processes, again what was broken off:
      sinew identify runs --model cubic --workers 4 --keep out/fits.sqlite
    a stepped sine, each row a steady state with columns frequency_hz and phase_deg; each level of the drive a curve:
      sinew identify steps.csv --kind stepped --output amplitude:deg --input torque:N*m --excitation torque --out out/e
    """
    if excitation is not None:
        console.check_choice("--excitation", excitation, EXCITATIONS)
    console.check_choice("--kind", kind, KINDS)
    console.checked_gaps(gaps)
    if out is not None:
        console.require_folder(out)
    many = _recordings_in(files)
    spread = console.spread_of(scheduler, workers, keep)
    if many is None and (scheduler, workers, keep) != (None, 1, None):
        raise SpecError("--scheduler, --workers and --keep are for several files, or a folder; leave them out")
    request = _Request(
        file=files[0],
        given=console.given_options(context),
        **{name: context.params[name] for name in _Request.__annotations__ if name not in ("file", "given")},
    )
    if many is not None:
        _identify_many([replace(request, file=file) for file in many], spread, out, json=json)
        return
    found = _found(request, console.progress_bar)
    written = ""
    if out is not None:
        with console.progress_bar("draw"):
            written = f"page: {_write(found, request, out, console.command_line(context))}"
    console.print_result(found.to_dict(), found.blocks(), written, json=json)


# Several files: each is a task.


def _recordings_in(files: list[Path]) -> list[Path] | None:
    """Return the files, with the recordings of a folder in place of it; None where it is one file."""
    if len(files) == 1 and not files[0].is_dir():
        return None
    found = []
    for file in files:
        inside = sorted([*file.glob("*.nc"), *file.glob("*/recording.nc")]) if file.is_dir() else [file]
        if not inside:
            raise FileError(
                f"found no recording in the folder {file}, neither NAME.nc nor NAME/recording.nc; name files"
            )
        found += inside
    return found


def _identify_many(request: "list[_Request]", spread: "Spread", out: Path | None, *, json: bool) -> None:
    """Identify every file, and print a row for each; a document for each goes into the folder as it comes."""
    from sinew.measure.tasks import each_task

    tasks = [(replace(one, file=one.file.absolute()), _stamp(one.file)) for one in request]
    rows: list[dict[str, Any]] = [{}] * len(request)
    with console.progress_bar("identify") as progress:
        for index, found in each_task(_one_of_many, tasks, spread, progress):
            file = request[index].file
            rows[index] = {"file": str(file), **found}
            if out is not None:
                name = file.parent.name if file.name == "recording.nc" else file.stem
                console.write_json(rows[index], out / f"{index + 1:04d}-{name}.json")
    sound = [row for row in rows if "refused" not in row]
    cells = [
        (row["file"], row["model"], *(shown(row[name]) for name in ("natural_frequency_hz", "damping_ratio")))
        for row in sound
    ]
    lines: list[Table | str] = [Table(("file", "model", "natural frequency/Hz", "damping ratio"), cells)]
    lines += [f"- {row['file']}: {row['refused']}" for row in rows if "refused" in row]
    document = {"identified": len(sound), "refused": len(rows) - len(sound), "files": rows}
    console.print_result(document, lines, f"documents: {out}" if out is not None else "", json=json)


def _stamp(file: Path) -> tuple[int, int]:
    """Return what changes with a file, for what is kept of it: bytes and time of the last change; zeros of none."""
    try:
        found = file.stat()
    except OSError:
        return 0, 0
    return found.st_size, found.st_mtime_ns


def _one_of_many(task: "tuple[_Request, tuple[int, int]]") -> dict[str, Any]:
    """Return the document of one file, or why there is none."""
    try:
        return _found(task[0], lambda _: nullcontext()).to_dict()
    except SinewError as refusal:
        return {"refused": str(refusal)}


@dataclass(frozen=True)
class _Request:
    """What the command line asked for: the options by the command's parameters, and which of them were given."""

    file: Path
    given: dict[str, str]
    time: str | None
    input_: str | None
    output: str | None
    rate: float | None
    excitation: "Excitation | None"
    model: str
    start: float | None
    stop: float | None
    gaps: Literal["refuse", "split", "bridge"]
    run: str | None
    columns: str | None
    train: str | None
    test: str | None
    pretension: float | None
    rig: str | None
    posterior: bool
    seed: int
    kind: str
    frequency: str | None
    phase: str | None
    chain: str | None

    def about(self) -> str:
        """Return what was fitted, a sentence for the page."""
        shown = {"input": self.input_, "output": self.output, "excitation": self.excitation}
        sentence = ", ".join(f"{name} {value}" for name, value in shown.items() if value is not None)
        return f"From {self.file.name}{f': {sentence}' if sentence else ''}."


_OF_TABLES = ("time", "input_", "output", "frequency", "phase", "rate", "run", "columns", "gaps")
_OF_RIGS = ("pretension", "rig")
_OF_SAMPLES = ("time", "rate", "train", "test", "start", "stop", "gaps", "posterior", "seed")
_OF_STEPS = ("frequency", "phase", "chain")


def _refuse_options(request: _Request, *, recorded: bool) -> None:
    """Raise SpecError for an option that does not go with the file, or with --kind. recorded: whether it is NetCDF."""

    def first(names: tuple[str, ...]) -> str | None:
        return next((request.given[name] for name in names if name in request.given), None)

    if request.kind == "samples" and (option := first(_OF_STEPS)):
        raise SpecError(f"{option} is for steady states; add --kind stepped, or leave it out")
    if request.kind == "stepped" and (option := first(_OF_SAMPLES)):
        raise SpecError(f"{option} is for samples over time, FILE holds steady states; leave it out")
    if request.kind == "stepped" and request.model == "tendon":
        raise SpecError("model tendon is fitted to samples of a rig's recording; leave --kind stepped out")
    if recorded and first(_OF_TABLES):
        raise SpecError(
            "a recording knows its columns and its gaps; --time, --input, --output, --frequency, --phase, --rate, "
            "--run, --columns and --gaps are for tables"
        )
    if not recorded and request.model == "tendon":
        raise SpecError("model tendon needs the recording of a rig (NetCDF), this is a table; choose cubic or auto")
    if not recorded and (option := first(_OF_RIGS)):
        raise SpecError(f"{option} is for the recording of a rig (NetCDF), this is a table; leave it out")


def _range(flag: str, text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    found = re.fullmatch(r"(\d+):(\d+)", text.strip())
    if found is None:
        raise SpecError(f"{flag} is {text!r}, expected A:B, two sample indices (from 0, B not included)")
    return int(found[1]), int(found[2])


_Bar = Callable[[str], AbstractContextManager[console.Progress | None]]


def _found(request: _Request, bar: _Bar) -> "Identified":
    from sinew.measure.files.netcdf import load_recording
    from sinew.measure.read import is_recording

    recorded = is_recording(request.file)
    _refuse_options(request, recorded=recorded)
    train, test = _range("--train", request.train), _range("--test", request.test)
    chain = _chain(request.chain)
    record: xr.Dataset | Record | tuple[ResponsePoints, ...]
    with bar("models compared" if request.model == "auto" else "fit") as progress:
        if request.kind == "stepped":
            record = _recorded_points(request) if recorded else _table_points(request)
        elif recorded:
            record = load_recording(request.file)
        else:
            record, skipped = _table_record(request, train, test)
            train, test = _moved(train, skipped), _moved(test, skipped)
        from sinew.identify.identified import identify as run  # JAX: seconds, behind the bar

        steady = request.kind == "stepped"
        return run(
            record,
            request.model,
            excitation=None if steady else request.excitation,
            pretension_mm=None if steady else request.pretension,
            rig=None if steady else request.rig,
            start_s=request.start,
            stop_s=request.stop,
            train=train,
            test=test,
            posterior=request.posterior,
            chain=chain,
            seed=request.seed,
            progress=progress,
        )


def _moved(samples: tuple[int, int] | None, by: int) -> tuple[int, int] | None:
    return None if samples is None else (samples[0] - by, samples[1] - by)


def _chain(text: str | None) -> tuple[str, ...]:
    known = {"phase": ("phase",), "background": ("background_real", "background_imag")}
    parts = [] if text is None else [part.strip() for part in text.split(",")]
    for part in parts:
        if part not in known:
            raise SpecError(f"--chain holds {part!r}, expected phase, background or both: phase,background")
    return tuple(name for part in known if part in parts for name in known[part])


def _write(found: "Identified", request: _Request, out: Path, rebuild: str) -> Path:
    """Write fit.json, figures and fit.html into a folder and return the path of the page."""
    from sinew.apps.recordings.stored import hash_file
    from sinew.figures.fit import draw_identified, write_fit_page
    from sinew.figures.style import save_figure
    from sinew.measure.files.netcdf import provenance

    paths = []
    for name, figure in draw_identified(found).items():
        paths += save_figure(figure, out / "figures", name, ("png", "pdf"))
    console.write_json(found.to_dict(), out / "fit.json")
    versions = str(provenance("import")["versions"])
    return write_fit_page(
        out,
        found,
        figures=paths,
        about=request.about(),
        rebuild=rebuild,
        origins=[("file", str(request.file)), ("SHA-256", hash_file(request.file)), ("versions", versions)],
    )


# Files for it: the columns that its options name as a record, and steady states as points.


def _table_record(
    request: _Request, train: tuple[int, int] | None, test: tuple[int, int] | None
) -> "tuple[Record, int]":
    """Return the record in a table, and how many of its samples are left out before those of --train and --test.

    What lies outside --start and --stop, or outside --train and --test, is not looked at. Where gaps split the record,
    its longest part is taken; in a free decay they may be bridged, for the simulation goes on through them.
    """
    import numpy as np

    from sinew.identify.oscillator.record import make_record
    from sinew.measure.read import read_stretch, read_table

    if request.excitation is None and request.input_ is not None:
        raise SpecError(f"say what the input is: --excitation {'|'.join(EXCITATIONS[:-1])}")
    if request.gaps != "refuse" and (train is not None or test is not None):
        what = "a part" if request.gaps == "split" else "leaves some out"
        raise SpecError(f"--train and --test choose samples, and --gaps {request.gaps} {what}; leave one of them out")
    if request.gaps == "bridge" and request.input_ is not None:
        raise SpecError(
            "what the input did in a gap is not known, so it cannot be bridged; split the record there and take its "
            "longest part (--gaps split), or choose a part with --start and --stop"
        )
    samples = None
    if train is not None:  # those of both ranges and between them; without a test all behind the first
        samples = (train[0], None) if test is None else (min(train[0], test[0]), max(train[1], test[1]))
    table = read_table(request.file, run=request.run, columns=request.columns, time=request.time)
    roles = {"output": request.output} | ({} if request.input_ is None else {"input": request.input_})
    found = read_stretch(table, roles, request.time, request.rate, (request.start, request.stop), samples, request.gaps)
    timeline = found.timeline
    part = max(timeline.pieces, key=lambda piece: piece.stop - piece.start)
    stamps, response = timeline.time_s[part], found.values["output"][part]
    drive = None if request.input_ is None else found.values["input"][part]
    if drive is not None and np.array_equal(drive, response):
        raise SpecError(
            f"input and output are the same numbers ({request.input_}); name the column of what drives the motion"
        )
    record = make_record(
        stamps,
        response,
        drive,
        excitation=request.excitation or "none",
        output_unit=found.units["output"],
        input_unit=found.units.get("input", "1"),
    )
    if request.gaps == "bridge" and timeline.diagnosis.gaps:
        _check_bridges(record)
    longest = f"the longest part, {stamps[0]:g} to {stamps[-1]:g} s, is taken"
    notes = [f"time: {note}" for note in timeline.notes] if len(timeline.notes) > 1 else []
    lines = (*found.notes, *notes, *((longest,) if len(timeline.pieces) > 1 else ()))
    record = replace(record, notes=lines, output_said=found.said["output"], input_said=found.said.get("input", ""))
    left_out = samples is not None and (samples[1] is None or record.size == samples[1] - samples[0])
    return record, samples[0] if samples is not None and left_out else 0


def _check_bridges(record: "Record") -> None:
    """Raise TimeError where a gap is so long that the swings in it cannot be counted."""
    import numpy as np

    from sinew.identify.oscillator.record import dominant_omega

    steps, half = np.diff(record.time_s), np.pi / dominant_omega(record)
    longest = int(np.argmax(steps))
    if steps[longest] > half:
        raise TimeError(
            f"gap of {steps[longest]:.3g} s after {record.time_s[longest]:.4g} s, longer than half a period of "
            f"{half:.3g} s, cannot be bridged; split the record there and take its longest part (--gaps split)"
        )


def _column(table: "CsvTable", spec: str) -> "tuple[Array, str, str]":
    """Return a column, or the mean of several, in SI, the SI unit, and the unit that it came in."""
    import numpy as np

    from sinew.measure.files.names import find_columns, unit_in_name
    from sinew.measure.read import numbers
    from sinew.measure.units import canonical_unit

    names, stated = find_columns(table, spec)
    said = stated or unit_in_name(names[0]) or "1"
    unit, factor = canonical_unit(said)
    return np.mean([numbers(table, name) for name in names], axis=0) * factor, unit, said


def _table_points(request: _Request) -> tuple["ResponsePoints", ...]:
    """Return the points in a table of steady states."""
    from sinew.identify.points import points_of_table
    from sinew.measure.files.names import find_columns
    from sinew.measure.read import numbers, read_table

    if request.input_ is None or request.output is None:
        missing = "--output COL" if request.output is None else "--input COL"
        raise SpecError(
            f"{request.file.name} holds steady states: name its columns of amplitudes; {missing} is missing"
        )
    if request.excitation is None or request.excitation == "none":
        raise SpecError("say what the input is: --excitation force|torque|base|lever")
    table = read_table(request.file, run=request.run, columns=request.columns)
    names, stated = find_columns(table, request.frequency or "frequency_hz")
    if (stated or "Hz").lower() != "hz":
        raise SpecError(f"--frequency is in {stated}, expected Hz")
    angle, angle_unit, _ = _column(table, request.phase or "phase_deg")
    if angle_unit not in ("rad", "1"):
        raise SpecError(f"--phase is in {angle_unit}, expected degrees or radians: COL:deg or COL:rad")
    response, response_unit, output_said = _column(table, request.output)
    drive, drive_unit, input_said = _column(table, request.input_)
    points = points_of_table(
        numbers(table, names[0]),
        response,
        angle,
        drive,
        excitation=request.excitation,
        output_unit=response_unit,
        input_unit=drive_unit,
    )
    return tuple(replace(one, output_said=output_said, input_said=input_said) for one in points)


def _recorded_points(request: _Request) -> tuple["ResponsePoints", ...]:
    """Return the points of a rig's recording at one pretension, else its smallest, in one group."""
    from sinew.analysis.analysed import recording_rig
    from sinew.analysis.sweep.response import estimate_response
    from sinew.identify.points import points_of_response
    from sinew.measure.files.netcdf import load_recording

    recording = load_recording(request.file)
    if recording.attrs.get("source") == "import":
        raise SpecError(
            "this recording was imported; give a table of its steady states, one row each with frequency_hz, "
            "amplitude, phase_deg and the drive's amplitude"
        )
    if request.excitation not in (None, "lever"):
        raise SpecError(f"--excitation is {request.excitation}, but a rig is driven by its lever; leave it out")
    found = points_of_response(estimate_response(recording, recording_rig(recording, request.rig)))
    if request.pretension is None:
        return found[:1]
    chosen = [one for one in found if one.group == f"{request.pretension:g} mm"]
    if not chosen:
        listed = ", ".join(one.group for one in found)
        raise SpecError(f"--pretension is {request.pretension:g} mm, the recording has steady segments at {listed}")
    return tuple(chosen)
