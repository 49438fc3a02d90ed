"""Files for `sinew identify`: the columns that its options name as a record, and steady states as points."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

from sinew.measure.errors import SpecError, TimeError

if TYPE_CHECKING:
    import numpy as np

    from sinew.identify.oscillator.record import Excitation, Record
    from sinew.identify.stepped.points import ResponsePoints
    from sinew.measure.files.csv import Table
    from sinew.measure.timing import Gaps

    Array = np.ndarray[tuple[int], np.dtype[np.float64]]


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
    gaps: "Gaps" = "refuse",
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


def _column(table: "Table", spec: str) -> "tuple[Array, str, str]":
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
