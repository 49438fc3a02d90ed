"""`sinew gait`: what a torso joint has to do, from recordings of walking or from numbers."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sinew.apps import console
from sinew.apps.console import Json, Start, Stop, option
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import Estimate, finite, fixed, number, shown_interval

if TYPE_CHECKING:
    from sinew.tune.gait import BoutGait, GaitTarget

_FASTEST_HZ = 20.0  # of a stride; nobody walks or runs at a fifth of it


def gait(
    files: Annotated[
        list[Path] | None, typer.Argument(metavar="FILE...", help="Recordings of walking: CSV, or npz of NumPy.")
    ] = None,
    pelvis: Annotated[str | None, option("NAME|LEFT,RIGHT", "Sensor or pair of markers on the pelvis.")] = None,
    trunk: Annotated[str | None, option("NAME|LEFT,RIGHT", "The same on the trunk or shoulders.")] = None,
    yaw: Annotated[str | None, option("COL[:unit]", "Instead: a column of trunk against pelvis.")] = None,
    time: Annotated[str | None, option("COL[:unit]", "Column of the time stamps.")] = None,
    start: Start = None,
    stop: Stop = None,
    up: Annotated[str, option("x|y|z", "The markers' upward axis.")] = "z",
    gyro_unit: Annotated[str | None, option("UNIT", "Where names do not tell it; else rad/s.")] = None,
    acc_unit: Annotated[str | None, option("UNIT", "The same (g_0 for gravities); else m/s2.")] = None,
    speed: Annotated[str | None, option("V,...", "Walking speed of each file, for the table.", "--speed-m-s")] = None,
    stride: Annotated[str | None, option("LOW:HIGH", "Instead of files: the stride band.", "--stride-hz")] = None,
    yaw_deg: Annotated[float | None, option("DEG", "With it: the amplitude, half of peak to peak.")] = None,
    out: Annotated[Path | None, option("DIR", "Folder for gait.json and a figure.")] = None,
    json: Json = False,
) -> None:
    """Find the stride frequency and the yaw between trunk and pelvis that a torso joint has to follow.

    Sensors and markers are found by their usual names: an npz file with t, hip_gyr, hip_acc, upper_back_gyr and so on,
    columns hip_gyr_x and so on, or markers LASI_x_mm, RASI, LSHO, RSHO. Several files give a table over their speeds
    and one band.
    """
    if bool(files) == (stride is not None or yaw_deg is not None):
        raise SpecError("expected recordings of walking, or --stride-hz LOW:HIGH with --yaw-deg, and not both")
    if out is not None:
        console.require_folder(out)
    if files:
        bodies = {role: name for role, name in (("pelvis", pelvis), ("trunk", trunk)) if name is not None}
        if yaw is not None and bodies:
            raise SpecError("--yaw is an angle that is ready; leave --pelvis and --trunk out")
        if up not in ("x", "y", "z"):
            raise SpecError(f"--up is {up!r}, expected x, y or z")
        columns = {"time": time, "bodies": bodies, "yaw": yaw, "up": up}
        units = {"gyro_unit": gyro_unit, "acceleration_unit": acc_unit}
        target, notes = _of_files(files, {**columns, **units}, (start, stop), _speeds(speed, len(files)))
    else:
        target, notes = _of_numbers(stride, yaw_deg), []
    document = gait_document(target)
    if out is not None:
        document["files"] = _write(document, target, out)
    if json:
        console.print_json(document)
    else:
        _print(document)
    for note in notes:
        console.remark(note)


def gait_document(target: "GaitTarget") -> dict[str, Any]:
    """Return a target as JSON holds it; the same keys for recordings and for numbers."""
    rows = [_row(walk.name, bout) for walk in target.walks for bout in sorted(walk.bouts, key=lambda one: one.start_s)]
    return {
        "source": target.source,
        "stride_frequency_hz": target.frequency_hz.to_json(),
        "stride_band_hz": list(target.band_hz),
        "yaw_amplitude_deg": target.yaw_deg.to_json(),
        "yaw_band_deg": list(target.yaw_band_deg),
        "yaw_of": target.swing,
        "strides": target.strides,
        "regularity": finite(target.regularity),
        "bouts": rows,
        "sentences": list(target.sentences),
    }


def _row(name: str, bout: "BoutGait") -> dict[str, Any]:
    def known(estimate: "Estimate | None") -> Any:
        return None if estimate is None else estimate.to_json()

    return {
        "file": name,
        "start_s": bout.start_s,
        "stop_s": bout.stop_s,
        "speed_m_s": finite(bout.speed_m_s),
        "strides": bout.strides,
        "stride_frequency_hz": bout.frequency_hz.to_json(),
        "stride_band_hz": [bout.slowest_hz, bout.fastest_hz],
        "yaw_amplitude_deg": bout.yaw_deg.to_json(),
        "yaw_at_one_frequency_deg": bout.line_deg,
        "yaw_peak_to_peak_deg": bout.peak_to_peak_deg.to_json(),
        "yaw_range_deg": bout.range_deg,
        "pelvis_amplitude_deg": known(bout.pelvis_deg),
        "trunk_amplitude_deg": known(bout.trunk_deg),
        "trunk_lag_deg": known(bout.trunk_lag_deg),
        "regularity": bout.regularity,
    }


def _of_files(
    files: list[Path], columns: dict[str, Any], stretch: tuple[float | None, float | None], speeds: list[float] | None
) -> tuple["GaitTarget", list[str]]:
    from dataclasses import replace

    from sinew.measure.files.walk_file import WalkColumns, read_walk
    from sinew.tune.gait import body_motion, estimate_gait, target_of_walks

    asked = WalkColumns(**columns)
    walks, notes = [], []
    for i, file in enumerate(files):
        try:
            record = read_walk(file, asked, start_s=stretch[0], stop_s=stretch[1])
            motion = body_motion(record)
            motion = motion if speeds is None else replace(motion, given_speed_m_s=speeds[i])
            walks.append(estimate_gait(motion, file.name))
        except RecordingError as error:
            raise type(error)(f"{file.name}: {error}") from error
        parts = ", ".join(f"{role} by {name}" for role, name in record.names.items()) or "yaw as given"
        notes += [f"{file.name}: {note}" for note in (parts, *record.notes)]
    return target_of_walks(walks), notes


def _of_numbers(stride: str | None, yaw_deg: float | None) -> "GaitTarget":
    from sinew.tune.gait import target_of_numbers

    if stride is None or yaw_deg is None:
        raise SpecError("--stride-hz and --yaw-deg belong together, as --stride-hz 0.7:1.1 --yaw-deg 7")
    expected = f"LOW:HIGH in hertz, above 0 and up to {_FASTEST_HZ:g}, as 0.7:1.1"
    found = console.number_list("--stride-hz", stride, expected, between=":", low=0, high=_FASTEST_HZ, above=True)
    if len(found) > 2:
        raise SpecError(f"--stride-hz is {stride!r}, expected {expected}")
    return target_of_numbers((found[0], found[-1]), yaw_deg)


def _speeds(text: str | None, count: int) -> list[float] | None:
    if text is None:
        return None
    found = console.number_list("--speed-m-s", text, f"one positive speed for each of the {count} files")
    if len(found) != count or not all(v > 0 for v in found):
        raise SpecError(f"--speed-m-s is {text!r}, expected one positive speed for each of the {count} files")
    return found


def _write(document: dict[str, Any], target: "GaitTarget", folder: Path) -> list[str]:
    from sinew.figures.style import save_figure
    from sinew.figures.tuned import draw_gait_yaw

    folder.mkdir(parents=True, exist_ok=True)
    figure = draw_gait_yaw(target)
    paths = [] if figure is None else save_figure(figure, folder, "gait_yaw", ("png", "pdf"))
    files = [str(path) for path in (folder / "gait.json", *paths)]
    console.write_json({**document, "files": files}, folder / "gait.json")
    return files


def _print(document: dict[str, Any]) -> None:
    rows = []
    for row in sorted(document["bouts"], key=lambda one: one["speed_m_s"] or one["stride_frequency_hz"]["value"]):
        rows.append(
            (
                row["file"],
                f"{number(row['start_s'])}-{number(row['stop_s'])}",
                fixed(row["speed_m_s"], 2),
                number(row["strides"], 3),
                shown_interval(row["stride_frequency_hz"]),
                shown_interval(row["yaw_amplitude_deg"]),
                shown_interval(row["yaw_peak_to_peak_deg"]),
                fixed(row["regularity"], 2),
            )
        )
    if rows:
        columns = ("file", "time/s", "speed/(m/s)", "strides", "stride/Hz", "yaw/°", "peak to peak/°", "regularity")
        console.print_table(columns, rows, f"yaw of {document['yaw_of']}, 90 % intervals")
    for sentence in document["sentences"]:
        print(f"- {sentence}")
    for file in document.get("files", []):
        print(f"wrote {file}")
