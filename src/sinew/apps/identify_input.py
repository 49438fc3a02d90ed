"""This is where a file becomes the records that `sinew identify` fits."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from sinew.measure.errors import RecordingError, SpecError

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from sinew.identify.oscillator.record import Excitation, Record
    from sinew.measure.recording import Segment
    from sinew.measure.timing import Timeline
    from sinew.plan.rig import RigSpec

    Row = tuple[int, Segment, slice]

_MOST_SEGMENTS = 9
_MOST_REPEATED = 4
_RATE_OFF = 0.01  # of the rate: how far the stamps' own may be from the one that was given
_HDF5, _CLASSIC = b"\x89HDF", b"CDF"


def is_recording(file: Path) -> bool:
    """Return whether a file is to be read as a recording of Sinew: by its name, else by its first bytes."""
    if file.suffix == ".nc":
        return True
    if not file.is_file():
        return False
    try:
        with file.open("rb") as opened:
            head = opened.read(4)
    except OSError:
        return False  # the reader of tables says why
    return head == _HDF5 or head[:3] == _CLASSIC


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


def joint_rig(recording: "xr.Dataset", rig: str | None) -> "RigSpec":
    """Return the rig that model tendon begins with: the one that was named, else the recording's.

    Raises SpecError where there is none.
    """
    from sinew.analysis.analysed import recording_rig

    found = recording_rig(recording, rig)
    if found is None:
        raise SpecError("model tendon needs a rig and the recording names none; give one with --rig")
    return found


def unit_remarks(record: "Record") -> tuple[str, ...]:
    """Return what is odd about the units of a record, a sentence each.

    Raises SpecError where the input cannot be what it is said to be.
    """
    unit, kind = record.input_unit, record.excitation
    if kind in ("base", "lever") and unit in _EFFORTS:
        raise SpecError(
            f"the input is in {unit}, which is no motion, but the excitation is {kind}; choose force or torque, or "
            "name the column of the motion"
        )
    if kind in ("force", "torque") and unit in ("rad", "m", "rad/s", "m/s"):
        return (f"the input is in {unit}, which is no {kind}: is it the motion of a base or a lever?",)
    other = {"force": "N*m", "torque": "N"}.get(kind)
    if unit == other:
        return (f"the input is in {unit}, which is no {kind}; it was taken as {_EFFORTS[unit]}",)
    return ()


_EFFORTS = {"N": "a force", "N*m": "a torque"}


def table_record(
    file: Path,
    time: str | None,
    given: str | None,
    output: str | None,
    excitation: "Excitation",
    rate_hz: float | None,
) -> "Record":
    """Return the record in a table. Columns "COL[:unit]"; rate_hz: of even samples, instead of a time column."""
    try:
        return _read(file, time, given, output, excitation, rate_hz)
    except RecordingError as error:  # the hints of the readers name the options of other commands
        said = str(error)
        for theirs, ours in _HINTS.items():
            said = said.replace(theirs, ours)
        raise type(error)(said) from error


def _read(
    file: Path,
    time: str | None,
    given: str | None,
    output: str | None,
    excitation: "Excitation",
    rate_hz: float | None,
) -> "Record":
    import numpy as np

    from sinew.identify.oscillator.record import make_record
    from sinew.measure.table import find_columns, numbers, read_table
    from sinew.measure.timing import straighten_times
    from sinew.measure.units import canonical_unit, convert, unit_in_name

    if output is None or (time is None and rate_hz is None):
        missing = "--output COL" if output is None else "--time COL (or --rate HZ)"
        raise SpecError(f"{file.name} is a table: name its columns; {missing} is missing")
    table = read_table(file)
    notes: tuple[str, ...] = ()

    def signal(spec: str) -> tuple["np.ndarray[tuple[int], np.dtype[np.float64]]", str]:
        names, stated = find_columns(table, spec)
        unit, factor = canonical_unit(stated or unit_in_name(names[0]) or "1")
        return np.mean([numbers(table, name) for name in names], axis=0) * factor, unit

    response, response_unit = signal(output)
    drive, drive_unit = (None, "1") if given is None else signal(given)
    if rate_hz is not None and not 0 < rate_hz < float("inf"):
        raise SpecError(f"--rate is {rate_hz:g}, expected a positive number of samples per second")
    if time is None:
        stamps = np.arange(response.size) / float(rate_hz or 1.0)
    else:
        names, stated = find_columns(table, time)
        stamps = numbers(table, names[0]) * convert(stated or unit_in_name(names[0]) or "s", "s")
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


def _mended(timeline: "Timeline", stamps: "np.ndarray[tuple[int], np.dtype[np.float64]]") -> tuple[str, ...]:
    """Return what was done about the time stamps; nothing where they were kept as they are."""
    kept = timeline.time_s.size == stamps.size and bool((timeline.time_s == stamps).all())
    return () if kept else tuple(f"time: {note}" for note in timeline.notes)


_HINTS = {
    "select one side of it with start and stop (--start, --stop), or split the record at its gaps (--gaps split)": (
        "put each side of it into a file of its own and identify one"
    ),
    ", or select the rows without them by start and stop": "",
}


def recording_records(
    recording: "xr.Dataset",
    excitation: "Excitation | None",
    pretension_mm: float | None,
    *,
    repeats: bool = False,
) -> list["Record"]:
    """Return the records in a recording: of an import its longest segment, of a rig the segments of one pretension.

    Of a rig, the steady segments of the first repeat, evenly thinned to nine, under the lever's measured angle; where
    there are none, its ring-downs. With repeats, four frequencies in all their repeats, grouped by frequency. Sensor
    delays are those of the recording's rig.
    """
    from sinew.analysis.signal.torsion import drive_channel, response_channel
    from sinew.identify.oscillator.record import make_record
    from sinew.measure.recording import iterate_segments

    response, drive = response_channel(recording), drive_channel(recording)
    rows = list(iterate_segments(recording))
    if recording.attrs.get("source") == "import":
        if pretension_mm is not None or repeats:
            option = "--bootstrap" if repeats else "--pretension"
            raise SpecError(f"{option} is for the recording of a rig; this one was imported; leave it out")
        if excitation is None and drive is not None:
            raise SpecError("the recording has a drive; say what it is: --excitation force|torque|base|lever, or none")
        rows = [max(rows, key=lambda row: row[2].stop - row[2].start)]
    else:
        excitation = excitation or "lever"
        rows = _of_pretension(rows, pretension_mm, repeats=repeats)
    chosen = excitation or "none"
    delay = _delay(recording, float(rows[0][1].frequency_hz))
    return [
        make_record(
            recording["time_s"].values[where],
            response.values[where],
            None if chosen == "none" or drive is None else drive.values[where],
            excitation=chosen,
            output_unit=response.unit,
            input_unit="1" if chosen == "none" or drive is None else drive.unit,
            output_delay_s=delay,
            group=_group(segment, repeats=repeats),
        )
        for _, segment, where in rows
    ]


def _group(segment: "Segment", *, repeats: bool) -> str:
    pretension = f"{segment.pretension_mm:g} mm"
    return f"{pretension}, {segment.frequency_hz:.3g} Hz" if repeats and segment.kind == "steady" else pretension


def _of_pretension(rows: list["Row"], pretension_mm: float | None, *, repeats: bool) -> list["Row"]:
    levels = sorted({row[1].pretension_mm for row in rows})
    level = levels[0] if pretension_mm is None else min(levels, key=lambda one: abs(one - pretension_mm))
    if pretension_mm is not None and abs(level - pretension_mm) > 1e-6:
        listed = ", ".join(f"{one:g}" for one in levels)
        raise SpecError(f"--pretension is {pretension_mm:g} mm, the recording has {listed}")
    mine = [row for row in rows if row[1].pretension_mm == level]
    steady = [row for row in mine if row[1].kind == "steady"]
    decays = [row for row in mine if row[1].kind == "ring-down"]
    if not steady and not decays:
        raise RecordingError("the recording holds neither steady segments nor ring-downs; there is nothing to fit")
    if repeats:
        return _repeated(steady or decays)
    taken = [row for row in steady if row[1].repeat == steady[0][1].repeat] or decays
    step = max(1, -(-len(taken) // _MOST_SEGMENTS))
    return taken[::step]


def _repeated(rows: list["Row"]) -> list["Row"]:
    """Return the segments of at most four frequencies that were repeated, in all their repeats."""
    found: dict[float, list[Row]] = {}
    for row in rows:
        found.setdefault(float(row[1].frequency_hz) if row[1].kind == "steady" else 0.0, []).append(row)
    often = [found[frequency] for frequency in sorted(found) if len(found[frequency]) > 1]
    if not often:
        raise SpecError("--bootstrap draws among repeats, and this recording repeats nothing; leave it out")
    step = max(1, -(-len(often) // _MOST_REPEATED))
    return [row for group in often[::step] for row in group]


def _delay(recording: "xr.Dataset", frequency_hz: float) -> float:
    """Return how much later the response's stamps are than the drive's [s], by the rig's delay budget."""
    from sinew.analysis.signal.sensor import delay_budget, torsion_delay
    from sinew.plan.toml import parse_rig

    text = str(recording.attrs.get("rig", ""))
    if not text.strip():
        return 0.0
    budget = delay_budget(recording, parse_rig(text, source="the recording's rig"))
    return torsion_delay(budget, frequency_hz if frequency_hz > 0 else 3.0) - budget.drive_delay_s
