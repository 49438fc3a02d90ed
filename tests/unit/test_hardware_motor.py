"""One motor on the bus: registers by name, torque, watchdog, modes, and a sentence for what it does not do."""

import pytest
from tests.unit.emulator_stand_in import Bench
from tests.unit.hardware_line import Line, ManualClock, Slave

from sinew.hardware.believable import STATE, contradiction
from sinew.hardware.bus import Bus, BusTiming
from sinew.hardware.codec import READ
from sinew.hardware.configuration import answer_everything
from sinew.hardware.motor import RETRIES, Motor, name_hardware_errors
from sinew.hardware.registers import (
    XH430_W350,
    lay_out,
)
from sinew.measure.errors import DeviceError, RegisterError


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def motor(bench: Bench) -> Motor:
    return Motor(bench.bus, "tendon 2", 2, XH430_W350)


def alone(slave: Slave) -> tuple[Motor, Line]:
    clock = ManualClock()
    line = Line(clock, slave)
    return Motor(Bus(line, clock, BusTiming(latency=2e-3), 0), "tendon 2", slave.id, XH430_W350), line


def test_an_absent_motor_is_refused_with_its_name_and_id() -> None:
    motor, _ = alone(Slave(2, absent=True))
    with pytest.raises(DeviceError, match=r"tendon 2 .*XH430-W350 at id 2; check its cable"):
        motor.identify()


def test_an_absent_motor_is_asked_a_bounded_number_of_times() -> None:
    motor, line = alone(Slave(2, absent=True))
    with pytest.raises(DeviceError):
        motor.get("present_position")
    assert len(line.sent) == 1 + RETRIES


def test_a_failed_read_names_motor_and_register() -> None:
    motor, _ = alone(Slave(2, absent=True))
    with pytest.raises(DeviceError, match=r"present_position of tendon 2 \(id 2\).* sent nothing"):
        motor.get("present_position")


def test_a_refused_write_names_register_count_and_reason(bench: Bench, motor: Motor) -> None:
    motor.torque_on()
    sentence = r"cannot write 3 to operating_mode of tendon 2 \(id 2\): .*locked while the torque is on"
    with pytest.raises(DeviceError, match=sentence):
        motor.set_count("operating_mode", 3)


def test_a_count_that_a_register_cannot_hold_is_not_sent(bench: Bench, motor: Motor) -> None:
    before = bench.bus.statistics.transactions
    with pytest.raises(RegisterError, match="current_limit cannot hold 649"):
        motor.set_count("current_limit", 649)
    assert bench.bus.statistics.transactions == before


def test_registers_out_of_order_have_no_layout() -> None:
    with pytest.raises(RegisterError, match="by increasing address"):
        lay_out(XH430_W350, ("shutdown", "return_delay_time"))


class Deaf(Line):
    """Devices that answer to writes and do nothing."""

    def write(self, data: bytes) -> None:
        kept = {id_: bytes(slave.memory) for id_, slave in self.slaves.items()}
        super().write(data)
        for id_, memory in kept.items():
            self.slaves[id_].memory[:] = memory


@pytest.mark.parametrize(("is_on", "act"), [(0, Motor.torque_on), (1, Motor.torque_off)])
def test_torque_that_does_not_change_is_an_error(is_on: int, act) -> None:  # type: ignore[no-untyped-def]
    clock, slave = ManualClock(), Slave(2)
    slave.memory[64] = is_on
    motor = Motor(Bus(Deaf(clock, slave), clock, BusTiming(latency=2e-3)), "tendon 2", 2, XH430_W350)
    with pytest.raises(DeviceError, match=r"tendon 2 \(id 2\) (took no|kept its) torque"):
        act(motor)


@pytest.mark.parametrize(("seconds", "units"), [(0.08, 4), (0.1, 5), (0.119, 5), (0.001, 1), (2.54, 127)])
def test_the_watchdog_is_set_in_whole_units_of_20_ms_and_at_least_one(
    bench: Bench, motor: Motor, seconds: float, units: int
) -> None:
    motor.arm_watchdog(seconds)
    assert bench.get(2, "bus_watchdog") == units


def test_a_watchdog_longer_than_the_register_is_refused(motor: Motor) -> None:
    with pytest.raises(RegisterError, match="bus_watchdog cannot hold 150"):
        motor.arm_watchdog(3.0)


def test_arming_clears_a_watchdog_that_has_tripped(bench: Bench, motor: Motor) -> None:
    motor.torque_on()
    motor.arm_watchdog(0.04)
    bench.wait(0.1)
    motor.arm_watchdog(0.04)
    assert not motor.watchdog_tripped()


def test_a_goal_refused_by_a_tripped_watchdog_says_so(bench: Bench, motor: Motor) -> None:
    motor.torque_on()
    motor.arm_watchdog(0.04)
    bench.wait(0.1)
    with pytest.raises(DeviceError, match=r"tendon 2 \(id 2\) .*goal_position.* bus watchdog"):
        motor.set_count("goal_position", 2048)


def test_hardware_errors_have_the_names_of_the_manual() -> None:
    assert name_hardware_errors(0b10_0101) == ("input voltage", "overheating", "overload")


def test_a_motor_that_says_another_goal_than_before_though_nobody_wrote_contradicts_itself(motor: Motor) -> None:
    before = motor.get_counts(STATE)
    assert contradiction(motor.table, before, before | {"present_current": 5}, 0.01) == ""
    told = contradiction(motor.table, before, before | {"goal_velocity": 5}, 0.01)
    assert told == f"goal_velocity is {before['goal_velocity']} and then 5"


def test_a_motor_that_answers_everything_is_only_asked_whether_it_does() -> None:
    slave = Slave(3)
    slave.memory[68] = 2  # status return level
    motor, line = alone(slave)
    answer_everything(motor)
    assert {packet.code for packet in line.sent} == {READ}
