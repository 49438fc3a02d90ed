"""`sinew run`: which benches, rigs and plans it refuses, with what reason, and that it touches nothing.

The bench is the emulator's in virtual time, and the whole command runs in this process.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from campaigns.same_numbers import TINY
from tests.contracts.emulated_bench import QUESTIONS, WatchedPort, rig_file, virtual_port
from tests.contracts.virtual_run import RunHere, run, without_motor

from sinew.emulator.bench import EmulatedRig
from sinew.hardware.registers import OVERLOAD


def with_torque(rig: EmulatedRig) -> None:
    for motor in (rig.motors[1], rig.motors[5]):
        assert motor.write(64, b"\1", 0.0) == 0


def with_offset(rig: EmulatedRig) -> None:
    rig.motors[2].registers["homing_offset"] = 100


def with_error(rig: EmulatedRig) -> None:
    rig.motors[3].fail(OVERLOAD)


def with_heat(rig: EmulatedRig) -> None:
    rig.motors[5].temperature = 75.9  # it cools while the bench is looked at, and counts whole degrees


def with_twins(rig: EmulatedRig) -> None:
    rig.motors[2].registers["id"] = 1
    rig.motors[2].restart(-0.777)  # no two motors are switched on in the same millisecond


def with_frozen_imu(rig: EmulatedRig) -> None:
    rig.imu.frozen = True


def without_imu(rig: EmulatedRig) -> None:
    rig.line.devices = [device for device in rig.line.devices if device.id != 200]


UNFIT_BENCHES: dict[str, tuple[Callable[[EmulatedRig], object], tuple[str, ...]]] = {
    "torque is on": (with_torque, ("torque on at tendon 1 and drive", "sinew stop", "--resume")),
    "homing offset": (with_offset, ("homing offset of 100 counts at tendon 2, expected 0", "sinew doctor --fix")),
    "hardware error": (with_error, ("hardware error: overload at tendon 3", "sinew doctor --fix")),
    "too warm": (with_heat, ("75 °C at drive, expected up to 70 °C", "cool")),
    "supply too low": (lambda rig: rig.set_supply(9.7), ("9.7 V at all motors", "10 to 14.8", "supply")),
    "supply too high": (lambda rig: rig.set_supply(15.2), ("15.2 V at all motors", "10 to 14.8", "supply")),
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
    spoil: Callable[[EmulatedRig], object], words: tuple[str, ...], run_here: RunHere
) -> None:
    spoil(run_here.port.rig)
    run_here.refused(words)
    assert not run_here.out.parent.exists()


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
        ("x of the head is not up: -9.", "expected +9.81, 0, 0", "imu_axes"),
    ),
    "lever far from its middle": (
        {"drive_zero_counts": 0},
        ("the lever stands", "180° from its middle, expected within", "(drive_amplitude_deg)", "turn it back by hand"),
    ),
    "unknown model": ({"drive_model": "XL320"}, ("XL320", "XM430-W350")),
    "baud too slow for the plan": (
        {"baud": 57_600},
        ("49.3 ms", "57600 baud", "200 Hz leave 5.0 ms", "lower sample_hz"),
    ),
}


@pytest.mark.parametrize(("wiring", "words"), UNFIT_RIGS.values(), ids=UNFIT_RIGS.keys())
def test_a_rig_that_is_not_the_bench_is_refused_with_a_reason_and_nothing_is_touched(
    wiring: dict[str, Any], words: tuple[str, ...], run_here: RunHere, tmp_path: Path
) -> None:
    run_here.refused(words, "--rig", rig_file(tmp_path, **wiring))
    assert not run_here.out.parent.exists()


def test_another_baud_than_the_devices_is_refused(
    plan: str, out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    port = virtual_port(monkeypatch, baud=57_600)
    told = run(capsys, plan, out)
    assert (told.status, told.err.count("\n"), out.parent.exists()) == (2, 1, False)
    assert "no device answers at 1000000 baud" in told.err
    assert port.codes <= QUESTIONS


def test_several_reasons_are_said_at_once(run_here: RunHere) -> None:
    for spoil in (with_torque, with_offset, with_heat):
        spoil(run_here.port.rig)
    run_here.refused(("torque on", "homing offset", "75 °C"))


def test_a_port_that_goes_away_while_the_bench_is_looked_at_is_a_refusal(run_here: RunHere) -> None:
    port = run_here.port
    port.agenda = [(port.now() + 0.01, lambda: setattr(port.rig, "unplugged", True))]
    run_here.refused(("the port is gone",))
    assert not run_here.out.parent.exists()


def test_a_plan_beyond_a_limit_of_the_rig_is_refused(run_here: RunHere, tmp_path: Path) -> None:
    path = tmp_path / "hard.toml"
    path.write_text(TINY.replace("[2]", "[20]"))
    replace(run_here, plan=str(path)).refused(("20 mm", "16", "pretension_mm"))
    assert not run_here.out.parent.exists()


@pytest.mark.parametrize(
    ("bend_deg", "words"),
    [(20, ("tendon 4 would be slack", "bend")), (50, ("50°", "the rig allows 40°"))],
    ids=["slack", "beyond the rig"],
)
def test_a_pose_that_the_joint_cannot_take_is_refused_and_nothing_is_touched(
    bend_deg: float, words: tuple[str, ...], run_here: RunHere, tmp_path: Path
) -> None:
    path = tmp_path / "bent.toml"
    path.write_text(f"{TINY}\n[pose]\nbend_deg = {bend_deg}\nazimuth_deg = 90\n")
    replace(run_here, plan=str(path)).refused(words)
    assert not run_here.out.parent.exists()


@pytest.mark.slow
def test_one_broken_reading_of_the_imu_is_no_refusal(
    plan: str, out: Path, port: WatchedPort, capsys: pytest.CaptureFixture[str]
) -> None:
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
