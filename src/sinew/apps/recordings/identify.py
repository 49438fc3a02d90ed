"""`sinew identify`: the mechanics of an oscillation from its recording."""

import re
import shlex
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

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
from sinew.measure.told import Table

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from sinew.identify.identified import Identified
    from sinew.identify.oscillator.record import Excitation, Record
    from sinew.identify.stepped.points import ResponsePoints
    from sinew.measure import timing
    from sinew.measure.files.csv import Table as CsvTable
    from sinew.measure.tasks import Spread

    Array = np.ndarray[tuple[int], np.dtype[np.float64]]

EXCITATIONS = ("force", "torque", "base", "lever", "none")
KINDS = ("samples", "stepped")


def identify(
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
    profile: Annotated[
        bool, flag("--profile", "Add intervals of the nonlinear numbers by profile likelihood.")
    ] = False,
    posterior: Annotated[
        bool, flag("--posterior", "Add the posterior by NUTS: minutes; needs the extra posterior.")
    ] = False,
    bootstrap: Annotated[
        int | None, option("N", "Of a rig's repeats: add intervals from N draws of them.", min=20)
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the draws of posterior and bootstrap.")] = 0,
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
    """Identify stiffness, damping law and nonlinearity, with intervals, and say which model the data support.

    Without --train and --test the fit is to all samples, and every fourth block of them is held out once to compare
    models. With --model auto the stiffness law and the damping law are chosen, or it says what cannot be told.
    Of a free decay the free part is found, unless --start, --stop, --train or --test choose one.
    Several files, or a folder (of runs, or of recordings), are a row each, by workers side by side, and --out takes
    the document of each as it comes; a file that tells nothing is a row that says why.

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
    if out is not None:
        console.require_folder(out)
    many = _recordings_in(files)
    spread = console.spread_of(scheduler, workers, keep)
    if many is None and (scheduler, workers, keep) != (None, 1, None):
        raise SpecError("--scheduler, --workers and --keep are for several files, or a folder; leave them out")
    asked = _Asked(
        file=files[0],
        time=time,
        input=input_,
        output=output,
        rate_hz=rate,
        excitation=cast("Excitation | None", excitation),
        model=model,
        start_s=start,
        stop_s=stop,
        gaps=console.checked_gaps(gaps),
        run=run,
        columns=columns,
        train=_range("--train", train),
        test=_range("--test", test),
        pretension_mm=pretension,
        rig=rig,
        profile=profile,
        posterior=posterior,
        bootstrap=bootstrap,
        seed=seed,
        kind=kind,
        frequency=frequency,
        phase=phase,
        chain=chain,
    )
    if many is not None:
        _identify_many([replace(asked, file=file) for file in many], spread, out, json=json)
        return
    found = _found(asked, console.progress_bar)
    written = ""
    if out is not None:
        with console.progress_bar("draw"):
            written = f"page: {_write(found, asked, out)}"
    console.print_result(found.document, found.told(), written, json=json)


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


def _identify_many(asked: "list[_Asked]", spread: "Spread", out: Path | None, *, json: bool) -> None:
    """Identify every file, and print a row for each; a document for each goes into the folder as it comes."""
    from sinew.measure.tasks import each_task

    tasks = [(replace(one, file=one.file.absolute()), _stamp(one.file)) for one in asked]
    documents: dict[int, dict[str, Any]] = {}
    with console.progress_bar("identify") as progress:
        for place, found in each_task(_one_of_many, tasks, spread, progress):
            documents[place] = {"file": str(asked[place].file), **found}
            if out is not None:
                name = (
                    asked[place].file.parent.name
                    if asked[place].file.name == "recording.nc"
                    else asked[place].file.stem
                )
                console.write_json(documents[place], out / f"{place + 1:04d}-{name}.json")
    rows = [documents[place] for place in range(len(asked))]
    sound = [row for row in rows if "refused" not in row]
    cells = [
        (row["file"], row["model"], *(shown(row[name]) for name in ("natural_frequency_hz", "damping_ratio")))
        for row in sound
    ]
    told: list[Table | str] = [Table(("file", "model", "natural frequency/Hz", "damping ratio"), cells)]
    told += [f"- {row['file']}: {row['refused']}" for row in rows if "refused" in row]
    document = {"identified": len(sound), "refused": len(rows) - len(sound), "files": rows}
    console.print_result(document, told, f"documents: {out}" if out is not None else "", json=json)


def _stamp(file: Path) -> tuple[int, int]:
    """Return what changes with a file, for what is kept of it: bytes and time of the last change; zeros of none."""
    try:
        found = file.stat()
    except OSError:
        return 0, 0
    return found.st_size, found.st_mtime_ns


def _one_of_many(task: "tuple[_Asked, tuple[int, int]]") -> dict[str, Any]:
    """Return the document of one file, or why there is none."""
    try:
        return _found(task[0], lambda _: nullcontext()).document
    except SinewError as refusal:
        return {"refused": str(refusal)}


@dataclass(frozen=True)
class _Asked:
    """What the command line asked for."""

    file: Path
    time: str | None
    input: str | None
    output: str | None
    rate_hz: float | None
    excitation: "Excitation | None"
    model: str
    start_s: float | None
    stop_s: float | None
    gaps: Literal["refuse", "split", "bridge"]
    run: str | None
    columns: str | None
    train: tuple[int, int] | None
    test: tuple[int, int] | None
    pretension_mm: float | None
    rig: str | None
    profile: bool
    posterior: bool
    bootstrap: int | None
    seed: int
    kind: str
    frequency: str | None
    phase: str | None
    chain: str | None

    def more(self) -> list[str]:
        """Return the options that ask for something to be added to the fit."""
        found = [name for name, given in (("--profile", self.profile), ("--posterior", self.posterior)) if given]
        found += ["--bootstrap", str(self.bootstrap)] if self.bootstrap is not None else []
        return [*found, "--seed", str(self.seed)] if self.posterior or self.bootstrap is not None else found

    def steps(self) -> dict[str, str | None]:
        """Return what was asked of steady states, by option."""
        kind = None if self.kind == "samples" else self.kind
        return {"--kind": kind, "--frequency": self.frequency, "--phase": self.phase, "--chain": self.chain}

    def about(self) -> str:
        """Return what was fitted, a sentence for the page."""
        shown = {"input": self.input, "output": self.output, "excitation": self.excitation}
        told = ", ".join(f"{name} {value}" for name, value in shown.items() if value is not None)
        return f"From {self.file.name}{f': {told}' if told else ''}."

    def command(self, out: Path) -> str:
        """Return the command line that makes all of it again."""
        options = {
            "--run": self.run,
            "--columns": self.columns,
            "--gaps": _said(self.gaps),
            "--time": self.time,
            "--rate": None if self.rate_hz is None else f"{self.rate_hz:g}",
            "--input": self.input,
            "--output": self.output,
            "--excitation": self.excitation,
            "--model": self.model,
            "--start": None if self.start_s is None else f"{self.start_s:.12g}",
            "--stop": None if self.stop_s is None else f"{self.stop_s:.12g}",
            "--train": None if self.train is None else f"{self.train[0]}:{self.train[1]}",
            "--test": None if self.test is None else f"{self.test[0]}:{self.test[1]}",
            "--pretension": None if self.pretension_mm is None else f"{self.pretension_mm:g}",
            "--rig": self.rig,
            **self.steps(),
        }
        words = [word for name, value in options.items() if value is not None for word in (name, value)]
        return shlex.join(["sinew", "identify", str(self.file), *words, *self.more(), "--out", str(out)])


def _said(gaps: str) -> str | None:
    """Return the word of --gaps, None where it is the default."""
    return None if gaps == "refuse" else gaps


def _range(flag: str, text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    found = re.fullmatch(r"(\d+):(\d+)", text.strip())
    if found is None:
        raise SpecError(f"{flag} is {text!r}, expected A:B, two sample indices (from 0, B not included)")
    return int(found[1]), int(found[2])


_Bar = Callable[[str], AbstractContextManager[console.Progress | None]]


def _found(asked: _Asked, bar: _Bar) -> "Identified":
    return _find_stepped(asked, bar) if asked.kind == "stepped" else _find(asked, bar)


def _find(asked: _Asked, bar: _Bar) -> "Identified":
    from sinew.measure.files.netcdf import load_recording
    from sinew.measure.read import is_recording

    for name, value in asked.steps().items():
        if value is not None:
            raise SpecError(f"{name} is for steady states; add --kind stepped, or leave it out")
    record: xr.Dataset | Record
    train, test = asked.train, asked.test
    with bar("models compared" if asked.model == "auto" else "fit") as progress:
        if is_recording(asked.file):
            refuse_columns(
                asked.time, asked.input, asked.output, asked.rate_hz, asked.run, asked.columns, _said(asked.gaps)
            )
            record = load_recording(asked.file)
        else:
            refuse_rig_options(asked.model, asked.pretension_mm, asked.rig, asked.bootstrap)
            if asked.excitation is None and asked.input is not None:
                raise SpecError(f"say what the input is: --excitation {'|'.join(EXCITATIONS[:-1])}")
            if asked.gaps != "refuse" and (train is not None or test is not None):
                what = "a part" if asked.gaps == "split" else "leaves some out"
                raise SpecError(
                    f"--train and --test choose samples, and --gaps {asked.gaps} {what}; leave one of them out"
                )
            judged = None if train is None else _hull(train, test)
            record = table_record(
                asked.file,
                asked.time,
                asked.input,
                asked.output,
                asked.excitation or "none",
                asked.rate_hz,
                stretch_s=(asked.start_s, asked.stop_s),
                samples=judged,
                gaps=asked.gaps,
                run=asked.run,
                columns=asked.columns,
            )
            if judged is not None and (judged[1] is None or record.size == judged[1] - judged[0]):
                train, test = _moved(train, judged[0]), _moved(test, judged[0])
        from sinew.identify.identified import identify as run  # JAX: seconds, behind the bar

        return run(
            record,
            asked.model,
            excitation=asked.excitation,
            pretension_mm=asked.pretension_mm,
            rig=asked.rig,
            start_s=asked.start_s,
            stop_s=asked.stop_s,
            train=train,
            test=test,
            profile=asked.profile,
            bootstrap=asked.bootstrap,
            posterior=asked.posterior,
            seed=asked.seed,
            progress=progress,
        )


def _hull(train: tuple[int, int], test: tuple[int, int] | None) -> tuple[int, int | None]:
    """Return the samples that matter: those of both ranges and between them; without a test all behind the first."""
    return (train[0], None) if test is None else (min(train[0], test[0]), max(train[1], test[1]))


def _moved(samples: tuple[int, int] | None, by: int) -> tuple[int, int] | None:
    return None if samples is None else (samples[0] - by, samples[1] - by)


def _find_stepped(asked: _Asked, bar: _Bar) -> "Identified":
    from sinew.identify.identified import identify as run
    from sinew.measure.read import is_recording

    given = {"--time": asked.time, "--rate": asked.rate_hz, "--train": asked.train, "--test": asked.test}
    given |= {
        "--start": asked.start_s,
        "--stop": asked.stop_s,
        "--gaps": _said(asked.gaps),
    }
    given |= dict.fromkeys(asked.more(), "")
    for name, value in given.items():
        if value is not None:
            raise SpecError(f"{name} is for samples over time, FILE holds steady states; leave it out")
    if asked.model == "tendon":
        raise SpecError("model tendon is fitted to samples of a rig's recording; leave --kind stepped out")
    chain = _chain(asked.chain)
    if is_recording(asked.file):
        of_table = (asked.input, asked.output, asked.frequency, asked.phase, asked.run, asked.columns)
        refuse_columns(*of_table)
        points = recording_points(asked.file, asked.excitation, asked.pretension_mm, asked.rig)
    else:
        refuse_rig_options(asked.model, asked.pretension_mm, asked.rig, None)
        points = table_points(
            asked.file,
            asked.frequency,
            asked.phase,
            asked.input,
            asked.output,
            asked.excitation,
            run=asked.run,
            columns=asked.columns,
        )
    with bar("models compared" if asked.model == "auto" else "fit") as progress:
        return run(points, asked.model, chain=chain, progress=progress)


def _chain(text: str | None) -> tuple[str, ...]:
    known = {"phase": ("phase",), "background": ("background_real", "background_imag")}
    parts = [] if text is None else [part.strip() for part in text.split(",")]
    for part in parts:
        if part not in known:
            raise SpecError(f"--chain holds {part!r}, expected phase, background or both: phase,background")
    return tuple(name for part in known if part in parts for name in known[part])


def _write(found: "Identified", asked: _Asked, out: Path) -> Path:
    """Write fit.json, figures and fit.html into a folder and return the path of the page."""
    from sinew.apps.recordings.stored import hash_file
    from sinew.figures.fit import draw_identified, write_fit_page
    from sinew.figures.style import save_figure
    from sinew.measure.files.netcdf import provenance

    paths = []
    for name, figure in draw_identified(found).items():
        paths += save_figure(figure, out / "figures", name, ("png", "pdf"))
    console.write_json(found.document, out / "fit.json")
    versions = str(provenance("import")["versions"])
    return write_fit_page(
        out,
        found.document,
        sentences=found.sentences,
        figures=paths,
        about=asked.about(),
        rebuild=asked.command(out),
        origins=[("file", str(asked.file)), ("SHA-256", hash_file(asked.file)), ("versions", versions)],
    )


# Files for it: the columns that its options name as a record, and steady states as points.


def refuse_columns(*given: object) -> None:
    """Raise SpecError where a recording was given columns."""
    if any(value is not None for value in given):
        raise SpecError(
            "a recording knows its columns and its gaps; --time, --input, --output, --frequency, --phase, --rate, "
            "--run, --columns and --gaps are for tables"
        )


def refuse_rig_options(model: str, pretension_mm: float | None, rig: str | None, bootstrap: int | None) -> None:
    """Raise SpecError where a table is asked what only the recording of a rig can answer."""
    if model == "tendon":
        raise SpecError("model tendon needs the recording of a rig (NetCDF), this is a table; choose cubic or auto")
    for name, value in (("--pretension", pretension_mm), ("--rig", rig)):
        if value is not None:
            raise SpecError(f"{name} is for the recording of a rig (NetCDF), this is a table; leave it out")
    if bootstrap is not None:
        raise SpecError("--bootstrap draws among repeats, this table is one record; leave it out, or try --profile")


def table_record(
    file: Path,
    time: str | None,
    given: str | None,
    output: str | None,
    excitation: "Excitation",
    rate_hz: float | None,
    *,
    stretch_s: tuple[float | None, float | None] = (None, None),
    samples: tuple[int, int | None] | None = None,
    gaps: "timing.Gaps" = "refuse",
    run: str | None = None,
    columns: str | None = None,
) -> "Record":
    """Return the record in a table. Columns "COL[:unit]"; rate_hz: of even samples, instead of a time column.

    stretch_s: from when to when, in the file's own time; samples: which of these, half open, the record is to hold.
    What lies outside is not looked at. gaps: where they split the record, its longest part is taken; in a free decay
    they may be bridged, for the simulation goes on through them. run, columns: as in
    `sinew.measure.files.csv.read_table`.
    """
    import numpy as np

    from sinew.identify.oscillator.record import make_record
    from sinew.measure.files.csv import read_stretch

    if gaps == "bridge" and given is not None:
        raise SpecError(
            "what the input did in a gap is not known, so it cannot be bridged; split the record there and take its "
            "longest part (--gaps split), or choose a part with --start and --stop"
        )
    found = read_stretch(
        file,
        {"output": output} | ({} if given is None else {"input": given}),
        time=time,
        rate_hz=rate_hz,
        run=run,
        columns=columns,
        start_s=stretch_s[0],
        stop_s=stretch_s[1],
        samples=samples,
        gaps=gaps,
    )
    timeline = found.timeline
    part = max(timeline.pieces, key=lambda piece: piece.stop - piece.start)
    stamps, response = timeline.time_s[part], found.values["output"][part]
    drive = None if given is None else found.values["input"][part]
    if drive is not None and np.array_equal(drive, response):
        raise SpecError(f"input and output are the same numbers ({given}); name the column of what drives the motion")
    record = make_record(
        stamps,
        response,
        drive,
        excitation=excitation,
        output_unit=found.units["output"],
        input_unit=found.units.get("input", "1"),
    )
    if gaps == "bridge" and timeline.diagnosis.gaps:
        _check_bridges(record)
    longest = f"the longest part, {stamps[0]:g} to {stamps[-1]:g} s, is taken"
    notes = [f"time: {note}" for note in timeline.notes] if timeline.changed else []
    told = (*found.notes, *notes, *((longest,) if len(timeline.pieces) > 1 else ()))
    return replace(record, notes=told, output_said=found.said["output"], input_said=found.said.get("input", ""))


def _check_bridges(record: "Record") -> None:
    """Raise TimeError where a gap is so long that the swings in it cannot be counted."""
    import numpy as np

    from sinew.identify.oscillator.start import dominant_omega

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

    from sinew.measure.files.csv import find_columns, numbers
    from sinew.measure.units import canonical_unit, unit_in_name

    names, stated = find_columns(table, spec)
    said = stated or unit_in_name(names[0]) or "1"
    unit, factor = canonical_unit(said)
    return np.mean([numbers(table, name) for name in names], axis=0) * factor, unit, said


def table_points(
    file: Path,
    frequency: str | None,
    phase: str | None,
    given: str | None,
    output: str | None,
    excitation: str | None,
    *,
    run: str | None = None,
    columns: str | None = None,
) -> tuple["ResponsePoints", ...]:
    """Return the points in a table of steady states. Columns "COL[:unit]"."""
    from sinew.identify.stepped.points import points_of_table
    from sinew.measure.files.csv import find_columns, numbers, read_table

    if given is None or output is None:
        missing = "--output COL" if output is None else "--input COL"
        raise SpecError(f"{file.name} holds steady states: name its columns of amplitudes; {missing} is missing")
    if excitation in (None, "none"):
        raise SpecError("say what the input is: --excitation force|torque|base|lever")
    table = read_table(file, run=run, columns=columns)
    names, stated = find_columns(table, frequency or "frequency_hz")
    if (stated or "Hz").lower() != "hz":
        raise SpecError(f"--frequency is in {stated}, expected Hz")
    angle, angle_unit, _ = _column(table, phase or "phase_deg")
    if angle_unit not in ("rad", "1"):
        raise SpecError(f"--phase is in {angle_unit}, expected degrees or radians: COL:deg or COL:rad")
    response, response_unit, output_said = _column(table, output)
    drive, drive_unit, input_said = _column(table, given)
    points = points_of_table(
        numbers(table, names[0]),
        response,
        angle,
        drive,
        excitation=cast("Excitation", excitation),
        output_unit=response_unit,
        input_unit=drive_unit,
    )
    return tuple(replace(one, output_said=output_said, input_said=input_said) for one in points)


def recording_points(
    file: Path, excitation: str | None, pretension_mm: float | None, rig: str | None
) -> tuple["ResponsePoints", ...]:
    """Return the points of a rig's recording at one pretension, else its smallest, in one group."""
    from sinew.analysis.analysed import recording_rig
    from sinew.analysis.sweep.response import estimate_response
    from sinew.identify.stepped.points import points_of_response
    from sinew.measure.files.netcdf import load_recording

    recording = load_recording(file)
    if recording.attrs.get("source") == "import":
        raise SpecError(
            "this recording was imported; give a table of its steady states, one row each with frequency_hz, "
            "amplitude, phase_deg and the drive's amplitude"
        )
    if excitation not in (None, "lever"):
        raise SpecError(f"--excitation is {excitation}, but a rig is driven by its lever; leave it out")
    found = points_of_response(estimate_response(recording, recording_rig(recording, rig)))
    if pretension_mm is None:
        return found[:1]
    chosen = [one for one in found if one.group == f"{pretension_mm:g} mm"]
    if not chosen:
        listed = ", ".join(one.group for one in found)
        raise SpecError(f"--pretension is {pretension_mm:g} mm, the recording has steady segments at {listed}")
    return tuple(chosen)
