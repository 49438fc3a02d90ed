"""Files with the faults that real ones showed, made small: each is read right, or refused for its true reason.

The swing: 600 samples of 10 ms of 20 exp(-0.38 t) cos(2π 3 t).
"""

import json
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.dialects import LVM_END, rows

from sinew.measure.errors import SinewError, UnitError
from sinew.measure.read import look, read

T = np.round(np.arange(600) * 0.01, 4)
SWING = np.round(20 * np.exp(-0.38 * T) * np.cos(2 * np.pi * 3 * T), 4)
Write = Callable[[Path], object]


def lines(*parts: str | Sequence[str]) -> Write:
    text = "\n".join(line for part in parts for line in ([part] if isinstance(part, str) else part))
    return lambda path: path.write_text(text, encoding="utf-8")


def grouped(decimal: str, thousands: str, sep: str) -> list[str]:
    """Return rows of the swing in ms and thousandths, as a spreadsheet shows them."""
    signs = str.maketrans({".": decimal, ",": thousands})
    columns = ([f"{value:,.2f}".translate(signs) for value in 1000 * one] for one in (T, SWING))
    return rows(*columns, sep=sep)


def late_channels(delay: float) -> Write:
    def write(path: Path) -> None:
        nptdms = pytest.importorskip("nptdms")
        begin = np.datetime64("2026-03-01T14:05:00", "us")
        late = begin + np.timedelta64(round(delay * 1e6), "us")
        told = {"wf_increment": 0.01, "unit_string": "deg"}
        channels = [
            nptdms.ChannelObject("g", "drive", SWING, {**told, "wf_start_time": begin}),
            nptdms.ChannelObject("g", "angle", SWING[round(delay * 100) :], {**told, "wf_start_time": late}),
        ]
        whole = min(len(one.data) for one in channels)
        for one in channels:
            one.data = one.data[:whole]
        with nptdms.TdmsWriter(str(path)) as writer:
            writer.write_segment(channels)

    return write


def nested_mat(path: Path) -> None:
    from scipy import io

    io.savemat(path, {"log": {"meta": {"who": "room 3"}, "data": {"t_s": T, "angle_deg": SWING}}})


ENTRIES = [{"t_s": t, "pos": {"x_mm": x}} for t, x in zip(T.tolist(), SWING.tolist(), strict=True)]
LVM = ["LabVIEW Measurement,", "Separator,Semicolon", "Decimal_Separator,.", LVM_END, "Delta_X;1", LVM_END]
KNOCK = f"{T[-1]},{SWING[-1]},a knock"
AGAIN = np.insert(np.arange(600), 325, 323)
FILES: dict[str, tuple[str, Write, float]] = {  # name, file, factor from the swing to SI
    "t/ms": ("a.csv", lines("t/ms,x_mm", rows(1000 * T + 0.5, SWING)), 1e-3),
    "Zeit in ms": ("a.csv", lines("Zeit in ms;x in mm", rows(1000 * T, SWING, sep=";", comma=True)), 1e-3),
    "nanoseconds": ("a.csv", lines("time_nanosec,x_mm", rows([f"{1e9 * t:.0f}" for t in T], SWING)), 1e-3),
    "thousands points": ("a.csv", lines("Zeit [ms];Weg [µm]", grouped(",", ".", ";")), 1e-3),
    "thousands commas": ("a.txt", lines("time (ms)\tx (um)", grouped(".", ",", "\t")), 1e-3),
    "LabVIEW, semicolons": ("a.lvm", lines(LVM, "X_Value;x (mm);Comment", rows(T, SWING, sep=";")), 1e-3),
    "a comment behind a row": ("a.csv", lines("t_s,x_mm", rows(T, SWING)[:-1], KNOCK), 1e-3),
    "an index without a name": ("a.csv", lines(",t_s,x_mm", rows(np.arange(600), T, SWING)), 1e-3),
    "a counter of 32 bits": ("a.csv", lines("micros,x_mm", rows((4.294e9 + 1e6 * T) % 2**32, SWING)), 1e-3),
    "a bar between columns": ("a.txt", lines("t_s | x_mm", rows(T, SWING, sep=" | ")), 1e-3),
    "JSON": ("a.json", lines(json.dumps({"mass": 0.5, "run": {"entries": ENTRIES}})), 1e-3),
    "lines of JSON": ("a.jsonl", lines([json.dumps(one) for one in ENTRIES]), 1e-3),
    "structs of MATLAB": ("a.mat", nested_mat, np.pi / 180),
    "an angle in a circle": ("a.csv", lines("t_s,angle_deg", rows(T, SWING % 360)), np.pi / 180),
    "a row over again": ("a.csv", lines("t_s,x_mm", rows(T[AGAIN], SWING[AGAIN])), 1e-3),
    "a rate in kHz": ("a.csv", lines("Sample Rate (kHz);0.1", "x_mm;supply", rows(SWING, T, sep=";")), 1e-3),
    "a rate, then its unit": ("a.csv", lines("Sampling Rate,0.1,kHz", "x_mm,supply", rows(SWING, T)), 1e-3),
    "a step in ms": ("a.csv", lines("Sample interval [ms];10", "x_mm;supply", rows(SWING, T, sep=";")), 1e-3),
    "a time and an amplitude": ("a.csv", lines("Time (s),Amplitude", rows(T, SWING)), 1.0),
    "a clock set back": ("a.csv", lines("t_s,x_mm", rows(T - 0.05 * (T >= 3.0), SWING)), 1e-3),
}


