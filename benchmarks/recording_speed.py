"""Time to make, save and analyse the paper's campaign, beside what one writes by hand.

The analysis is timed as `sinew analyse` makes it: in a process of one thread that has simulated nothing, and shares the
ring-downs with a copy of itself; beside it, as a notebook that holds JAX makes it, alone.

Peers in the same run: xarray's own `to_netcdf` without checks or a whole-file replacement, and scipy's least
squares of a sine of the commanded frequency on each steady segment, which says nothing of errors, damping or quality.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.linalg import lstsq

from sinew.analysis.analysed import analyse_recording, recording_rig
from sinew.measure.files.netcdf import load_recording, save_recording
from sinew.plan.toml import load_plan, load_rig
from sinew.solve.programs import use_all_cores
from sinew.twin.simulate import simulate


def _seconds(work: Callable[[], Any]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def _by_hand(recording: xr.Dataset) -> None:
    """Fit a sine to the gyroscope and the lever in each steady segment."""
    ends = np.cumsum(recording["row_size"].values)
    for i in np.flatnonzero(recording["kind"].values == "steady"):
        part = slice(int(ends[i] - recording["row_size"].values[i]), int(ends[i]))
        turn = 2 * np.pi * float(recording["frequency_hz"].values[i]) * recording["time_s"].values[part]
        columns = np.stack([np.ones_like(turn), np.cos(turn), np.sin(turn)], axis=1)
        lstsq(columns, recording["gyro_rad_s"].values[part, 2])
        lstsq(columns, recording["drive_rad"].values[part])


def analysis(path: str | Path) -> float:
    """Return how long the analysis of a recording takes, once it is loaded [s]."""
    recording = load_recording(path)
    rig = recording_rig(recording, None)
    return min(_seconds(lambda: analyse_recording(recording, rig)) for _ in range(3))


def _analysis_in_a_new_process(path: Path) -> float:
    code = "import sys; from benchmarks.recording_speed import analysis; print(analysis(sys.argv[1]))"
    return float(subprocess.run([sys.executable, "-c", code, path], check=True, capture_output=True, text=True).stdout)


def main() -> None:
    """Print seconds of simulation, of saving and of analysis."""
    use_all_cores()
    plan, rig = load_plan("paper"), load_rig("paper")
    made: list[xr.Dataset] = []
    first, again = (_seconds(lambda: made.append(simulate(plan, rig, seed=0))) for _ in range(2))
    recording = made[-1]
    size, segments = recording.sizes["sample"], recording.sizes["segment"]
    print(f"the paper's campaign, {size / 1e6:.2f} M samples in {segments} segments")
    print(f"  simulate                {first:6.2f} s at first, then {again:.2f} s")
    with tempfile.TemporaryDirectory() as folder:
        ours = min(_seconds(lambda: save_recording(recording, Path(folder) / "ours.nc")) for _ in range(3))
        theirs = min(_seconds(lambda: recording.to_netcdf(Path(folder) / "theirs.nc")) for _ in range(3))
        alone, command = analysis(Path(folder) / "ours.nc"), _analysis_in_a_new_process(Path(folder) / "ours.nc")
        sizes = [(Path(folder) / name).stat().st_size / 1e6 for name in ("ours.nc", "theirs.nc")]
    print(
        f"  save, checked, atomic   {ours:6.2f} s (wanted: at most 0.3), {sizes[0]:.0f} MB; "
        f"xarray alone {theirs:.2f} s, {sizes[1]:.0f} MB"
    )
    hand = _seconds(lambda: _by_hand(recording))
    print(
        f"  analyse all of it       {command:6.2f} s (wanted: at most 0.6); alone {alone:.2f} s; "
        f"two sines per segment by scipy {hand:.2f} s"
    )


if __name__ == "__main__":
    main()
