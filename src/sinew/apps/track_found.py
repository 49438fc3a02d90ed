"""This is where what tracking found is told: points of the backbone, how well the phase was held, how well followed."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sinew.apps.console import print_table, write_json
from sinew.measure.estimate import fixed, number, pair, shown

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from sinew.analysis.tracked import TrackedPoint
    from sinew.plan.plan import Plan
    from sinew.plan.rig import RigSpec
    from sinew.tune.expected import ExpectedBackbone

__all__ = ["found_tracks", "print_found", "write_found"]

_DIGITS = {"time_s": 4, "frequency_hz": 5, "phase_error_deg": 3, "lever_deg": 3, "torsion_deg": 3, "pretension_mm": 3}


def found_tracks(
    document: dict[str, Any], plan: "Plan", rig: "RigSpec", expected: "Sequence[ExpectedBackbone]"
) -> dict[str, Any]:
    """Return what the recording that a run's document names says of every tracked motion, as JSON holds it."""
    import numpy as np

    from sinew.analysis.tracked import tracked_turns
    from sinew.measure.netcdf import load_recording

    laws, tracks = document.pop("laws"), []
    if document["recording"] is not None and laws:
        recording = load_recording(Path(document["recording"]))
        segments = np.flatnonzero(recording["kind"].values == "tracking")
        for segment, law in zip(segments.tolist(), laws, strict=False):
            turns = tracked_turns(recording, segment, rig)
            amplitude = float(recording["amplitude_deg"].values[segment])
            columns = {str(name): turns[name].values for name in turns}
            for name in ("phase_error", "lever", "torsion"):
                columns[f"{name}_deg"] = np.degrees(columns.pop(f"{name}_rad"))
            track: dict[str, Any] = {
                "pretension_mm": float(recording["pretension_mm"].values[segment]),
                "amplitude_deg": amplitude,
                "lock_cycles": law["lock_cycles"],
                "lock_losses": law["lock_losses"],
                "phase_error_deg": _held_error(columns, law["lock_cycles"]),
                "point": None,
                "follow": None,
            }
            if plan.track is not None and plan.track.pretension_to_mm is None:
                track["point"] = _point(turns, rig, expected)
            elif plan.track is not None and plan.track.wanted_hz is not None:
                track["follow"] = _followed(columns, plan)
            track["turns"] = {name: np.round(columns[name], digits).tolist() for name, digits in _DIGITS.items()}
            tracks.append(track)
    held = plan.track.held if plan.track is not None else None
    return {"held": held, "expected": [_expected(one) for one in expected], "tracks": tracks}


def _held_error(columns: "dict[str, NDArray[np.float64]]", lock_cycles: float | None) -> float | None:
    """Return the root mean square of the phase error from the lock on [deg]; the lock itself counts two turns more."""
    import numpy as np

    if lock_cycles is None:
        return None
    held = columns["phase_error_deg"][int(lock_cycles) + 2 :]
    return float(np.sqrt(np.mean(held**2))) if held.size else None


def _point(turns: Any, rig: "RigSpec", expected: "Sequence[ExpectedBackbone]") -> dict[str, Any] | None:
    import math

    from sinew.analysis.tracked import tracked_point
    from sinew.measure.errors import RecordingError

    try:
        point = tracked_point(turns, rig)
    except RecordingError:
        return None
    near = min(expected, key=lambda one: abs(one.pretension_mm - point.pretension_mm))
    predicted = near.frequency_at(math.radians(point.torsion_deg.value))
    return _point_document(point) | {"predicted_hz": predicted if math.isfinite(predicted) else None}


def _point_document(point: "TrackedPoint") -> dict[str, Any]:
    return {
        "pretension_mm": point.pretension_mm,
        "frequency_hz": point.frequency_hz.to_json(),
        "torsion_deg": point.torsion_deg.to_json(),
        "lever_deg": point.lever_deg.to_json(),
        "damping_ratio": point.damping_ratio.to_json(),
        "phase_error_deg": point.phase_error_deg,
        "turns": point.turns,
    }