@pytest.mark.parametrize(("name", "write", "factor"), FILES.values(), ids=FILES)
def test_a_file_is_read_right_with_the_columns_that_look_names(
    tmp_path: Path, name: str, write: Write, factor: float
) -> None:
    write(tmp_path / name)
    found = look(tmp_path / name)
    assert found.command is not None, found.notes
    words = shlex.split(found.command)[3:]
    given = {word.removeprefix("--"): value for word, value in zip(words[::2], words[1::2], strict=True)}
    recording = read(tmp_path / name, **given)  # type: ignore[arg-type]
    channel = recording["torsion_rad" if "torsion_rad" in recording else "response"]
    assert recording["time_s"].values - recording["time_s"].values[0] == pytest.approx(T, abs=1e-9)
    assert channel.values == pytest.approx(SWING * factor, abs=1e-6)


@pytest.mark.parametrize("delay", [0.1, 0.37])
def test_channels_that_begin_at_different_times_are_brought_to_one(tmp_path: Path, delay: float) -> None:
    late_channels(delay)(tmp_path / "a.tdms")
    recording = read(tmp_path / "a.tdms", response="angle", drive="drive")
    assert recording["torsion_rad"].values == pytest.approx(recording["drive_rad"].values)
    assert recording["time_s"].values[0] == pytest.approx(delay)


@pytest.mark.parametrize(
    ("head", "response", "drive"),
    [
        ("goal_position,position,input_volts", "position", "goal_position"),
        ("angle_setpoint,temperature,angle", "angle", "angle_setpoint"),
        ("cmd,present_velocity,status", "present_velocity", "cmd"),
        ("supply_voltage,x,battery", "x", None),
    ],
)
def test_roles_follow_whole_words_and_a_supply_is_neither(
    tmp_path: Path, head: str, response: str, drive: str | None
) -> None:
    (tmp_path / "a.csv").write_text("\n".join([f"t_s,{head}", *rows(T, SWING, 0.9 * SWING + 0.1, np.sin(T) + 7)]))
    command = look(tmp_path / "a.csv").command or ""
    assert f"--response {response}" in command
    assert ("--drive" in command, f"--drive {drive}" in command) == (drive is not None, drive is not None)


@pytest.mark.parametrize(
    "head", ["freq,psd_x,psd_y", "Frequency (Hz),H1,Phase (deg)", "x,fft,phase", "f_Hz,exc_V,X1_V"]
)
def test_a_spectrum_is_no_record_over_time(tmp_path: Path, head: str) -> None:
    (tmp_path / "a.csv").write_text("\n".join([head, *rows(T, SWING, SWING)]))
    found = look(tmp_path / "a.csv")
    assert found.command is None
    assert "a table over frequency" in found.notes[0]
    with pytest.raises(SinewError, match="no record over time"):
        read(tmp_path / "a.csv")


def test_a_name_behind_a_group_is_no_unit(tmp_path: Path) -> None:
    tree = {"t": T, "plant": {"in": T}, "scope": {"A": SWING}}
    pytest.importorskip("scipy.io").savemat(tmp_path / "a.mat", tree)
    units = [(column.name, column.unit) for column in look(tmp_path / "a.mat").columns]
    assert units == [("t", None), ("/plant/in", None), ("/scope/A", None)]


