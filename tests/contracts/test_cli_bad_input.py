"""Bad input to any command: status 2, one helpful line, and no file that was not there before."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.contracts.commands import refused

from sinew.measure.files.netcdf import save_recording
from sinew.measure.read import read
from sinew.plan.toml import dump_plan, dump_rig, load_plan, load_rig

TIME = np.arange(0, 10, 0.01)
ANALYSE = ("analyse", "in.csv", "--kind", "ring-down", "--time", "t", "--response", "x:deg", "--out", "out")


def table(folder: Path, time: np.ndarray = TIME, values: np.ndarray | None = None) -> None:
    values = 30 * np.exp(-0.5 * TIME) * np.cos(2 * np.pi * 3 * TIME) if values is None else values
    rows = [f"{t:.4f},{x:.6f}" for t, x in zip(time, values, strict=True)]
    (folder / "in.csv").write_text("t,x\n" + "\n".join(rows) + "\n", encoding="utf-8")


def with_time_backwards(folder: Path) -> None:
    table(folder, time=np.r_[TIME[:500], TIME[500:][::-1]])


def with_gap(folder: Path) -> None:
    time = TIME.copy()
    time[500:] += 2.0
    table(folder, time=time)


def empty(folder: Path) -> None:
    (folder / "in.csv").write_bytes(b"")


def binary_junk(folder: Path) -> None:
    (folder / "in.csv").write_bytes(bytes(np.random.default_rng(1).integers(0, 256, 4096, dtype=np.uint8)))


def absent(folder: Path) -> None:
    assert not (folder / "in.csv").exists()


def too_short(folder: Path) -> None:
    table(folder, TIME[:20], np.cos(2 * np.pi * 3 * TIME[:20]))


def growing(folder: Path) -> None:
    table(folder, values=0.1 * np.exp(0.5 * TIME) * np.cos(2 * np.pi * 3 * TIME))


def truncated(folder: Path) -> None:
    table(folder)
    save_recording(read(folder / "in.csv", time="t", response="x:deg"), folder / "in.nc")
    whole = (folder / "in.nc").read_bytes()
    (folder / "in.nc").write_bytes(whole[: len(whole) // 2])


def junk_recording(folder: Path) -> None:
    (folder / "in.nc").write_bytes(b"not a recording")


def negative_pretension(folder: Path) -> None:
    text = dump_plan(load_plan("short")).replace("pretension_mm = [0,", "pretension_mm = [-1,")
    (folder / "plan.toml").write_text(text, encoding="utf-8")


def beyond_limits(folder: Path) -> None:
    text = dump_plan(load_plan("short")).replace("amplitude_deg = 20", "amplitude_deg = 60")
    (folder / "plan.toml").write_text(text, encoding="utf-8")


def unknown_key(folder: Path) -> None:
    text = dump_rig(load_rig("paper")).replace("\npulley_radius", "\npully_radius")
    (folder / "rig.toml").write_text(text, encoding="utf-8")


def folder_that_is_a_file(folder: Path) -> None:
    table(folder)
    (folder / "out").write_text("in the way", encoding="utf-8")


def imported(folder: Path) -> None:
    table(folder)
    save_recording(read(folder / "in.csv", time="t", response="x:deg"), folder / "in.nc")


def shaken(folder: Path) -> None:
    rng = np.random.default_rng(1)
    rows = [f"{t:.2f},{x:.4f},{y:.4f}" for t, x, y in zip(TIME, *rng.normal(0, 1, (2, TIME.size)), strict=True)]
    (folder / "in.csv").write_text("t,u,x\n" + "\n".join(rows) + "\n", encoding="utf-8")


BROADBAND = ("analyse", "in.csv", "--kind", "broadband", "--time", "t", "--response", "x:deg", "--out", "out")
SHAKEN = (*BROADBAND, "--drive", "u")
SIMULATE = ("simulate", "plan.toml", "--out", "run/recording.nc")
FAULTS: dict[str, tuple[Callable[[Path], None], tuple[str, ...], str]] = {
    "missing column": (table, (*ANALYSE[:-4], "--response", "y:deg", "--out", "out"), "y"),
    "unknown unit": (table, (*ANALYSE[:-4], "--response", "x:furlogs", "--out", "out"), "unknown unit 'furlogs'"),
    "time going backwards": (with_time_backwards, ANALYSE, "backwards"),
    "gap": (with_gap, ANALYSE, "--gaps split"),
    "stretch outside an imported recording": (
        imported,
        ("analyse", "in.nc", "--start", "20", "--out", "out"),
        "the recording runs from 0 s to 9.99 s",
    ),
    "negative settling": (table, ("analyse", "in.csv", "--kind", "sweep", "--settle", "-1"), "of 0 s or more"),
    "settling of a ring-down": (imported, ("analyse", "in.nc", "--settle", "1"), "this is a ring-down"),
    "empty file": (empty, ANALYSE, "empty"),
    "binary junk": (binary_junk, ANALYSE, "in.csv"),
    "no file": (absent, ANALYSE, "in.csv"),
    "ring-down too short": (too_short, ANALYSE, "longer stretch"),
    "growing oscillation": (growing, ANALYSE, "grow"),
    "start after the end": (table, (*ANALYSE, "--start", "20"), "the file runs from 0 s to 9.99 s"),
    "sweep without drive": (
        table,
        tuple("sweep" if a == "ring-down" else a for a in ANALYSE),
        "name its column with --drive",
    ),
    "broadband without drive": (table, BROADBAND, "name its column"),
    "noise that no drive caused": (shaken, SHAKEN, "nothing in the response coheres with the drive"),
    "half a band": (shaken, (*SHAKEN, "--from-hz", "2"), "--to-hz"),
    "band that the drive leaves out": (shaken, (*SHAKEN, "--from-hz", "60", "--to-hz", "70"), "between"),
    "no modes at all": (shaken, (*SHAKEN, "--modes", "0"), "expected 1 to 8"),
    "no modes of a ring-down": (table, (*ANALYSE, "--modes", "0"), "expected 1 to 8"),
    "modes of a sweep": (
        shaken,
        (*(("sweep" if a == "broadband" else a) for a in SHAKEN), "--modes", "2"),
        "of a table, a broadband record or hammer blows",
    ),
    "segment without end": (shaken, (*SHAKEN, "--segment", "100"), "choose shorter segments or record longer"),
    "settling of a broadband record": (shaken, (*SHAKEN, "--settle", "1"), "leave it out"),
    "band of a ring-down": (table, (*ANALYSE, "--from-hz", "1", "--to-hz", "5"), "for a broadband record"),
    "truncated NetCDF": (truncated, ("export", "in.nc", "--to", "csv", "--out", "out.csv"), "cut short"),
    "truncated NetCDF to analyse": (truncated, ("analyse", "in.nc", "--out", "out"), "cut short"),
    "junk for NetCDF": (junk_recording, ("analyse", "in.nc", "--out", "out"), "in.nc is not a NetCDF file"),
    "negative pretension": (negative_pretension, SIMULATE, "pretension.pretension_mm, entry 1: found -1"),
    "plan beyond limits": (beyond_limits, SIMULATE, "sweep asks for 60°, the rig allows 45°"),
    "unknown rig key": (unknown_key, ("check", "short", "--rig", "rig.toml"), "did you mean pulley_radius?"),
    "analyse into a file": (folder_that_is_a_file, ANALYSE, "cannot write into out"),
    "reproduce into a file": (
        folder_that_is_a_file,
        ("reproduce", "--plan", "short", "--out", "out"),
        "cannot write into",
    ),
    "simulate below a file": (
        folder_that_is_a_file,
        ("simulate", "short", "--out", "out/recording.nc"),
        "cannot write into out",
    ),
    "azimuth of a recording": (
        imported,
        ("report", "in.nc", "--azimuth-deg", "90"),
        "found --azimuth-deg beside a recording",
    ),
    "export onto a folder": (
        lambda folder: (
            table(folder),
            save_recording(read(folder / "in.csv", time="t", response="x"), folder / "in.nc"),
        )[1],
        ("export", "in.nc", "--to", "mat", "--out", "."),
        "it is a folder",
    ),
}


@pytest.mark.parametrize(("prepare", "arguments", "sentence"), FAULTS.values(), ids=FAULTS.keys())
def test_bad_input_is_one_line_status_2_and_no_new_file(
    prepare: Callable[[Path], None],
    arguments: tuple[str, ...],
    sentence: str,
    here: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    prepare(here)
    before = sorted(here.rglob("*"))
    assert sentence in refused(capsys, *arguments, *(() if arguments[0] == "check" else ("--json",)))
    assert sorted(here.rglob("*")) == before
