"""The doctor: what he finds on a bench in virtual time, what he would write, and what he leaves alone."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.unit.emulator_stand_in import Bench, paper_rig

from sinew.bench.doctor import call_roll, examine_motors, examine_port, search_bauds
from sinew.bench.doctor_fixes import apply_fixes, list_fixes
from sinew.bench.doctor_measures import (
    LoopTimes,
    examine_bus,
    examine_imu,
    examine_loop,
    judge_imu,
    listen_to_imu,
    time_loop,
)
from sinew.bench.finding import Finding, Fix, Severity
from sinew.emulator.plant import Law
from sinew.hardware.bus import Bus, BusTiming
from sinew.hardware.imu import ImuReading
from sinew.hardware.latency_timer import LatencyTimer, find_latency_timer
from sinew.hardware.rig import Rig

AXES = ("+x", "+y", "+z")


class Ward(Bench):
    """A bench with a rig on it, its sensor upright."""

    def __init__(self, wiring: dict[str, object] | None = None, **rig: object) -> None:
        super().__init__(paper_rig(), retries=1, imu_ppm=0.0, **rig)
        self.plant.acceleration = (9.80665, 0.0, 0.0)
        self.rigged = Rig(self.bus, self.port, paper_rig(**(wiring or {})))

    def findings(self) -> list[Finding]:
        roll = call_roll(self.rigged)
        return roll.findings + examine_motors(self.rigged, roll)

    def about(self, subject: str, *severities: Severity) -> list[str]:
        return [f.found for f in self.findings() if f.subject == subject and f.severity in severities]

    def fix_all(self) -> list[Finding]:
        return apply_fixes(self.rigged, self.port, list_fixes(self.findings()))

    def registers(self) -> list[bytes]:
        return [bytes(motor.registers.memory[:120]) for motor in self.rig.motors.values()]


@pytest.fixture
def ward() -> Ward:
    return Ward()


def test_every_motor_is_told_with_id_model_firmware_voltage_and_temperature(ward: Ward) -> None:
    assert ward.about("drive", "ok") == [
        "id 5, XM430-W350, firmware 47 (knows fast reads), 13.3 V, 25 °C, mode position"
    ]


def test_old_firmware_is_told_not_to_know_fast_reads() -> None:
    assert "firmware 44 (does not know fast reads)" in Ward(firmware=44).about("drive", "ok")[0]


def test_a_factory_new_bench_has_no_fault(ward: Ward) -> None:
    assert [finding for finding in ward.findings() if finding.severity == "fault"] == []


def test_a_missing_device_is_a_fault_with_its_name(ward: Ward) -> None:
    ward.rigged = Rig(ward.bus, ward.port, paper_rig(tendon_ids=(1, 2, 9, 4)))
    roll = call_roll(ward.rigged)
    assert roll.missing == ["tendon 3"]
    assert [f.severity for f in roll.findings if f.subject == "tendon 3"] == ["fault"]


def test_a_device_that_the_wiring_does_not_name_is_told_with_its_model(ward: Ward) -> None:
    ward.rigged = Rig(ward.bus, ward.port, paper_rig(tendon_ids=(1, 2, 9, 4)))
    assert ward.about("bus", "warning") == ["id 3 answers (XH430-W350)"]


def test_another_model_is_a_fault(ward: Ward) -> None:
    ward.rigged = Rig(ward.bus, ward.port, paper_rig(tendon_ids=(1, 2, 3, 5), drive_id=4))
    assert "is model 1020 (XM430-W350), expected 1000" in ward.about("tendon 4", "fault")[0]


def test_devices_at_another_baud_are_found_and_told(ward: Ward) -> None:
    slow = Bench(paper_rig(), baud=57_600)

    @contextmanager
    def open_bus(baud: int) -> Iterator[Bus]:
        slow.rig.line.host_baud = baud
        yield Bus(slow.port, slow.port, BusTiming(baud))

    findings = search_bauds(open_bus, 1_000_000, nobody=True)
    assert [(f.severity, f.found) for f in findings] == [("fault", "id 1, 2, 3, 4, 5, 200 at 57600 baud")]
    assert "--baud 57600" in findings[0].advice


def test_one_motor_at_another_baud_is_to_be_set_like_the_others(ward: Ward) -> None:
    ward.rig.motors[2].registers["baud_rate"] = 1

    @contextmanager
    def open_bus(baud: int) -> Iterator[Bus]:
        ward.rig.line.host_baud = baud
        yield Bus(ward.port, ward.port, BusTiming(baud))

    findings = search_bauds(open_bus, 1_000_000, nobody=False)
    assert [(f.found, f.advice) for f in findings] == [
        ("id 2 at 57600 baud", "set their register baud_rate to 3, as in the other motors")
    ]


def test_a_port_that_does_not_know_a_baud_is_no_trouble() -> None:
    from sinew.hardware.errors import PortError

    @contextmanager
    def open_bus(baud: int) -> Iterator[Bus]:
        raise PortError(f"cannot open at {baud}")
        yield

    assert [f.severity for f in search_bauds(open_bus, 1_000_000, nobody=True)] == ["note"]


REGISTERS = {
    "return delay": ("return_delay_time", 250, "return_delay_time 250 (0.0005 s)", "0 (0 s)"),
    "reversed": ("drive_mode", 1, "drive_mode 1", "0"),
    "hot": ("temperature_limit", 80, "temperature_limit 80 (80 °C)", "70 (70 °C)"),
    "current": ("current_limit", 648, "current_limit 648 (1.743 A)", "483 (1.299 A)"),
    "shutdown": ("shutdown", 4, "shutdown 4", "52"),
}


@pytest.mark.parametrize(("register", "count", "found", "expected"), REGISTERS.values(), ids=REGISTERS.keys())
def test_a_setting_that_is_not_the_rigs_is_told_and_can_be_fixed(
    ward: Ward, register: str, count: int, found: str, expected: str
) -> None:
    ward.rig.motors[1].registers[register] = count
    told = [f for f in ward.findings() if f.subject == "tendon 1" and f.found == found]
    assert [(f.expected, f.fixable) for f in told] == [(expected, True)]


TROUBLES = {
    "torque": ("torque_enable", 1, "torque on", False),
    "offset": ("homing_offset", 50, "homing offset of 50 counts", True),
}


@pytest.mark.parametrize(("register", "count", "found", "fixable"), TROUBLES.values(), ids=TROUBLES.keys())
def test_a_state_in_which_a_run_is_refused_is_a_fault(
    ward: Ward, register: str, count: int, found: str, fixable: bool
) -> None:
    ward.rig.motors[2].registers[register] = count
    faults = [f for f in ward.findings() if f.severity == "fault"]
    assert [(f.subject, f.found, f.fixable) for f in faults] == [("tendon 2", found, fixable)]
    assert faults[0].advice


def test_a_hardware_error_is_a_fault_with_its_name(ward: Ward) -> None:
    ward.rig.motors[2].fail(0x20)
    faults = [f for f in ward.findings() if f.severity == "fault"]
    assert [(f.subject, f.found, f.fixable) for f in faults] == [("tendon 2", "hardware error: overload", True)]


def test_limits_within_which_the_drive_would_ignore_goals_are_a_fault_that_can_be_fixed(ward: Ward) -> None:
    ward.rig.motors[5].registers["min_position_limit"] = 1800
    faults = ward.about("drive", "fault")
    ward.fix_all()
    assert (faults, ward.about("drive", "fault")) == (["min_position_limit 1800 (2.761 rad)"], [])


def test_a_watchdog_that_has_tripped_is_told(ward: Ward) -> None:
    ward.rig.motors[2].registers["bus_watchdog"] = -1
    assert ward.about("tendon 2", "warning") == ["stopped by its bus watchdog"]


@pytest.mark.parametrize(("degrees", "severity"), [(59, None), (65, "warning"), (71, "fault")])
def test_a_motor_near_and_beyond_the_rigs_temperature_is_told(ward: Ward, degrees: int, severity: str | None) -> None:
    motor = ward.rig.motors[3]
    refresh = motor.refresh

    def hot(address: int, length: int, now: float) -> None:
        refresh(address, length, now)
        motor.registers["present_temperature"] = degrees

    motor.refresh = hot  # type: ignore[method-assign]
    told = [f.severity for f in ward.findings() if f.subject == "tendon 3" and f.found == f"{degrees} °C"]
    assert told == ([severity] if severity else [])


def test_a_supply_outside_the_rigs_window_is_a_fault_of_every_motor(ward: Ward) -> None:
    ward.rig.set_supply(9.7)
    assert [f.found for f in ward.findings() if f.severity == "fault"] == ["9.7 V"] * 5


@pytest.mark.parametrize("level", [0, 1])
def test_a_motor_that_does_not_answer_everything_is_a_fault_that_can_be_fixed(ward: Ward, level: int) -> None:
    ward.rig.motors[4].registers["status_return_level"] = level
    found = [f.fixable for f in ward.findings() if f.subject == "tendon 4" and f.severity == "fault"]
    ward.fix_all()
    assert (found, ward.about("tendon 4", "fault")) == ([True], [])


def test_after_the_fixes_nothing_is_left_to_be_told(ward: Ward) -> None:
    for motor in ward.rig.motors.values():
        motor.registers["homing_offset"] = 7
        motor.registers["bus_watchdog"] = -1
        motor.registers["drive_mode"] = 4
    written = ward.fix_all()
    assert {finding.severity for finding in written} == {"ok"}
    assert {finding.severity for finding in ward.findings()} == {"ok"}


def test_examining_writes_no_register(ward: Ward) -> None:
    before = ward.registers()
    ward.findings()
    examine_imu(ward.rigged, ward.port, 0.5)
    time_loop(ward.rigged, ward.port, 0.2)
    assert ward.registers() == before


def test_neither_examination_nor_fixes_move_a_motor_or_switch_a_torque_on(ward: Ward) -> None:
    laws: list[Law] = []
    put = ward.plant.set_law
    ward.plant.set_law = lambda motor, law: (laws.append(law), put(motor, law))[1]  # type: ignore[method-assign,func-returns-value]
    ward.rig.motors[1].fail()
    ward.fix_all()
    time_loop(ward.rigged, ward.port, 0.2)
    assert {law.kind for law in laws} <= {"off"}
    assert ward.plant.angles == [0.0] * 5


def test_a_motor_under_torque_is_left_as_it_is(ward: Ward) -> None:
    ward.put(1, "torque_enable", 1)
    before = ward.registers()[0]
    written = ward.fix_all()
    refused = {finding.severity for finding in written if finding.subject == "tendon 1"}
    assert (refused, ward.registers()[0]) == ({"warning"}, before)
    assert any("torque on, expected off to write current_limit" in finding.found for finding in written)


def test_a_motor_that_has_shut_down_is_rebooted(ward: Ward) -> None:
    ward.rig.motors[2].fail()
    fixes = list_fixes(ward.findings())
    written = apply_fixes(ward.rigged, ward.port, [fix for fix in fixes if fix.register == "reboot"])
    assert [finding.found for finding in written] == ["rebooted"]
    assert ward.about("tendon 2", "fault") == []


def test_what_makes_a_motor_answer_is_written_first() -> None:
    rows = [Fix("drive", name, 1, 0) for name in ("current_limit", "bus_watchdog", "reboot", "status_return_level")]
    ordered = list_fixes([Finding("fault", "drive", "", fix=fix) for fix in rows])
    assert [fix.register for fix in ordered] == ["status_return_level", "reboot", "bus_watchdog", "current_limit"]


def test_a_lost_motor_costs_only_its_own_fix(ward: Ward) -> None:
    fixes = list_fixes(ward.findings())
    ward.rig.line.disturb_up = lambda now, data: [] if data[4] == 1 else [(now, data)]
    written = apply_fixes(ward.rigged, ward.port, fixes)
    assert {f.severity for f in written if f.subject == "tendon 1"} == {"warning"}
    assert {f.severity for f in written if f.subject != "tendon 1"} == {"ok"}


def adapter(tmp_path: Path, milliseconds: str) -> tuple[str, Path]:
    folder = tmp_path / "ttyUSB3"
    folder.mkdir()
    (folder / "latency_timer").write_text(milliseconds)
    return "/dev/ttyUSB3", tmp_path


def test_a_latency_timer_of_16_ms_is_told_and_set(ward: Ward, tmp_path: Path) -> None:
    timer = find_latency_timer(*adapter(tmp_path, "16\n"))
    findings = examine_port(timer, 1_000_000, 1_000_000)
    assert [(f.severity, f.fixable) for f in findings] == [("warning", True)]
    written = apply_fixes(ward.rigged, ward.port, list_fixes(findings), timer)
    assert timer is not None
    assert (written[0].severity, timer.read()) == ("ok", 1)


def test_a_latency_timer_of_1_ms_is_fine(tmp_path: Path) -> None:
    timer = find_latency_timer(*adapter(tmp_path, "1\n"))
    assert [f.severity for f in examine_port(timer, 1_000_000, 1_000_000)] == ["ok"]


def test_a_timer_that_may_not_be_written_is_told_with_the_command_for_it(ward: Ward, tmp_path: Path) -> None:
    timer = LatencyTimer(tmp_path / "no such folder" / "latency_timer")
    written = apply_fixes(ward.rigged, ward.port, [Fix("port", "latency_timer", 16, 1)], timer)
    assert written[0].severity == "warning"
    assert "as administrator: echo 1 > " in written[0].found


@pytest.mark.parametrize("port", ["/dev/ttyACM0", "/dev/pts/4", "bench"])
def test_a_port_without_such_an_adapter_has_no_timer(tmp_path: Path, port: str) -> None:
    assert find_latency_timer(port, tmp_path) is None


def test_a_link_to_the_port_leads_to_its_timer(tmp_path: Path) -> None:
    _, system = adapter(tmp_path, "16")
    (tmp_path / "ttyUSB3.device").touch()
    link = tmp_path / "by-id"
    link.symlink_to("/dev/ttyUSB3")
    assert find_latency_timer(str(link), system) is not None


def test_a_baud_that_is_not_the_wirings_is_told() -> None:
    assert examine_port(None, 57_600, 1_000_000)[0].found == "57600 baud"


def test_rate_bias_and_gravity_of_a_sensor_at_rest_are_told(ward: Ward) -> None:
    findings = examine_imu(ward.rigged, ward.port)
    assert [f.severity for f in findings] == ["ok"]
    assert findings[0].found.startswith("200 samples/s, bias ")


def test_the_sensor_is_listened_to_for_two_seconds_and_no_sample_is_missed(ward: Ward) -> None:
    begun = ward.port.now()
    samples, answers = listen_to_imu(ward.rigged, ward.port)
    assert ward.port.now() - begun == pytest.approx(2.0, abs=0.02)
    assert len(samples) == pytest.approx(400, abs=2)
    assert answers == pytest.approx(800, abs=2)


def test_a_frozen_sensor_is_a_fault(ward: Ward) -> None:
    ward.wait(0.1)
    ward.rig.imu.frozen = True
    assert [f.severity for f in examine_imu(ward.rigged, ward.port, 0.3)] == ["fault"]


def test_a_silent_sensor_is_a_fault(ward: Ward) -> None:
    ward.rig.line.disturb_up = lambda now, data: [] if data[4] == 200 else [(now, data)]
    assert [f.severity for f in examine_imu(ward.rigged, ward.port, 0.3)] == ["fault"]


def samples(
    force: tuple[float, float, float] = (9.81, 0, 0), gyro: float = 0.0, swing: float = 0.0, period: int = 5000
) -> list[ImuReading]:
    return [
        ImuReading((gyro + swing * math.sin(i), 0.0, 0.0), force, (2**32 - 300_000 + period * i) % 2**32, 0.0)
        for i in range(400)
    ]


def test_missed_samples_do_not_lower_the_rate() -> None:
    holes = [sample for i, sample in enumerate(samples()) if i % 3 and i % 7]
    assert judge_imu(holes, AXES)[0].found.startswith("200 samples/s")


def test_a_slow_sensor_is_a_warning() -> None:
    assert [f.found for f in judge_imu(samples(period=20_000), AXES)[1:]] == ["50 samples/s"]


def test_a_bus_too_slow_for_the_sensor_is_no_fault_of_the_sensor() -> None:
    ward = Ward(baud=57_600)
    ward.rig.line.host_baud = 57_600
    ward.bus.timing = BusTiming(57_600)
    findings = examine_imu(ward.rigged, ward.port)
    assert [f.severity for f in findings] == ["ok"]
    assert findings[0].found.startswith("at least ")


def test_where_nobody_answers_one_sentence_says_so() -> None:
    ward = Ward(baud=57_600)
    roll = call_roll(ward.rigged)
    assert [f.found for f in roll.findings] == ["no device of the wiring answers at 1000000 baud"]


def test_a_large_bias_is_a_warning() -> None:
    assert [f.found for f in judge_imu(samples(gyro=math.radians(2.5)), AXES)[1:]] == ["bias of 2.5 °/s"]


def test_a_head_that_moves_is_a_warning_and_its_bias_is_not_judged() -> None:
    findings = judge_imu(samples(gyro=math.radians(2.5), swing=math.radians(5)), AXES)
    assert [f.advice.split(";")[0] for f in findings[1:]] == ["examine it at rest"]


def test_another_gravity_is_a_fault() -> None:
    assert [f.found for f in judge_imu(samples((4.9, 0, 0)), AXES)[1:]] == ["4.90 m/s² at rest"]


@pytest.mark.parametrize(
    ("force", "axes", "advised"),
    [
        ((0, 0, 9.81), AXES, '["+z", "+x", "+y"]'),
        ((-9.81, 0, 0), AXES, '["-x", "+y", "-z"]'),
        ((0, -9.81, 0), AXES, '["-y", "+z", "-x"]'),
        ((0, 9.81, 0), ("+z", "+x", "+y"), '["+x", "+y", "+z"]'),
    ],
)
def test_a_sensor_that_is_mounted_otherwise_is_a_fault_with_axes_that_put_x_up(
    force: tuple[float, float, float], axes: tuple[str, ...], advised: str
) -> None:
    findings = judge_imu(samples(force), axes)
    assert findings[-1].severity == "fault"
    assert advised in findings[-1].advice


def test_a_sensor_between_its_axes_is_to_be_levelled() -> None:
    assert judge_imu(samples((6.9, 6.9, 0)), AXES)[-1].advice.startswith("level the rig")


def test_the_advised_axes_do_put_x_up() -> None:
    ward = Ward()
    ward.plant.acceleration = (0.0, 0.0, -9.80665)
    advice = examine_imu(ward.rigged, ward.port, 0.3)[-1].advice
    axes = tuple(advice[advice.index("[") + 1 : advice.index("]")].replace('"', "").split(", "))
    ward.rigged = Rig(ward.bus, ward.port, paper_rig(imu_axes=axes))
    assert [f.severity for f in examine_imu(ward.rigged, ward.port, 0.3)] == ["ok"]


def test_the_time_of_a_reading_is_what_its_bytes_need_on_the_wire() -> None:
    ward = Ward(return_delay=0)
    ward.port.host_cost = 0.0
    times = time_loop(ward.rigged, ward.port, 0.3)
    wire = (ward.rigged.cycle_bytes - 55) * 10 / 1e6  # without the goals
    assert times.median == pytest.approx(wire, abs=0.1e-3)
    assert times.incomplete == 0


def test_a_factory_new_return_delay_costs_half_a_millisecond_for_each_motor() -> None:
    fast, slow = Ward(return_delay=0), Ward(return_delay=250)
    medians = [time_loop(ward.rigged, ward.port, 0.3).median for ward in (fast, slow)]
    assert medians[1] - medians[0] == pytest.approx(5 * 0.5e-3, abs=0.2e-3)


@pytest.mark.parametrize(("most", "severity"), [(3.0e-3, "ok"), (4.5e-3, "warning")])
def test_a_loop_too_slow_for_the_plan_is_a_warning(most: float, severity: str) -> None:
    times = LoopTimes(300, 2.5e-3, most, 5e-3, 0.55e-3, 0)
    assert [f.severity for f in examine_loop(times, 200.0)] == [severity]


def test_a_bus_without_errors_is_fine(ward: Ward) -> None:
    times = time_loop(ward.rigged, ward.port, 0.2)
    assert [f.severity for f in examine_bus(ward.rigged, times)] == ["ok"]


def test_lost_and_damaged_answers_are_counted_and_told(ward: Ward) -> None:
    number = iter(range(10**6))
    ward.rig.line.disturb_up = lambda now, data: (
        [(now, data[:-1] + bytes((data[-1] ^ 1,)))] if next(number) % 50 == 0 else [(now, data)]
    )
    times = time_loop(ward.rigged, ward.port, 1.0)
    (finding,) = examine_bus(ward.rigged, times)
    assert finding.severity == "warning"
    assert f"{times.incomplete} of {times.cycles} readings incomplete" in finding.found
    assert "with a wrong CRC" in finding.found