@pytest.mark.parametrize("again", [T + 2.0, T[:300] + 2.0, np.r_[T[:200], T[400:]] + 2.005])
def test_two_runs_of_which_the_second_begins_before_the_first_ends_are_cut(tmp_path: Path, again: Any) -> None:
    lines("t_s,x_mm", rows(np.r_[T, again], np.r_[SWING, SWING[: again.size]]))(tmp_path / "a.csv")
    with pytest.raises(SinewError, match=r"time goes backwards at data row 601 .*--gaps split"):
        read(tmp_path / "a.csv", gaps="bridge")
    assert read(tmp_path / "a.csv", gaps="split")["row_size"].values[0] == 600


@pytest.mark.parametrize("mark", ["#3", "run #3", "% of load", '5" arm'])
def test_a_mark_in_a_cell_of_a_sheet_begins_no_comment(tmp_path: Path, mark: str) -> None:
    book = pytest.importorskip("openpyxl").Workbook()
    for row in [("what", "t_s", "x_mm"), *zip([mark] * 600, T.tolist(), SWING.tolist(), strict=True)]:
        book.active.append(row)
    book.save(tmp_path / "a.xlsx")
    assert read(tmp_path / "a.xlsx")["response"].values == pytest.approx(SWING * 1e-3)


def test_a_response_that_is_no_counter_by_its_name_is_not_unwrapped(tmp_path: Path) -> None:
    values = 1020 * (np.arange(600) % 160 >= 98) + np.arange(600) % 4
    lines("t_s,photogate", rows(T, values))(tmp_path / "a.csv")
    assert read(tmp_path / "a.csv")["response"].values == pytest.approx(values)


def test_each_segment_of_a_lvm_has_its_own_step_start_and_unit(tmp_path: Path) -> None:
    facts = [("0.01", "0", "mm"), ("0.002", "5", "V")]
    text = ["LabVIEW Measurement", "Separator\tTab", "Decimal_Separator\t.", "X_Columns\tNo", LVM_END]
    for step, begin, unit in facts:
        head = [f"Y_Unit_Label\t{unit}", f"X0\t{begin}", f"Delta_X\t{step}", LVM_END, "X_Value\tx"]
        text += head + [f"\t{x}" for x in SWING]
    lines(text)(tmp_path / "a.lvm")
    for run, (step, begin, unit) in enumerate(facts, start=1):
        recording = read(tmp_path / "a.lvm", run=run)
        assert recording["time_s"].values == pytest.approx(float(begin) + float(step) * np.arange(600))
        assert recording["response"].values == pytest.approx(SWING * (1e-3 if unit == "mm" else 1.0))


def test_lists_of_one_kind_in_a_json_are_runs_and_others_are_named(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(json.dumps({"one": ENTRIES[:300], "two": ENTRIES, "marks": [{"at": 3}]}))
    with pytest.raises(SinewError, match="holds 2 runs: 1 'one', 2 'two'; choose one"):
        read(tmp_path / "a.json")
    assert "'marks'" in look(tmp_path / "a.json", run="one").notes[1]
    (tmp_path / "a.json").write_text(json.dumps({"t_s": T.tolist(), "x": T.tolist(), "few": [1, 2]}))
    assert "another length are left out: few" in look(tmp_path / "a.json").notes[0]


def test_of_several_clocks_the_one_with_most_distinct_stamps_is_taken(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("\n".join(["time_s,stamp_ms,x_mm", *rows(np.floor(T), 1000 * T, SWING)]))
    assert read(tmp_path / "a.csv")["time_s"].values == pytest.approx(T)


def test_a_unit_in_a_bracket_that_is_not_understood_is_asked_for(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("\n".join(["Time (tick),x_mm", *rows(T, SWING)]))
    with pytest.raises(UnitError, match=r"the unit 'tick' of 'Time \(tick\)' is not understood: say which"):
        read(tmp_path / "a.csv")
    assert read(tmp_path / "a.csv", time="Time (tick):s").sizes["sample"] == 600
    (tmp_path / "a.csv").write_text("\n".join(["Sample Rate (furlong);10", "x_mm;supply", *rows(SWING, T, sep=";")]))
    with pytest.raises(SinewError, match="--rate HZ"):
        read(tmp_path / "a.csv", response="x_mm")


def test_a_million_rows_are_read_in_bounded_time(tmp_path: Path) -> None:
    import time

    t = np.arange(1_000_000) / 10_000
    text = "\n".join(f"{a:.4f},{b:.6f}" for a, b in zip(t, np.cos(30 * t), strict=True))
    (tmp_path / "a.csv").write_text("t_s,angle_deg\n" + text)
    begin = time.process_time()
    recording: Any = read(tmp_path / "a.csv")
    assert recording.sizes["sample"] == 1_000_000
    assert time.process_time() - begin < 20.0
