"""This is where a file becomes the records that `sinew identify` fits."""

from pathlib import Path
from typing import TYPE_CHECKING

from sinew.measure.errors import RecordingError, SpecError

if TYPE_CHECKING:
    import xarray as xr

    from sinew.identify.record import Excitation, Record

__all__ = ["recording_records", "table_record"]

_MOST_SEGMENTS = 12


def table_record(
    file: Path,
    time: str | None,
    given: str | None,
    output: str | None,
    excitation: "Excitation",
    rate_hz: float | None,
) -> "Record":
    """Return the record in a table. Columns "COL[:unit]"; rate_hz: of even samples, instead of a time column."""
    import numpy as np

    from sinew.identify.record import make_record
    from sinew.measure.table import find_columns, numbers, read_table
    from sinew.measure.timing import straighten_times
    from sinew.measure.units import canonical_unit, convert, unit_in_name

    if output is None or (time is None and rate_hz is None):
        missing = "--output COL" if output is None else "--time COL (or --rate HZ)"
        raise SpecError(f"{file.name} is a table: name its columns; {missing} is missing")
    table = read_table(file)

    def signal(spec: str) -> tuple["np.ndarray[tuple[int], np.dtype[np.float64]]", str]:
        names, stated = find_columns(table, spec)
        unit, factor = canonical_unit(stated or unit_in_name(names[0]) or "1")
        return np.mean([numbers(table, name) for name in names], axis=0) * factor, unit

    response, response_unit = signal(output)
    drive, drive_unit = (None, "1") if given is None else signal(given)
    if rate_hz is not None:
        if not 0 < rate_hz < float("inf"):
            raise SpecError(f"--rate is {rate_hz:g}, expected a positive number of samples per second")
        stamps = np.arange(response.size) / rate_hz
    else:
        names, stated = find_columns(table, str(time))
        stamps = numbers(table, names[0]) * convert(stated or unit_in_name(names[0]) or "s", "s")
        stamps = straighten_times(stamps).time_s
    return make_record(stamps, response, drive, excitation=excitation, output_unit=response_unit, input_unit=drive_unit)


def recording_records(
    recording: "xr.Dataset", excitation: "Excitation | None", pretension_mm: float | None
) -> list["Record"]:
    """Return the records in a recording: of an import its longest segment, of a rig the segments of one pretension.

    Of a rig, the steady segments of the first repeat, evenly thinned to twelve, under the lever's measured angle; where
    there are none, its ring-downs. Sensor delays are those of the recording's rig.
    """
    from sinew.analysis.torsion import drive_channel, response_channel
    from sinew.identify.record import make_record
    from sinew.measure.recording import iterate_segments

    response, drive = response_channel(recording), drive_channel(recording)
    rows = list(iterate_segments(recording))
    if recording.attrs.get("source") == "import":
        rows = [max(rows, key=lambda row: row[2].stop - row[2].start)]
    else:
        excitation = excitation or "lever"
        rows = _of_pretension(rows, pretension_mm)
    chosen = excitation or "none"
    delay = _delay(recording, float(rows[0][1].frequency_hz))
    return [
        make_record(
            recording["time_s"].values[where],
            response.values[where],
            None if chosen == "none" or drive is None else drive.values[where],
            excitation=chosen,
            output_unit=response.unit,
            input_unit="1" if drive is None else drive.unit,
            output_delay_s=delay,
            group=f"{segment.pretension_mm:g} mm",
        )
        for _, segment, where in rows
    ]


def _of_pretension(rows: list, pretension_mm: float | None) -> list:  # type: ignore[type-arg]
    levels = sorted({row[1].pretension_mm for row in rows})
    level = levels[0] if pretension_mm is None else min(levels, key=lambda one: abs(one - pretension_mm))
    if pretension_mm is not None and abs(level - pretension_mm) > 1e-6:
        listed = ", ".join(f"{one:g}" for one in levels)
        raise SpecError(f"--pretension is {pretension_mm:g} mm, the recording has {listed}")
    mine = [row for row in rows if row[1].pretension_mm == level]
    steady = [row for row in mine if row[1].kind == "steady" and row[1].repeat == 0]
    taken = steady or [row for row in mine if row[1].kind == "ring-down"]
    if not taken:
        raise RecordingError("the recording holds neither steady segments nor ring-downs; there is nothing to fit")
    step = max(1, -(-len(taken) // _MOST_SEGMENTS))
    return taken[::step]


def _delay(recording: "xr.Dataset", frequency_hz: float) -> float:
    """Return how much later the response's stamps are than the drive's [s], by the rig's delay budget."""
    from sinew.analysis.sensor import delay_budget, torsion_delay
    from sinew.plan.toml import parse_rig

    text = str(recording.attrs.get("rig", ""))
    if not text.strip():
        return 0.0
    budget = delay_budget(recording, parse_rig(text, source="the recording's rig"))
    return torsion_delay(budget, frequency_hz if frequency_hz > 0 else 3.0) - budget.drive_delay_s
