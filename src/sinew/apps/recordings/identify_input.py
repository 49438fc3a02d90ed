"""Files for `sinew identify`: the columns that its options name as a record, and steady states as points."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

from sinew.measure.errors import RecordingError, SpecError

if TYPE_CHECKING:
    import numpy as np

    from sinew.identify.oscillator.record import Excitation, Record
    from sinew.identify.stepped.points import ResponsePoints
    from sinew.measure.files.csv import Table
    from sinew.measure.timing import Timeline

    Array = np.ndarray[tuple[int], np.dtype[np.float64]]

_RATE_OFF = 0.01  # of the rate: how far the stamps' own may be from the one that was given


def refuse_columns(*given: object) -> None:
    """Raise SpecError where a recording was given columns."""
    if any(value is not None for value in given):
        raise SpecError("a recording knows its columns; --time, --input, --output and --rate are for tables")


def refuse_rig_options(model: str, pretension_mm: float | None, rig: str | None, bootstrap: int | None) -> None:
    """Raise SpecError where a table is asked what only the recording of a rig can answer."""
    if model == "tendon":
        raise SpecError("model tendon needs the recording of a rig (NetCDF), this is a table; choose cubic or auto")
    for name, value in (("--pretension", pretension_mm), ("--rig", rig)):
        if value is not None:
            raise SpecError(f"{name} is for the recording of a rig (NetCDF), this is a table; leave it out")
    if bootstrap is not None:
        raise SpecError("--bootstrap draws among repeats, this table is one record; leave it out, or try --profile")


_HINTS = {
    "select one side of it with start and stop (--start, --stop), or split the record at its gaps (--gaps split)": (
        "select one side of it with --start and --stop"
    ),
    ", or select the rows without them by start and stop": "",
}


@contextmanager
def _in_own_words() -> Iterator[None]:
    """Have errors hint at the options of this command: the readers name those of others."""
    try:
        yield
    except RecordingError as error:
        said = str(error)
        for theirs, ours in _HINTS.items():
            said = said.replace(theirs, ours)
        raise type(error)(said) from error


@_in_own_words()
def table_record(
    file: Path,
    time: str | None,
    given: str | None,
    output: str | None,
    excitation: "Excitation",
    rate_hz: float | None,
    *,
    stretch_s: tuple[float | None, float | None] = (None, None),
) -> "Record":
    """Return the record in a table. Columns "COL[:unit]"; rate_hz: of even samples, instead of a time column.

    stretch_s: from when to when, in the file's own time; what lies outside is not looked at.
    """
    import numpy as np

    from sinew.identify.oscillator.record import make_record
    from sinew.measure.files.csv import find_columns, numbers, read_table
    from sinew.measure.timing import choose_stretch, straighten_times
    from sinew.measure.units import convert, unit_in_name

    if output is None or (time is None and rate_hz is None):
        missing = "--output COL" if output is None else "--time COL (or --rate HZ)"
        raise SpecError(f"{file.name} is a table: name its columns; {missing} is missing")
    table = read_table(file)
    notes: tuple[str, ...] = ()
    response, response_unit = _column(table, output)
    drive, drive_unit = (None, "1") if given is None else _column(table, given)
    if rate_hz is not None and not 0 < rate_hz < float("inf"):
        raise SpecError(f"--rate is {rate_hz:g}, expected a positive number of samples per second")
    if time is None:
        stamps = np.arange(response.size) / float(rate_hz or 1.0)
    else:
        names, stated = find_columns(table, time)
        stamps = numbers(table, names[0]) * convert(stated or unit_in_name(names[0]) or "s", "s")
    if stretch_s != (None, None):
        inside = choose_stretch(stamps, *stretch_s)
        stamps, response = stamps[inside], response[inside]
        drive = None if drive is None else drive[inside]
    if time is not None:
        timeline = straighten_times(stamps)
        notes = _mended(timeline, stamps)
        stamps = timeline.time_s
        own = 1.0 / float(np.median(np.diff(stamps)))
        if rate_hz is not None and abs(rate_hz / own - 1.0) > _RATE_OFF:
            raise SpecError(
                f"--rate is {rate_hz:g} Hz, the time stamps in {names[0]!r} are {own:.6g} Hz apart; give one of the two"
            )
    if drive is not None and np.array_equal(drive, response):
        raise SpecError(f"input and output are the same numbers ({given}); name the column of what drives the motion")
    record = make_record(
        stamps, response, drive, excitation=excitation, output_unit=response_unit, input_unit=drive_unit
    )
    return replace(record, notes=notes)


def _column(table: "Table", spec: str) -> "tuple[Array, str]":
    """Return a column, or the mean of several, in the SI unit that comes with it."""
    import numpy as np

    from sinew.measure.files.csv import find_columns, numbers
    from sinew.measure.units import canonical_unit, unit_in_name

    names, stated = find_columns(table, spec)
    unit, factor = canonical_unit(stated or unit_in_name(names[0]) or "1")
    return np.mean([numbers(table, name) for name in names], axis=0) * factor, unit


def table_points(
    file: Path, frequency: str | None, phase: str | None, given: str | None, output: str | None, excitation: str | None
) -> tuple["ResponsePoints", ...]:
    """Return the points in a table of steady states. Columns "COL[:unit]"."""
    from sinew.identify.stepped.points import points_of_table
    from sinew.measure.files.csv import find_columns, numbers, read_table

    if given is None or output is None:
        missing = "--output COL" if output is None else "--input COL"
        raise SpecError(f"{file.name} holds steady states: name its columns of amplitudes; {missing} is missing")
    if excitation in (None, "none"):
        raise SpecError("say what the input is: --excitation force|torque|base|lever")
    table = read_table(file)
    names, stated = find_columns(table, frequency or "frequency_hz")
    if (stated or "Hz").lower() != "hz":
        raise SpecError(f"--frequency is in {stated}, expected Hz")
    angle, angle_unit = _column(table, phase or "phase_deg")
    if angle_unit not in ("rad", "1"):
        raise SpecError(f"--phase is in {angle_unit}, expected degrees or radians: COL:deg or COL:rad")
    response, response_unit = _column(table, output)
    drive, drive_unit = _column(table, given)
    return points_of_table(
        numbers(table, names[0]),
        response,
        angle,
        drive,
        excitation=cast("Excitation", excitation),
        output_unit=response_unit,
        input_unit=drive_unit,
    )


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


def _mended(timeline: "Timeline", stamps: "np.ndarray[tuple[int], np.dtype[np.float64]]") -> tuple[str, ...]:
    """Return what was done about the time stamps; nothing where they were kept as they are."""
    kept = timeline.time_s.size == stamps.size and bool((timeline.time_s == stamps).all())
    return () if kept else tuple(f"time: {note}" for note in timeline.notes)
