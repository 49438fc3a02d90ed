"""The doctor's fixes: what he would write, in which order, and what he leaves alone."""

import pytest
from tests.unit.bench_ward import Ward

from sinew.bench.doctor import Finding, Fix, apply_fixes, examine_imu, list_fixes, time_loop
from sinew.emulator.plant import Law
from sinew.measure.errors import PortError


@pytest.fixture
def ward() -> Ward:
    return Ward()


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


def test_a_port_that_goes_while_motors_are_written_ends_the_fixes(ward: Ward, monkeypatch: pytest.MonkeyPatch) -> None:
    fixes = list_fixes(ward.findings())

    def gone(_: bytes) -> None:
        raise PortError("the port is gone")

    monkeypatch.setattr(ward.port, "write", gone)
    with pytest.raises(PortError, match="the port is gone"):
        apply_fixes(ward.rigged, ward.port, fixes)