def _followed(columns: "dict[str, NDArray[np.float64]]", plan: "Plan") -> dict[str, float]:
    """Return how far the resonance was from the wanted frequency while that moved."""
    import numpy as np

    track = plan.track
    assert track is not None
    assert track.wanted_hz is not None
    times = (track.lead_s, track.lead_s + track.duration_s)
    time, hertz = columns["time_s"], columns["frequency_hz"]
    moving = (time >= times[0]) & (time <= times[1])
    off = (hertz - np.interp(time, times, track.wanted_hz))[moving]
    return {
        "from_hz": track.wanted_hz[0],
        "to_hz": track.wanted_hz[1],
        "begin_s": track.lead_s,
        "duration_s": track.duration_s,
        "rms_error_hz": float(np.sqrt(np.mean(off**2))),
        "largest_error_hz": float(np.abs(off).max()),
    }


def _expected(one: "ExpectedBackbone") -> dict[str, Any]:
    import numpy as np

    return {
        "pretension_mm": one.pretension_mm,
        "frequency_hz": one.frequency_hz.tolist(),
        "torsion_deg": np.degrees(one.torsion).tolist(),
        "lever_deg": np.degrees(one.lever).tolist(),
        "command_deg": np.degrees(one.command).tolist(),
        "damping_ratio": one.damping_ratio.tolist(),
    }


def write_found(document: dict[str, Any], expected: "Sequence[ExpectedBackbone]", folder: Path) -> None:
    """Write track.json, and the figure of the tracked motions where there is one."""
    if not document["tracks"]:
        return
    from sinew.figures.style import save_figure
    from sinew.figures.tracking import draw_tracking

    save_figure(draw_tracking(document["tracks"], document["expected"]), folder, "tracking", ("png", "pdf"))
    write_json(document, folder / "track.json")


def print_found(document: dict[str, Any]) -> None:
    """Print how the run ended, and what was found."""
    done = f"; {document['groups_done']} of {document['groups']} groups are recorded"
    print(f"{document['ended']}{'' if document['complete'] else done}")
    print(document["left"])
    tracks = document["tracks"]
    if any(track["point"] is not None for track in tracks):
        columns = (
            "pretension/mm",
            "held/°",
            "resonance/Hz",
            "predicted/Hz",
            "torsion/°",
            "lever/°",
            "damping",
            "lock/turns",
            "error/°",
        )
        rows = [_row(track) for track in tracks if track["point"] is not None]
        print_table(columns, rows, f"the torsion lags the lever by 90°; amplitude held: {document['held']}")
    for track in tracks:
        if track["point"] is None:
            print(_moved(track))
    print(document["recording"] or "no group is whole, so there is no recording")


def _row(track: dict[str, Any]) -> tuple[str, ...]:
    point = track["point"]
    half = 0.5 * (point["frequency_hz"]["interval90"][1] - point["frequency_hz"]["interval90"][0])
    predicted = point["predicted_hz"]
    return (
        f"{track['pretension_mm']:g}",
        f"{track['amplitude_deg']:g}",
        pair(point["frequency_hz"]["value"], half),
        number(predicted),
        *(shown(point[name]) for name in ("torsion_deg", "lever_deg", "damping_ratio")),
        fixed(track["lock_cycles"], 1),
        number(point["phase_error_deg"], 2),
    )


def _moved(track: dict[str, Any]) -> str:
    turns = track["turns"]
    lock = "never locked" if track["lock_cycles"] is None else f"locked after {fixed(track['lock_cycles'], 1)} turns"
    lost = f"lost {track['lock_losses']:.0f} times" if track["lock_losses"] else "never lost"
    error = (
        ""
        if track["phase_error_deg"] is None
        else f", phase error {number(track['phase_error_deg'], 2)}° (root mean square)"
    )
    way = (
        f"{number(turns['pretension_mm'][0], 3)} to {number(turns['pretension_mm'][-1], 3)} mm, "
        f"{number(turns['frequency_hz'][0])} to {number(turns['frequency_hz'][-1])} Hz"
    )
    follow = track["follow"]
    after = (
        ""
        if follow is None
        else (
            f"; followed {follow['from_hz']:g} to {follow['to_hz']:g} Hz in {follow['duration_s']:g} s to within "
            f"{number(follow['rms_error_hz'], 2)} Hz (root mean square), "
            f"{number(follow['largest_error_hz'], 2)} Hz at most"
        )
    )
    return f"{way}: {lock}, {lost}{error}{after}"
