"""The doctor: who answers on a bench in virtual time, and what he finds on the motors."""

import pytest
from tests.unit.bench_ward import Ward
from tests.unit.emulator_stand_in import paper_rig

from sinew.bench.doctor import call_roll
from sinew.hardware.rig import Rig


@pytest.fixture
def ward() -> Ward:
    return Ward()


def test_every_motor_is_told_with_id_model_firmware_voltage_and_temperature(ward: Ward) -> None:
    (told,) = ward.about("drive", "ok")
    facts = ("id 5", "XM430-W350", "firmware 47", "13.3 V", "25 °C", "mode position")
    assert [fact for fact in facts if fact not in told] == []


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


def test_limits_of_a_run_about_another_middle_are_a_fault_that_can_be_fixed(ward: Ward) -> None:
    registers = ward.rig.motors[5].registers
    registers["min_position_limit"], registers["max_position_limit"] = 1800, 1800 + 2 * 1024  # 90° either way
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
