"""Files as other programs write them, made of one known swing: `DIALECTS`, each with how it is read.

The swing: 300 samples of 10 ms of 20° exp(-0.5 t) cos(2π 3 t), to four decimals. A second run is a tenth of it.
`python -m tests.unit.dialects FOLDER` writes them all.
"""

import json
import struct
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

N, STEP = 300, 0.01
TIME = np.round(np.arange(N) * STEP, 4)
SWING = np.round(20 * np.exp(-0.5 * TIME) * np.cos(2 * np.pi * 3 * TIME), 4)
SMALL = np.round(0.1 * SWING, 5)
OTHER = np.round(np.sin(1.7 * TIME) + 3.0, 4)


@dataclass(frozen=True)
class Dialect:
    """A file: its name, what writes it, the options that read the swing from it, and what it is refused with without.

    values: the swing, or its second run. unit: of it, as the file states it. slack: largest deviation of the values.
    """

    name: str
    write: Callable[[Path], None]
    options: dict[str, object] = field(default_factory=dict)
    refusal: str = ""
    values: np.ndarray = field(default_factory=lambda: SWING)
    unit: str = "deg"
    slack: float = 1e-9


def text(*parts: str | Sequence[str]) -> Callable[[Path], None]:
    lines = [line for part in parts for line in ([part] if isinstance(part, str) else part)]
    return lambda path: path.write_text("\n".join(lines) + "\n", encoding="utf-8") and None


def rows(*columns: Sequence[float] | Sequence[str], sep: str = ",", comma: bool = False, more: str = "") -> list[str]:
    """Return the lines of columns of numbers, which have a decimal comma where asked, or of texts."""

    def cell(value: object) -> str:
        written = value if isinstance(value, str) else f"{value:.10g}"
        return written.replace(".", ",") if comma else written

    return [sep.join(map(cell, row)) + more for row in zip(*columns, strict=True)]


def clock(seconds: float) -> str:
    total = 16 * 3600 + 4 * 60 + 59.5 + seconds
    return f"{int(total // 3600):02d}:{int(total % 3600 // 60):02d}:{total % 60:06.3f}"


LVM = ("LabVIEW Measurement", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab", "Multi_Headings\tYes")
LVM_END = "***End_of_Header***\t"


def lvm_segment(decimal: str, unit: str) -> list[str]:
    zero, step = "0.0E+0", f"{STEP:.4f}".replace(".", decimal)
    channels = ["Channels\t1", f"Samples\t{N}", "Date\t2026/03/01", "Time\t14:05:00.5", f"Y_Unit_Label\t{unit}"]
    return ["", *channels, "X_Dimension\tTime", f"X0\t{zero.replace('.', decimal)}", f"Delta_X\t{step}", LVM_END]


def lvm(decimal: str, x_columns: str, *runs: np.ndarray) -> Callable[[Path], None]:
    comma = decimal == ","
    lines = [*LVM, f"Decimal_Separator\t{decimal}", f"X_Columns\t{x_columns}", LVM_END]
    for run in runs:
        times = [""] * N if x_columns == "No" else TIME
        lines += [*lvm_segment(decimal, "deg"), "X_Value\tAngle\tComment", *rows(times, run, sep="\t", comma=comma)]
    return text(lines)


def scope(old: bool) -> Callable[[Path], None]:
    if not old:
        head = ["Model,MSO54", "Firmware Version,1.2", "", "Waveform Type,ANALOG", "Horizontal Units,s", "Label,", ""]
        return text(head, "TIME,CH1", rows(TIME, SWING))
    told = ["Record Length,3.0e+02", "Sample Interval,1.0e-02", "Trigger Point,0.0e+00", "", "", "", "Source,CH1"]
    told += ["Vertical Units,V", "Vertical Scale,1.0e+00", "Horizontal Units,s"]
    beside = [f"{one}," if one else ",," for one in [*told, *[""] * (N - len(told))]]
    return text([f"{a},{b}," for a, b in zip(beside, rows(TIME, SWING), strict=True)])


def sparse() -> list[str]:
    """Two topics of different rates in one table, as PlotJuggler exports them: a row holds one of them."""
    angle = [(t, f"{t:.4f},{x:.10g},") for t, x in zip(TIME, SWING, strict=True)]
    imu = [(t + 0.0031, f"{t + 0.0031:.4f},,{x:.10g}") for t, x in zip(TIME, OTHER, strict=True)]
    return [line for _, line in sorted(angle + imu)]


def matlab(path: Path) -> None:
    from scipy import io

    io.savemat(path, {"data": {"t": TIME[:, None], "angle": SWING[:, None]}, "note": "a swing"})


def matlab_rate(path: Path) -> None:
    from scipy import io

    io.savemat(path, {"angle": SWING[:, None], "fs": 1.0 / STEP})


def matlab_73(path: Path) -> None:
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("t", TIME), ("angle", SWING)):
            file.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:  # the words that MATLAB puts before the HDF5 part
        head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Sun Mar  1 14:05:00 2026 HDF5 schema 1.00 ."
        file.write(head.ljust(124) + struct.pack("<H", 0x0200) + b"IM")


