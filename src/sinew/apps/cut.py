"""This is where an imported recording is cut to the stretch of time that the user names."""

import math
from typing import TYPE_CHECKING

from sinew.measure.errors import SpecError, TimeError

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["cut_recording"]


def cut_recording(recording: "xr.Dataset", start_s: float | None, stop_s: float | None) -> "xr.Dataset":
    """Return the samples of an imported recording from start_s to stop_s, both included [s]; None leaves an end open.

    The times are those of the recording, as in the file it came from. Segments without a sample left are dropped, and
    `import_notes` tells of the cut. Raises SpecError for a recording that was not imported, whose segments mean
    something, and TimeError where start is not before stop or nothing is left.
    """
    if start_s is None and stop_s is None:
        return recording
    import numpy as np

    from sinew.measure.recording import segment_slices
    from sinew.measure.schema import validate_recording

    if recording.attrs.get("source") != "import":
        raise SpecError(
            "--start and --stop choose a stretch of a CSV file or of an imported recording; this one is a campaign "
            "whose segments are analysed whole; leave them out"
        )
    start, stop = (-math.inf if start_s is None else start_s), (math.inf if stop_s is None else stop_s)
    if not start < stop:
        raise TimeError(f"found start {start:g} s and stop {stop:g} s, expected start before stop")
    time = recording["time_s"].values
    kept = (time >= start) & (time <= stop)
    if not kept.any():
        raise TimeError(
            f"no samples from {start:g} s to {stop:g} s; the recording runs from {time.min():g} s to {time.max():g} s"
        )
    sizes = np.array([int(kept[where].sum()) for where in segment_slices(recording)], dtype=np.int64)
    cut = recording.isel(sample=np.flatnonzero(kept), segment=np.flatnonzero(sizes))
    cut["row_size"] = ("segment", sizes[sizes > 0], recording["row_size"].attrs)
    note = f"cut to {time[kept].min():g} to {time[kept].max():g} s"
    told = str(recording.attrs.get("import_notes", ""))
    cut.attrs = {k: v for k, v in recording.attrs.items() if k != "content_hash"} | {
        "import_notes": f"{told}\n{note}" if told else note
    }
    return validate_recording(cut)
