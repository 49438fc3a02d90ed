"""Every run begins from one known state: all of it is written and read back, and a write that is lost is refused."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from tests.unit.bench_virtual import VirtualBench, virtual_bench
from tests.unit.emulator_stand_in import StandIn

from sinew.bench.doctor import call_roll, examine_motors
from sinew.bench.preflight import refuse_unready
from sinew.bench.record.journal import Journal, JournalReader
from sinew.bench.run import Runner
from sinew.bench.stops import stop
from sinew.hardware.configuration import KNOWN_STATE
from sinew.hardware.registers import Register
from sinew.hardware.rig import Reading
from sinew.measure.errors import DeviceError, StartError
from sinew.measure.events import Event, Pretensioned
from sinew.plan.plan import TendonMode
from sinew.plan.toml import dump_plan, dump_rig, load_rig, parse_plan

SPEC = load_rig("paper")
PLAN = parse_plan(
    'name = "short"\n[pretension]\npretension_mm = [2]\nrest_s = 0.3\n'
    "[sweep]\nfrequency_hz = [3.4]\nsettle_s = 0.3\nperiods = 2\nrepeats = 1"
)
TENSION = {2.0: 20.0}
MODES: tuple[TendonMode, ...] = ("position", "position-with-current-limit", "current")
# What a run brings to its value; the others it refuses where they are wrong.
WRITTEN = sorted({row.register for row in KNOWN_STATE if not row.is_refused})
REFUSED = {
    "shadow_id": 7,
    "homing_offset": 20,
    "max_position_limit": 2500,
    "min_position_limit": 1500,
    "current_limit": 3,
}


def still_bench() -> VirtualBench:
    """Return a bench whose motors have nothing to pull and whose sensor stands upright."""
    plant = StandIn()
    plant.acceleration = (9.81, 0.0, 0.0)
    return virtual_bench(SPEC, plant=plant)


def another(row: Register, right: int) -> int:
    """Return a value that a register can hold and that is not the right one, nor a stricter limit."""
    if row.name in ("min_voltage_limit", "min_position_limit", "shutdown"):
        return row.lowest
    return row.highest if row.highest != right else row.lowest


@pytest.fixture(scope="module")
def right() -> VirtualBench:
    """Return a bench in its known state."""
    bench = still_bench()
    bench.rig.configure()
    return bench


@pytest.mark.parametrize(
    ("device", "register"),
    # A tendon motor's modes have no limits of position.
    [(device, name) for device in (3, 5) for name in WRITTEN if device == 5 or not name.endswith("position_limit")],
)
def test_a_start_whose_write_to_a_register_is_lost_is_refused_by_its_name(
    right: VirtualBench, device: int, register: str, tmp_path: Path
) -> None:
    bench = still_bench()
    motor = bench.emulated.motors[device]
    if device == 3 and register != "operating_mode":
        motor.registers["operating_mode"] = 5  # as a run leaves it: a change of mode would put much of it right
    motor.registers[register] = another(
        motor.registers.rows[register], right.emulated.motors[device].registers[register]
    )
    motor.loses = {register}
    with pytest.raises(StartError, match=rf"(?s)\(id {device}\) has .* in {register}"):
        bench.run(PLAN, tmp_path, TENSION)
    assert not any(state.torque for state in bench.emulated.states().values())


@pytest.mark.parametrize("register", ["torque_enable", "bus_watchdog"])
def test_a_motor_that_loses_torque_or_watchdog_ends_the_run_by_that_name(register: str, tmp_path: Path) -> None:
    bench = still_bench()
    bench.emulated.motors[1].loses = {register}
    report = bench.run(PLAN, tmp_path, TENSION)
    assert (report.groups_done, f"{register}" in report.sentence) == (0, True)


def test_a_motor_that_keeps_a_goal_far_from_where_it_stands_gets_no_torque(tmp_path: Path) -> None:
    bench = still_bench()
    bench.emulated.motors[5].registers["goal_position"] = 3000
    bench.emulated.motors[5].loses = {"goal_position"}
    report = bench.run(PLAN, tmp_path, TENSION)
    assert "3000 in goal_position" in report.sentence
    assert report.groups_done == 0


@pytest.mark.slow
def test_a_lever_that_stands_aside_comes_home_evenly_once_the_wiring_is_known(tmp_path: Path) -> None:
    bench = virtual_bench(SPEC)
    plant = bench.emulated.plant
    plant.place_lever(0.3)
    path, advance = [], plant.advance

    def advance_and_note(until: float) -> None:
        advance(until)
        path.append((until, plant.horn(4).angle))

    plant.advance = advance_and_note  # type: ignore[method-assign]
    bench.run(PLAN, tmp_path, TENSION)
    times, angles = np.array(path).T
    home = int(np.argmax(angles < 0.003))
    stands = 0.3 - math.radians(3.0)  # behind the move that shows the drive's sign
    begin = int(np.flatnonzero(angles[:home] > stands - 0.003)[-1])
    assert np.diff(angles[: home + 1]).max() <= 1e-3  # a count is 1.5e-3
    assert times[home] - times[begin] == pytest.approx(1.5, rel=0.1)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    "register", [row.register for row in KNOWN_STATE if row.register.startswith(("goal", "profile", "position_p"))]
)
def test_after_a_change_of_mode_all_is_written_and_read_back_again(mode: TendonMode, register: str) -> None:
    bench = still_bench()
    bench.rig.configure()
    motor = bench.emulated.motors[2]
    tendon = bench.rig.tendons[1]
    bench.rig.prepare_tendon(tendon, mode)
    right = motor.registers[register]
    motor.registers[register] = right + 1 if right < motor.registers.rows[register].highest else right - 1
    motor.loses = {register}
    with pytest.raises(DeviceError, match=rf"in {register} after {right} was written"):
        bench.rig.prepare_tendon(tendon, mode)


@pytest.mark.parametrize("register", REFUSED)
def test_what_a_run_must_not_overwrite_is_refused_by_name_before_anything_is_written(
    register: str, tmp_path: Path
) -> None:
    bench = still_bench()
    device = 5 if register.endswith("position_limit") else 2
    bench.emulated.motors[device].registers[register] = REFUSED[register]
    with pytest.raises(StartError, match=register.replace("_", "[_ ]")):
        bench.run(PLAN, tmp_path, TENSION)
    assert bench.emulated.motors[device].registers[register] == REFUSED[register]
    assert bench.emulated.motors[1].registers["temperature_limit"] == 80


def test_the_imus_control_register_is_brought_to_rest() -> None:
    bench = still_bench()
    bench.emulated.imu.registers["imu_control"] = 9
    bench.rig.configure()
    assert bench.emulated.imu.registers["imu_control"] == 0


@pytest.mark.parametrize("mode", MODES)
def test_the_known_state_has_the_gains_of_the_twin_whatever_was_there(mode: TendonMode) -> None:
    bench = still_bench()
    for motor in bench.emulated.motors.values():
        motor.registers["position_p_gain"], motor.registers["goal_pwm"] = 111, 177
    bench.rig.configure()
    bench.rig.set_tendon_mode(mode)
    drive = SPEC.drive
    gains = [motor.registers["position_p_gain"] for motor in bench.emulated.motors.values()]
    # Duty per radian: P/128 counts of PWM per pulse, 4096 pulses a turn, 885 counts are the whole supply.
    assert gains[4] / 128 * 4096 / (2 * np.pi) / 885 == pytest.approx(drive.position_gain.value, rel=1e-3)
    assert gains[:4] == [900] * 4
    assert {motor.registers["goal_pwm"] for motor in bench.emulated.motors.values()} == {885}


def test_the_limit_of_the_drives_duty_is_the_rigs() -> None:
    limited = SPEC.drive.duty_limit.model_copy(update={"value": 0.6})
    spec = SPEC.model_copy(update={"drive": SPEC.drive.model_copy(update={"duty_limit": limited})})
    bench = virtual_bench(spec, plant=StandIn())
    bench.rig.configure()
    assert [bench.emulated.motors[5].registers[name] for name in ("pwm_limit", "goal_pwm")] == [531, 531]


def test_the_doctor_is_silent_on_the_goals_that_every_stop_leaves() -> None:
    bench = still_bench()
    bench.rig.configure()
    stop(bench.rig, bench.port, "release")
    bench.rig.drive.set_count("goal_pwm", 177)
    findings = examine_motors(bench.rig, call_roll(bench.rig))
    assert [finding.found for finding in findings if finding.severity != "ok"] == []


@pytest.mark.parametrize(("register", "count"), [("position_p_gain", 700), ("torque_enable", 0), ("goal_pwm", 177)])
def test_a_register_that_is_no_longer_as_the_run_set_it_is_named(register: str, count: int) -> None:
    bench = still_bench()
    bench.rig.configure()
    bench.rig.set_tendon_mode("position")
    bench.rig.drive.torque_on()
    before = bench.rig.changed_registers(bench.rig.read_registers())
    bench.emulated.motors[5].registers[register] = count
    (changed,) = bench.rig.changed_registers(bench.rig.read_registers())
    assert (before, changed.startswith(f"{register} of drive (id 5) reads {count}, ")) == ([], True)


def test_what_the_run_itself_tells_does_not_count_as_changed() -> None:
    bench = still_bench()
    bench.rig.configure()
    bench.rig.set_tendon_mode("current")
    bench.rig.write_goals(0.0, [0.1] * 4)
    assert bench.rig.changed_registers(bench.rig.read_registers()) == []


class Meddler:
    """Other software that writes to the drive once, when the pretension is set; a Listener."""

    def __init__(self, bench: VirtualBench) -> None:
        self.bench = bench

    def on_sample(self, sample: object) -> None:
        pass

    def on_event(self, event: Event) -> None:
        if isinstance(event, Pretensioned):
            self.bench.emulated.motors[5].registers["position_p_gain"] = 700


@pytest.mark.slow
def test_a_register_that_changes_during_a_group_stops_the_run_and_the_group_does_not_count(tmp_path: Path) -> None:
    bench = virtual_bench(SPEC)
    path = tmp_path / "journal.sqlite"
    with Journal.create(path, dump_plan(PLAN), dump_rig(SPEC)) as journal:
        report = Runner(bench.rig, bench.port, PLAN, journal, TENSION, listener=Meddler(bench)).run()
    with JournalReader(path) as reader:
        assert (report.groups_done, reader.finished()) == (0, {})
    assert "position_p_gain of drive (id 5) reads 700, 800 when the run set it" in report.sentence


def turning_bench(bias: float, swing: float) -> VirtualBench:
    """Return a still bench whose gyroscope has a bias and sees a swing [rad/s]."""
    bench = still_bench()
    plant = bench.emulated.plant
    motion = plant.motion

    def swinging() -> object:
        plant.gyro = (bias + swing * math.sin(20 * plant.time), 0.0, 0.0)
        return motion()

    plant.motion = swinging
    return bench


def test_a_baud_that_no_read_fits_into_a_cycle_is_refused_before_any_device_is_asked() -> None:
    wiring = SPEC.wiring.model_copy(update={"baud": 57_600})
    bench = virtual_bench(SPEC.model_copy(update={"wiring": wiring}), plant=StandIn())
    with pytest.raises(StartError, match=r"57600 baud.*lower sample_hz"):
        refuse_unready(bench.rig, bench.port, PLAN)
    assert bench.rig.bus.statistics.transactions == 0


def test_an_imu_that_falls_silent_at_the_start_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = still_bench()
    # It answers the two looks before anything starts, and two of those that tell whether the head rests.
    read, answers = bench.rig.read, iter((True,) * 4)

    def fading() -> Reading:
        reading = read()
        return reading if next(answers, False) else dataclasses.replace(reading, imu=None)

    monkeypatch.setattr(bench.rig, "read", fading)
    # It is looked at every 20 ms for half a second.
    with pytest.raises(StartError, match=r"2 readings of the IMU came within 10 s, expected 25 .* check its cable"):
        bench.run(PLAN, tmp_path, TENSION)
    assert not any(state.torque for state in bench.emulated.states().values())


def test_a_head_that_does_not_come_to_rest_is_refused(tmp_path: Path) -> None:
    bench = turning_bench(0.0, 0.2)
    with pytest.raises(StartError, match=r"still turns to and fro by 2\d\.\d °/s after 10 s"):
        bench.run(PLAN, tmp_path, TENSION)
    assert not any(state.torque for state in bench.emulated.states().values())


def test_a_gyroscope_with_a_bias_keeps_no_run_from_its_begin(tmp_path: Path) -> None:
    report = turning_bench(0.3, 0.0).run(PLAN, tmp_path, TENSION)
    assert report.sentence.startswith("tendon 1 has travelled")  # which have no end on this stand-in, and come after