def hdf5(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for run, values in (("first", SWING), ("second", SMALL)):
            group = file.create_group(run)
            group["t"] = TIME
            group.create_dataset("angle", data=values).attrs["units"] = "deg"


def tdms(path: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    told = {"wf_increment": STEP, "wf_start_offset": 0.0, "unit_string": "deg"}
    with TdmsWriter(str(path)) as writer:
        for group, values in (("first", SWING), ("second", SMALL)):
            writer.write_segment([ChannelObject(group, "angle", values, told)])


def uff(path: Path) -> None:
    import pyuff

    for values, mode in ((SWING, "overwrite"), (SMALL, "add")):
        one = pyuff.prepare_58(
            binary=0, func_type=1, rsp_node=12, rsp_dir=3, ref_node=1, ref_dir=3, data=values, x=TIME, id1="swing",
            rsp_ent_name="NONE", ref_ent_name="NONE", abscissa_spacing=1, abscissa_min=0.0, abscissa_inc=STEP,
            num_pts=N, ord_data_type=4, abscissa_spec_data_type=17, ordinate_spec_data_type=8,
            ordinate_axis_units_lab="mm", abscissa_axis_units_lab="s", orddenom_spec_data_type=0,
        )  # fmt: skip
        pyuff.UFF(str(path)).write_sets(one, mode)


def excel(path: Path) -> None:
    import openpyxl

    book = openpyxl.Workbook()
    for place, (title, values) in enumerate((("first", SWING), ("second", SMALL))):
        sheet = book.active if place == 0 else book.create_sheet()
        sheet.title = title
        for row in (["Pendulum", "room 3"], [], ["Time", "Angle"], ["s", "deg"], *zip(TIME, values, strict=True)):
            sheet.append([cell if isinstance(cell, str) else float(cell) for cell in row])
    book.save(path)


def parquet(path: Path) -> None:
    import fastparquet
    import pandas as pd

    fastparquet.write(str(path), pd.DataFrame({"t": TIME, "angle [deg]": SWING}))


ANGLE_MESSAGE = """std_msgs/Header header
float64 angle
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def bag(path: Path) -> None:
    from mcap_ros2.writer import Writer

    with path.open("wb") as file, Writer(file) as writer:
        schema = writer.register_msgdef("demo_msgs/msg/Angle", ANGLE_MESSAGE)
        for topic, values in (("/joint", SWING), ("/other", SMALL)):
            for t, x in zip(TIME, values, strict=True):
                at = round(t * 1e9) + 250_000_000
                header = {"stamp": {"sec": 1_700_000_000 + at // 10**9, "nanosec": at % 10**9}, "frame_id": ""}
                logged = 1_700_000_000_000_000_000 + 50_000_000 * round(t * 20)  # in bursts
                writer.write_message(topic, schema, {"header": header, "angle": float(x)}, log_time=logged)


def json_bag(path: Path) -> None:
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/joint", "json", 0)
        for t, x in zip(TIME, SWING, strict=True):
            data = json.dumps({"state": {"angle_deg": float(x), "ok": "yes"}}).encode()
            at = 1_700_000_000_000_000_000 + round(t * 1e9)
            writer.add_message(channel, log_time=at, data=data, publish_time=at)
        writer.finish()


RUN = {"run": 2}
MANY = "choose one by its number or name"
TEXTS = (
    Dialect("labview.lvm", lvm(".", "One", SWING)),
    Dialect("labview_no_x.lvm", lvm(".", "No", SWING)),
    Dialect("labview_german.lvm", lvm(",", "One", SWING, SMALL), RUN, MANY, SMALL),
    Dialect(
        "capstone.csv",
        text(
            "Time (s) Run #1,Angle (deg) Run #1,Time (s) Run #2,Angle (deg) Run #2",
            rows(TIME, SWING, TIME, SMALL),
        ),
        RUN,
        MANY,
        SMALL,
    ),
    Dialect("datastudio.txt", text("Angle, ChA, Run #3", "Time ( s )\tAngle ( deg )", rows(TIME, SWING, sep="\t"))),
    Dialect("tektronix_old.csv", scope(old=True), unit="V"),
    Dialect("tektronix_new.csv", scope(old=False), unit="1"),
    Dialect("vernier.csv", text('"Latest: Time (s)","Latest: Angle (deg)"', rows(TIME, SWING))),
    Dialect(
        "phyphox.csv",
        text('"Time (s)","Gyroscope x (deg)","Gyroscope y (deg)"', rows(TIME, OTHER, SWING)),
        {"response": "Gyroscope y"},
        "--response COL is missing",
    ),
    Dialect(
        "plotjuggler.csv",
        text("__time,/joint/angle,/imu/x", sparse()),
        {"response": "/joint/angle:deg"},
        "--response COL is missing",
    ),
    Dialect("excel_german.csv", text("sep=;", "Zeit;Winkel (deg)", rows(TIME, SWING, sep=";", comma=True))),
    Dialect(
        "headless_german.csv",
        text(rows(TIME, SWING, sep=";", comma=True)),
        {"columns": "t_s,angle_deg"},
        "no column is the time by its name",
    ),
    Dialect("tabs_comma.txt", text("Zeit [s]\tWinkel [deg]", rows(TIME, SWING, sep="\t", comma=True))),
    Dialect("blanks_comma.txt", text("Zeit Winkel_deg", rows(TIME, SWING, sep="  ", comma=True))),
    Dialect(
        "iso.csv",
        text("timestamp,angle_deg", rows([f"2026-03-01T14:05:{t + 7:09.6f}Z" for t in TIME], SWING)),
    ),
    Dialect("clock.txt", text("Time, Angle(deg)", "-----------------", rows(list(map(clock, TIME)), SWING, sep=", "))),
    Dialect("epoch.csv", text("timestamp,angle_deg", rows([str(1_772_373_900_000 + 10 * k) for k in range(N)], SWING))),
    Dialect(
        "micros.csv",
        text("Time Stamp,angle_deg", rows([str(21_290_476 + 10_000 * k) for k in range(N)], SWING)),
        {"time": "Time Stamp:us"},
        "say it, as --time 'Time Stamp:us'",
    ),
    Dialect("units_row.csv", text("t,angle", "s,deg", rows(TIME, SWING))),
    Dialect(
        "two_headers.csv",
        text("Bench 3,,", "Clock,Joint,", "Time,Angle,Angle", "(s),(deg),(deg)", rows(TIME, SWING, OTHER)),
        {"response": "Joint: Angle"},
        "--response COL is missing",
    ),
    Dialect(
        "preamble.txt",
        text("Recorder 7", "Date: 1 March 2026", "Rate [Hz]; 100", "", "time;angle_deg", rows(TIME, SWING, sep=";")),
    ),
    Dialect("angles_only.txt", text(rows(SWING)), {"rate_hz": 100.0, "columns": "angle_deg"}, "--rate HZ"),
    Dialect(
        "runs_below.csv",
        text("t,angle_deg", rows(np.concatenate([TIME, TIME]), np.concatenate([SWING, SMALL]))),
        RUN,
        MANY,
        SMALL,
    ),
    Dialect(
        "header_again.csv",
        text("t,angle_deg", rows(TIME, SWING), "", "second run", "t,angle_deg", rows(TIME, SMALL)),
        RUN,
        MANY,
        SMALL,
    ),
)
BINARIES = (
    Dialect("matlab.mat", matlab, unit="1"),
    Dialect("matlab_rate.mat", matlab_rate, unit="1"),
    Dialect("matlab_73.mat", matlab_73, unit="1"),
    Dialect("groups.h5", hdf5, {"run": "second"}, MANY, SMALL),
    Dialect("labview.tdms", tdms, {"run": "second"}, MANY, SMALL),
    Dialect("modal.uff", uff, RUN, MANY, SMALL, "mm", 1e-9),
    Dialect("sheets.xlsx", excel, {"run": "second"}, MANY, SMALL),
    Dialect("frame.parquet", parquet),
    Dialect("bag.mcap", bag, {"run": "/joint", "response": "angle:deg"}, MANY),
    Dialect("log.mcap", json_bag),
)
DIALECTS = TEXTS + BINARIES


def main(folder: str) -> None:
    for one in DIALECTS:
        one.write(Path(folder) / one.name)


if __name__ == "__main__":
    main(sys.argv[1])
