"""`sinew run`: what it says and leaves when it is refused, when it ends well, and when something ends it.

Where nothing else is said, the bench is the emulator's in virtual time, and the whole command runs in this process.
"""

import io
import json
import os
import shutil
import signal
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest
from tests.contracts.emulated_bench import QUESTIONS, TINY, WatchedPort, joint, rig_file, virtual_port

from sinew.apps.cli import main
from sinew.bench.journal_reader import JournalReader
from sinew.emulator.protection import OVERLOAD
from sinew.emulator.rig import EmulatedRig
from sinew.measure.netcdf import load_recording
from sinew.plan.toml import load_rig

SIGNALS = {
    signal.SIGINT: "interrupted by Ctrl-C",
    signal.SIGTERM: "terminated",
    signal.SIGHUP: "the terminal closed",
}


class Said(NamedTuple):
    status: int
    out: str
    err: str


@pytest.fixture
def plan(tmp_path: Path) -> str:
    path = tmp_path / "tiny.toml"
    path.write_text(TINY)
    return str(path)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "deep" / "out"


def run(capsys: pytest.CaptureFixture[str], plan: str, out: Path, *options: str) -> Said:
    capsys.readouterr()
    status = main(["run", plan, "--port", "/dev/bench", "--out", str(out), *options])
    return Said(status, *capsys.readouterr())


def torques(rig: EmulatedRig) -> list[bool]:
    return [state.torque for state in rig.states().values()]


# Refusals ----------------------------------------------------------------------------------------------------------


def with_torque(rig: EmulatedRig) -> None:
    for motor in (rig.motors[1], rig.motors[5]):
        assert motor.write(64, b"\1", 0.0) == 0


def with_offset(rig: EmulatedRig) -> None:
    rig.motors[2].registers["homing_offset"] = 100


def with_error(rig: EmulatedRig) -> None:
    rig.motors[3].fail(OVERLOAD)


def with_heat(rig: EmulatedRig) -> None:
    rig.motors[5].protection.temperature = 75.0


def with_twins(rig: EmulatedRig) -> None:
    rig.motors[2].registers["id"] = 1
    rig.motors[2].restart(-0.777)  # no two motors are switched on in the same millisecond


def with_frozen_imu(rig: EmulatedRig) -> None:
    rig.imu.frozen = True


def without_motor(rig: EmulatedRig) -> None:
    rig.line.devices = [device for device in rig.line.devices if device.id != 4]


def without_imu(rig: EmulatedRig) -> None:
    rig.line.devices = [device for device in rig.line.devices if device.id != 200]


UNFIT_BENCHES: dict[str, tuple[Callable[[EmulatedRig], object], tuple[str, ...]]] = {
    "torque is on": (with_torque, ("torque is on at tendon 1 and drive", "sinew stop", "--resume")),
    "homing offset": (with_offset, ("homing offset at tendon 2, expected 0", "sinew doctor --fix")),
    "hardware error": (with_error, ("hardware error (overload) at tendon 3", "sinew doctor --fix")),
    "too warm": (with_heat, ("75 °C at drive, the rig allows 70", "cool")),
    "supply too low": (lambda rig: rig.set_supply(9.7), ("supply of 9.7 V at all motors", "10 to 14.8", "supply")),
    "supply too high": (lambda rig: rig.set_supply(15.2), ("supply of 15.2 V at all motors", "10 to 14.8", "supply")),
    "two motors with one id": (with_twins, ("damaged", "tendon 1 (id 1)", "none from tendon 2 (id 2)", "another id")),
    "frozen IMU": (with_frozen_imu, ("IMU repeats one sample", "restart its board")),
    "missing motor": (
        without_motor,
        ("no answer from tendon 4 (id 4)", "but from the others", "check cable, baud, and its id"),
    ),
    "missing IMU": (
        without_imu,
        ("no answer from IMU (id 200)", "but from the others", "check cable, baud, and its id"),
    ),
}


