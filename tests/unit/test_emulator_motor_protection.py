"""An emulated motor that protects itself: overload, heat, voltage, and the shutdown that follows."""

from tests.unit.emulator_motor_bench import FAIL, HOT, OVERLOAD, SHOCK, VOLTAGE, M, running
from tests.unit.emulator_stand_in import Bench


def test_a_stall_of_a_second_is_an_overload_and_takes_the_torque_off() -> None:
    bench = running()
    bench.plant.current[0] = 1.1
    bench.wait(0.9)
    before = bench.get(M, "torque_enable")
    bench.wait(0.2)
    assert (before, bench.get(M, "torque_enable"), bench.get(M, "hardware_error_status")) == (1, 0, OVERLOAD)


def test_a_stall_that_pauses_is_no_overload() -> None:
    bench = running()
    for _ in range(4):
        bench.plant.current[0] = 1.3
        bench.wait(0.7)
        bench.plant.current[0] = 0.2
        bench.wait(0.1)
    assert bench.get(M, "hardware_error_status") == 0


def test_an_overload_that_is_not_in_the_shutdown_mask_is_only_an_alert() -> None:
    bench = Bench()
    bench.put(M, "shutdown", HOT)
    bench.put(M, "torque_enable", 1)
    bench.plant.current[0] = 1.3
    bench.wait(1.2)
    assert (bench.get(M, "torque_enable"), bench.bus.ping(M).alert) == (1, True)


def test_a_motor_that_carries_current_grows_warm_and_is_shut_down_at_its_limit() -> None:
    bench = Bench()
    bench.put(M, "temperature_limit", 30)
    bench.put(M, "torque_enable", 1)
    bench.plant.current[0] = 0.9
    bench.wait(120.0)
    assert (bench.get(M, "hardware_error_status"), bench.get(M, "torque_enable")) == (HOT, 0)


def test_a_motor_at_rest_stays_at_room_temperature() -> None:
    bench = running()
    bench.wait(60.0)
    assert bench.get(M, "present_temperature") == 25


def test_a_bad_voltage_raises_the_alert_and_leaves_the_torque_on() -> None:
    bench = running()
    bench.rig.set_supply(9.0)
    reply = bench.bus.ping(M)
    assert (reply.alert, reply.number, bench.get(M, "torque_enable")) == (True, 0, 1)
    assert bench.get(M, "hardware_error_status") == VOLTAGE


def test_a_bad_voltage_in_the_shutdown_mask_takes_the_torque_off() -> None:
    bench = Bench()
    bench.put(M, "shutdown", VOLTAGE)
    bench.put(M, "torque_enable", 1)
    bench.rig.set_supply(9.0)
    assert bench.get(M, "torque_enable") == 0


def test_after_a_shutdown_only_a_reboot_brings_the_torque_back() -> None:
    bench = running()
    bench.rig.motors[M].fail(SHOCK)
    refused = bench.put(M, "torque_enable", 1)
    bench.bus.reboot(M)
    bench.wait(0.5)
    assert (refused, bench.put(M, "torque_enable", 1)) == (FAIL, 0)