@pytest.mark.parametrize(("spoil", "words"), UNFIT_BENCHES.values(), ids=UNFIT_BENCHES.keys())
def test_an_unfit_bench_is_refused_with_a_reason_and_nothing_is_touched(
    spoil: Callable[[EmulatedRig], object],
    words: tuple[str, ...],
    plan: str,
    out: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    port = virtual_port(monkeypatch)
    spoil(port.rig)
    told = run(capsys, plan, out)
    assert (told.status, told.out, told.err.count("\n"), out.parent.exists()) == (2, "", 1, False)
    assert [word for word in words if word not in told.err] == []
    assert port.codes <= QUESTIONS


UNFIT_RIGS: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "wrong model": (
        {"drive_model": "XH430-W350"},
        ("drive (id 5) is model 1020 (XM430-W350), expected 1000 (XH430-W350)", "[wiring]"),
    ),
    "swapped ids": (
        {"tendon_ids": (5, 2, 3, 4), "drive_id": 1},
        ("tendon 1 (id 5) is model 1020", "drive (id 1) is model 1000", "correct ids or models"),
    ),
    "id that is not there": (
        {"tendon_ids": (1, 2, 7, 4)},
        ("no answer from tendon 3 (id 7) at 1000000 baud", "its id"),
    ),
    "upside-down IMU": (
        {"imu_axes": ("-x", "-y", "+z")},
        ("reads -9.", "along the joint, expected about 9.81", "imu_axes"),
    ),
    "unknown model": ({"drive_model": "XL320"}, ("XL320", "XM430-W350")),
    "baud too slow for the plan": ({"baud": 57_600}, ("48", "57600 baud", "200 Hz leave 5.0 ms", "lower sample_hz")),
}


@pytest.mark.parametrize(("wiring", "words"), UNFIT_RIGS.values(), ids=UNFIT_RIGS.keys())
def test_a_rig_that_is_not_the_bench_is_refused_with_a_reason_and_nothing_is_touched(
    wiring: dict[str, Any],
    words: tuple[str, ...],
    plan: str,
    out: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    port = virtual_port(monkeypatch)
    told = run(capsys, plan, out, "--rig", rig_file(tmp_path, **wiring))
    assert (told.status, told.out, told.err.count("\n"), out.parent.exists()) == (2, "", 1, False)
    assert [word for word in words if word not in told.err] == []
    assert port.codes <= QUESTIONS


def test_another_baud_than_the_devices_is_refused(
    plan: str, out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    port = virtual_port(monkeypatch, baud=57_600)
    told = run(capsys, plan, out)
    assert (told.status, told.err.count("\n"), out.parent.exists()) == (2, 1, False)
    assert "no device answers at 1000000 baud" in told.err
    assert port.codes <= QUESTIONS


def test_several_reasons_are_said_at_once(
    plan: str, out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    port = virtual_port(monkeypatch)
    for spoil in (with_torque, with_offset, with_heat):
        spoil(port.rig)
    told = run(capsys, plan, out)
    assert (told.status, told.err.count("\n")) == (2, 1)
    assert all(word in told.err for word in ("torque is on", "homing offset", "75 °C"))


def test_a_port_that_goes_away_while_the_bench_is_looked_at_is_a_refusal(
    plan: str, out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    port = virtual_port(monkeypatch)
    port.agenda = [(port.now() + 0.01, lambda: setattr(port.rig, "unplugged", True))]
    told = run(capsys, plan, out)
    assert (told.status, told.err.count("\n"), out.parent.exists()) == (2, 1, False)
    assert "the port is gone" in told.err


def test_a_plan_beyond_a_limit_of_the_rig_is_refused(
    out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "hard.toml"
    path.write_text(TINY.replace("[2]", "[20]"))
    port = virtual_port(monkeypatch)
    told = run(capsys, str(path), out)
    assert (told.status, told.out, told.err.count("\n"), out.parent.exists()) == (2, "", 1, False)
    assert all(word in told.err for word in ("20 mm", "16", "pretension_mm"))
    assert port.codes <= QUESTIONS


def test_one_broken_reading_of_the_imu_is_no_refusal(
    plan: str, out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    port = virtual_port(monkeypatch)
    lost: list[float] = []

    def disturb(now: float, data: bytes) -> list[tuple[float, bytes]]:
        # The first answers of the IMU to a bulk read (32 bytes and more) get lost.
        if data[4] == 200 and len(data) > 30 and len(lost) < 2:
            lost.append(now)
            return []
        return [(now, data)]

    port.rig.line.disturb_up = disturb
    told = run(capsys, plan, out)
    assert (len(lost), told.status) == (2, 1), told.err


# Folders -----------------------------------------------------------------------------------------------------------


def occupied(folder: Path) -> None:
    folder.mkdir(parents=True)
    (folder / "journal.sqlite").write_text("a run")


def with_recording(folder: Path) -> None:
    folder.mkdir(parents=True)
    (folder / "recording.nc").write_text("a recording")


def under_a_file(folder: Path) -> None:
    folder.parent.write_text("a file")


UNFIT_FOLDERS: dict[str, tuple[Callable[[Path], object], tuple[str, ...], tuple[str, ...]]] = {
    "run there": (occupied, (), ("holds a run already", "--resume", "another --out")),
    "recording there": (with_recording, (), ("holds a recording.nc", "another --out")),
    "under a file": (under_a_file, (), ("cannot write into", "Not a directory", "--out")),
    "resume without a run": (lambda _: None, ("--resume",), ("found no run to go on with", "leave --resume out")),
}


@pytest.mark.parametrize(("prepare", "options", "words"), UNFIT_FOLDERS.values(), ids=UNFIT_FOLDERS.keys())
def test_an_unfit_folder_is_refused_and_left_as_it_was(
    prepare: Callable[[Path], object],
    options: tuple[str, ...],
    words: tuple[str, ...],
    plan: str,
    out: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    port = virtual_port(monkeypatch)
    prepare(out)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    told = run(capsys, plan, out, *options)
    assert (told.status, told.out, told.err.count("\n"), port.codes) == (2, "", 1, set())
    assert [word for word in words if word not in told.err] == []
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="a folder that takes no file, whoever asks")
def test_a_folder_that_may_not_be_written_is_refused(
    plan: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    port = virtual_port(monkeypatch)
    told = run(capsys, plan, Path("/proc/out"))
    assert (told.status, told.err.count("\n"), port.codes) == (2, 1, set())
    assert "cannot write into /proc/out" in told.err


def test_a_disk_without_room_for_the_run_is_refused(
    plan: str, out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    port = virtual_port(monkeypatch)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1_000_000))
    told = run(capsys, plan, out)
    assert (told.status, told.err.count("\n"), out.parent.exists()) == (2, 1, False)
    assert all(word in told.err for word in ("has 1.0 MB left", "the run writes about", "--out"))
    assert port.codes <= QUESTIONS


# Ends --------------------------------------------------------------------------------------------------------------


def interrupt(port: WatchedPort, *times: float, number: int = signal.SIGINT) -> None:
    """Have this process get a signal at some times of the run [s]."""
    port.agenda = [(port.now() + time, lambda: os.kill(os.getpid(), number)) for time in times]


@pytest.mark.parametrize("state", ["hold", "release"])
@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_ends_a_run_in_the_declared_safe_state(
    number: signal.Signals,
    state: str,
    plan: str,
    out: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    port = virtual_port(monkeypatch)
    rig = rig_file(tmp_path, limits={"safe_state": state})
    interrupt(port, 3.0, number=number)
    told = run(capsys, plan, out, "--rig", rig, "--json")
    document = json.loads(told.out)
    keys = ("complete", "ended", "safe_state", "is_safe")
    assert [told.status, *(document[key] for key in keys)] == [1, False, SIGNALS[number], state, True]
    assert (port.rig.in_safe_state(), set(torques(port.rig))) == (True, {state == "hold"})


def test_a_second_and_a_third_interrupt_change_nothing(
    plan: str, out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    port = virtual_port(monkeypatch)
    interrupt(port, 3.0, 3.0, 3.03)
    told = run(capsys, plan, out)
    assert (told.status, port.agenda, any(torques(port.rig))) == (1, [], False)
    assert "interrupted by Ctrl-C; 0 of 2 groups are recorded\nrelease: tension let down, torque off" in told.out


def test_after_a_run_the_signals_are_what_they_were(
    plan: str, out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    port = virtual_port(monkeypatch)
    before = [signal.getsignal(number) for number in SIGNALS]
    interrupt(port, 2.0)
    run(capsys, plan, out)
    assert [signal.getsignal(number) for number in SIGNALS] == before


def test_a_run_that_ended_early_says_how_to_go_on(
    plan: str, out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    interrupt(virtual_port(monkeypatch), 2.0)
    told = run(capsys, plan, out)
    assert told.err.splitlines()[-1] == (
        f"sinew: go on with: sinew run {plan} --rig paper --port /dev/bench --out {out} --resume"
    )


def test_an_unplugged_port_is_said_and_the_watchdogs_stop_the_motors(
    plan: str, out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    port = virtual_port(monkeypatch)
    port.agenda = [(port.now() + 3.0, lambda: setattr(port.rig, "unplugged", True))]
    told = run(capsys, plan, out)
    assert told.status == 1
    assert "the port is gone; plug it in again; 0 of 2 groups are recorded" in told.out
    assert "bus watchdog has stopped them where they are; switch the supply off" in told.out
    port.rig.advance(port.spoke + 0.2)
    assert [state.is_tripped for state in port.rig.states().values()] == [True] * 5


def test_a_bench_without_cables_is_let_go_with_a_sentence(
    plan: str, out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    port = virtual_port(monkeypatch)
    told = run(capsys, plan, out)
    assert (told.status, any(torques(port.rig))) == (1, False)
    assert "expected -20 to 40 (tendon_travel_mm); is the cable off its pulley" in told.out


def test_the_journal_of_a_run_that_ended_early_has_its_samples_and_its_end(
    plan: str, out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    interrupt(virtual_port(monkeypatch), 3.0)
    cycles = json.loads(run(capsys, plan, out, "--json").out)["cycles"]["cycles"]
    with JournalReader(out / "journal.sqlite") as journal:
        assert journal.last_sample() == cycles > 300
        assert journal.events()[-1][1:] == (
            "end",
            "interrupted by Ctrl-C; release: tension let down, torque off on all motors",
        )


# Resuming ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def held(
    plan: str, out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> tuple[WatchedPort, str]:
    """A bench that a run has left in hold, and its rig."""
    port = virtual_port(monkeypatch)
    rig = rig_file(tmp_path, limits={"safe_state": "hold"})
    interrupt(port, 3.0)
    assert run(capsys, plan, out, "--rig", rig).status == 1
    assert all(torques(port.rig))
    return port, rig


def test_a_bench_left_in_hold_is_refused_to_a_new_run(
    held: tuple[WatchedPort, str], plan: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = run(capsys, plan, tmp_path / "other", "--rig", held[1])
    assert (told.status, "torque is on at all motors" in told.err) == (2, True)


def test_a_bench_left_in_hold_is_taken_over_by_resuming(
    held: tuple[WatchedPort, str], plan: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = run(capsys, plan, out, "--rig", held[1], "--resume")
    assert (told.status, "has travelled" in told.out, all(torques(held[0].rig))) == (1, True, True)


def test_resuming_with_another_plan_is_refused(
    held: tuple[WatchedPort, str], out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.toml"
    other.write_text(TINY.replace("periods = 3", "periods = 4"))
    told = run(capsys, str(other), out, "--rig", held[1], "--resume")
    assert (told.status, told.err.count("\n")) == (2, 1)
    assert all(word in told.err for word in ("begun with another plan", "periods = 4", "periods = 3", "use the same"))


def test_resuming_with_another_rig_is_refused(
    held: tuple[WatchedPort, str], plan: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = run(capsys, plan, out, "--resume")
    assert (told.status, told.err.count("\n")) == (2, 1)
    assert all(word in told.err for word in ("begun with another rig", "safe_state", "use the same"))


def test_a_refused_resume_leaves_the_journal_as_it_was(
    held: tuple[WatchedPort, str], plan: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (out / "journal.sqlite").read_bytes()
    without_motor(held[0].rig)
    told = run(capsys, plan, out, "--rig", held[1], "--resume")
    assert (told.status, (out / "journal.sqlite").read_bytes() == before) == (2, True)


# A whole run -------------------------------------------------------------------------------------------------------


class Whole(NamedTuple):
    folder: Path
    status: int
    document: dict[str, Any]
    err: str


def spoken(*arguments: str) -> tuple[int, str, str]:
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as err:
        status = main(list(arguments))
    return status, out.getvalue(), err.getvalue()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Whole]:
    """A run of the tiny plan on the joint, from first contact to the recording."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "tiny.toml").write_text(TINY)
    with pytest.MonkeyPatch.context() as monkeypatch:
        spec = load_rig("paper")
        port = virtual_port(monkeypatch, spec, joint(spec))
        status, out, err = spoken("run", str(folder / "tiny.toml"), "--port", "b", "--out", str(folder), "--json")
        assert port.rig.in_safe_state()
        yield Whole(folder, status, json.loads(out), err)


def test_a_whole_run_ends_with_status_0(whole: Whole) -> None:
    assert (whole.status, whole.document["complete"], whole.document["is_safe"]) == (0, True, True)


def test_the_summary_of_a_whole_run_says_once_that_all_is_there(whole: Whole) -> None:
    assert whole.document["ended"] == "all 2 groups are recorded"


def test_the_json_has_the_keys_of_the_reference(whole: Whole) -> None:
    assert set(whole.document) == {
        *("plan", "rig", "complete", "ended", "safe_state", "is_safe", "left", "groups", "groups_done"),
        *("pretensions", "cycles", "journal", "recording", "bus"),
    }


def test_stderr_tells_the_run_step_by_step(whole: Whole) -> None:
    pulled, contact, pretension = whole.err.splitlines()
    assert pulled == "sinew: the tendons are pulled to first contact"
    assert contact.startswith("sinew: first contact at ")
    assert pretension.startswith("sinew: pretension 2 mm is set, tilt 0.0")


def test_the_pretension_of_a_whole_run_came_out_as_asked(whole: Whole) -> None:
    (pretension,) = whole.document["pretensions"]
    assert pretension["asked_mm"] == 2
    assert abs(pretension["reached_mm"] - 2) < 0.1
    assert pretension["tilt_deg"] < 0.2


def test_a_whole_run_leaves_recording_and_journal_and_nothing_else(whole: Whole) -> None:
    left = {path.name for path in whole.folder.iterdir() if not path.name.startswith("journal.sqlite-")}
    assert left == {"tiny.toml", "recording.nc", "journal.sqlite", "journal.sqlite.lock"}


def test_the_recording_of_a_whole_run_says_by_which_command_it_came(whole: Whole) -> None:
    attrs = load_recording(whole.folder / "recording.nc").attrs
    assert attrs["source"] == "bench"
    assert attrs["command"] == f"sinew run {whole.folder}/tiny.toml --rig paper --port b --out {whole.folder}"


def test_analyse_reads_the_recording_of_a_whole_run_like_any_other(whole: Whole) -> None:
    status, out, _ = spoken("analyse", str(whole.folder / "recording.nc"), "--json")
    (row,) = json.loads(out)["response"]
    assert (status, row["pretension_mm"], row["frequency_hz"], row["repeats"]) == (0, 2, 3, 1)


def test_a_run_that_was_interrupted_is_completed_by_resuming(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spec, plan, out = load_rig("paper"), tmp_path / "tiny.toml", tmp_path / "out"
    plan.write_text(TINY)
    port = virtual_port(monkeypatch, spec, joint(spec))
    command = ("run", str(plan), "--port", "b", "--out", str(out), "--json")
    interrupt(port, 9.5)
    first = json.loads(spoken(*command)[1])
    port.wait_until(port.now() + 10.0)  # until the joint is at rest
    second = json.loads(spoken(*command, "--resume")[1])
    assert (first["complete"], first["groups_done"], first["recording"] is not None) == (False, 1, True)
    assert (second["complete"], second["groups_done"]) == (True, 2)
    assert load_recording(out / "recording.nc").attrs["runs"] == 2
