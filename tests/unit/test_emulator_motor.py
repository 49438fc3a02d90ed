"""An emulated motor on the line: torque, watchdog, protection, starts, and answers, by the manual."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.unit.emulator_stand_in import FASTEST, Bench, StandIn, paper_rig

from sinew.emulator.mechanics import Horn, Mechanics
from sinew.emulator.motor import Motor
from sinew.emulator.plant import Law
from sinew.hardware import instructions as ask
from sinew.hardware.codec import Instruction, Status
from sinew.hardware.motor_registers import XH430_W350
from sinew.hardware.reply import Outcome

M = 1
FAIL, UNKNOWN, RANGE, LENGTH, ACCESS = 1, 2, 4, 5, 7
CURRENT, VELOCITY, POSITION, EXTENDED, LIMITED, PWM = 0, 1, 3, 4, 5, 16
VOLTAGE, HOT, SHOCK, OVERLOAD = 0x01, 0x04, 0x10, 0x20
COUNT = math.tau / 4096


def running(mode: int = EXTENDED, **rig: object) -> Bench:
    """Return a bench whose first motor has its torque on."""
    bench = Bench(**rig)  # type: ignore[arg-type]
    bench.put(M, "operating_mode", mode)
    if mode == CURRENT:
        bench.put(M, "goal_current", 0)
    bench.put(M, "torque_enable", 1)
    return bench


def law(bench: Bench) -> Law:
    return bench.plant.laws[M - 1]


def say(bench: Bench, code: int, params: bytes = b"", device: int = M) -> Status | None:
    """Give the motor itself an instruction."""
    return bench.rig.motors[M].obey(Instruction(device, code, params), bench.rig.time)


# --- torque ---------------------------------------------------------------------------------------------------------


def test_torque_on_makes_the_present_position_the_goal() -> None:
    bench = Bench()
    bench.put(M, "operating_mode", EXTENDED)
    bench.plant.angles[0] = 1000 * COUNT
    bench.put(M, "goal_position", 17)
    bench.put(M, "torque_enable", 1)
    assert bench.get(M, "goal_position") == 3048
    assert law(bench).goal == pytest.approx(1000 * COUNT)


def test_torque_on_twice_does_not_touch_the_goal() -> None:
    bench = running()
    bench.put(M, "goal_position", 9000)
    bench.put(M, "torque_enable", 1)
    assert bench.get(M, "goal_position") == 9000


def test_torque_off_lets_the_horn_go() -> None:
    bench = running()
    bench.put(M, "torque_enable", 0)
    assert law(bench) == Law()


def test_position_mode_tells_a_position_within_one_turn_while_free() -> None:
    bench = Bench()
    bench.plant.angles[0] = 3 * math.tau + 100 * COUNT
    assert bench.get(M, "present_position") == 2148


def test_extended_position_counts_the_turns() -> None:
    bench = Bench()
    bench.put(M, "operating_mode", EXTENDED)
    bench.plant.angles[0] = 3 * math.tau + 100 * COUNT
    assert bench.get(M, "present_position") == 2148 + 3 * 4096


def test_the_homing_offset_is_added_to_the_present_position() -> None:
    bench = Bench()
    bench.put(M, "homing_offset", -500)
    assert bench.get(M, "present_position") == 1548


def test_a_goal_is_understood_with_the_homing_offset() -> None:
    bench = Bench()
    bench.put(M, "operating_mode", EXTENDED)
    bench.put(M, "homing_offset", -500)
    bench.put(M, "torque_enable", 1)
    bench.put(M, "goal_position", 1648)
    assert law(bench).goal == pytest.approx(100 * COUNT)


def test_a_homing_offset_beyond_a_quarter_turn_is_ignored_in_position_mode() -> None:
    bench = Bench()
    bench.put(M, "homing_offset", 1025)
    assert bench.get(M, "present_position") == 2048


def test_present_registers_tell_the_motion_in_counts() -> None:
    bench = Bench(paper_rig(tendon_pull=(-1, 1, 1, 1)))
    bench.plant.angles[0], bench.plant.current[0], bench.plant.duty[0] = 100 * COUNT, 0.269, 0.5
    names = ("present_position", "present_current", "present_pwm", "present_input_voltage", "present_temperature")
    assert [bench.get(M, name) for name in names] == [1948, -100, -442, 133, 25]


def test_present_velocity_counts_0_229_rpm() -> None:
    bench = running(VELOCITY)
    bench.put(M, "goal_velocity", -123)
    bench.wait(0.01)
    assert bench.get(M, "present_velocity") == -123


def test_realtime_tick_counts_milliseconds_and_wraps_at_32768() -> None:
    bench = Bench()
    before, then = bench.get(M, "realtime_tick"), bench.port.now()
    bench.port.wait_until(then + 32.768 + 0.1)
    assert abs(bench.get(M, "realtime_tick") - before - 100) <= 2


# --- profile --------------------------------------------------------------------------------------------------------


def test_without_a_profile_the_goal_is_taken_at_once() -> None:
    bench = running()
    bench.put(M, "goal_position", 6000)
    assert law(bench).goal == pytest.approx((6000 - 2048) * COUNT)


def test_a_rectangular_profile_takes_as_long_as_its_speed_says() -> None:
    bench = running()
    bench.put(M, "profile_velocity", 100)  # 22.9 rpm
    bench.put(M, "goal_position", 2048 + 4096)  # one turn: 60 / 22.9 s
    start = bench.port.now()
    while bench.get(M, "moving_status") & 0x02:
        bench.wait(0.01)
    assert bench.port.now() - start == pytest.approx(60 / 22.9, abs=0.02)


def test_a_trapezoidal_profile_keeps_its_acceleration_and_speed() -> None:
    bench = running()
    bench.put(M, "profile_velocity", 100)
    bench.put(M, "profile_acceleration", 10)  # ramp of 64 · 100 / 10 ms, by the manual
    bench.put(M, "goal_position", 2048 + 4096)
    start = bench.port.now()
    while bench.get(M, "moving_status") & 0x02:
        bench.wait(0.01)
    ramp = 64 * 100 / 10 * 1e-3
    assert bench.port.now() - start == pytest.approx(60 / 22.9 + ramp, abs=0.03)


def test_a_profile_never_goes_past_its_goal() -> None:
    bench = running()
    bench.put(M, "profile_velocity", 100)
    bench.put(M, "profile_acceleration", 10)
    bench.put(M, "goal_position", 4000)
    trajectory = []
    for _ in range(300):
        bench.wait(0.01)
        trajectory.append(bench.get(M, "position_trajectory"))
    assert trajectory == sorted(trajectory)
    assert trajectory[-1] == 4000


def test_a_time_based_profile_takes_its_time() -> None:
    bench = Bench()
    bench.put(M, "operating_mode", EXTENDED)
    bench.put(M, "drive_mode", 4)
    bench.put(M, "torque_enable", 1)
    bench.put(M, "profile_velocity", 800)  # ms in all
    bench.put(M, "profile_acceleration", 200)  # ms
    bench.put(M, "goal_position", 3000)
    start = bench.port.now()
    while bench.get(M, "moving_status") & 0x02:
        bench.wait(0.01)
    assert bench.port.now() - start == pytest.approx(0.8, abs=0.03)


def test_velocity_mode_reaches_its_goal_by_the_acceleration() -> None:
    bench = running(VELOCITY)
    bench.put(M, "profile_acceleration", 10)  # 2145.77 rev/min²: 21.46 rev/min after 0.6 s
    bench.put(M, "goal_velocity", 130)
    bench.wait(0.6)
    assert bench.get(M, "velocity_trajectory") == pytest.approx(2145.77 * 0.01 / 0.229, abs=1)


# --- bus watchdog ---------------------------------------------------------------------------------------------------


def tripped(mode: int = EXTENDED) -> Bench:
    bench = running(mode)
    bench.put(M, "bus_watchdog", 5)
    bench.wait(0.2)
    return bench


@pytest.mark.parametrize("units", [1, 5, 127])
def test_the_watchdog_trips_after_its_time_without_a_packet(units: int) -> None:
    bench = running()
    bench.put(M, "bus_watchdog", units)
    heard = bench.port.now()
    bench.port.wait_until(heard + units * 20e-3 - 2e-3)
    early = bench.rig.motors[M].is_tripped
    bench.port.wait_until(heard + units * 20e-3)
    assert (early, bench.rig.motors[M].is_tripped) == (False, True)


def test_the_watchdog_counts_packets_to_other_devices() -> None:
    bench = running()
    bench.put(M, "bus_watchdog", 2)
    for _ in range(20):
        bench.wait(0.03)
        bench.bus.ping(3)
    assert not bench.rig.motors[M].is_tripped


def test_the_watchdog_does_not_count_packets_that_are_damaged() -> None:
    bench = running()
    bench.put(M, "bus_watchdog", 2)
    for _ in range(3):
        bench.wait(0.03)
        bench.port.write(b"\xff\xff\xfd\x00\x03\x03\x00\x01\x00\x00")
    assert bench.rig.motors[M].is_tripped


def test_the_watchdog_sleeps_while_the_torque_is_off() -> None:
    bench = Bench()
    bench.put(M, "bus_watchdog", 1)
    bench.wait(1.0)
    assert not bench.rig.motors[M].is_tripped


def test_a_tripped_watchdog_reads_minus_one_and_leaves_the_torque_on() -> None:
    bench = tripped()
    assert (bench.get(M, "bus_watchdog"), bench.get(M, "torque_enable")) == (-1, 1)


@pytest.mark.parametrize("goal", ["goal_pwm", "goal_current", "goal_velocity", "goal_position"])
def test_a_tripped_watchdog_refuses_goals_as_out_of_range(goal: str) -> None:
    assert tripped().put(M, goal, 10) == RANGE


def test_only_zero_clears_the_watchdog() -> None:
    bench = tripped()
    assert [bench.put(M, "bus_watchdog", count) for count in (5, 0, 5)] == [RANGE, 0, 0]


def test_a_cleared_watchdog_takes_goals_again() -> None:
    bench = tripped()
    bench.put(M, "bus_watchdog", 0)
    assert bench.put(M, "goal_position", 2100) == 0
    assert law(bench).goal == pytest.approx(52 * COUNT)


def test_the_watchdog_holds_a_motor_where_it_is_on_its_way() -> None:
    bench = running()
    bench.put(M, "profile_velocity", 20)
    bench.put(M, "bus_watchdog", 5)
    bench.put(M, "goal_position", 9000)
    bench.wait(0.2)
    held = bench.plant.angles[0]
    bench.wait(0.5)
    assert bench.plant.angles[0] == pytest.approx(held, abs=COUNT)
    assert held < 0.5 * (9000 - 2048) * COUNT


@pytest.mark.parametrize("mode", [CURRENT, VELOCITY, PWM])
def test_the_watchdog_takes_the_goal_away_in_modes_without_a_position(mode: int) -> None:
    bench = running(mode)
    bench.put(M, {CURRENT: "goal_current", VELOCITY: "goal_velocity", PWM: "goal_pwm"}[mode], 100)
    bench.put(M, "bus_watchdog", 1)
    bench.wait(0.1)
    assert law(bench).goal == 0.0


def test_the_firmwares_fault_moves_a_motor_with_homing_offset_in_extended_mode() -> None:
    bench = Bench()
    bench.put(M, "operating_mode", EXTENDED)
    bench.put(M, "homing_offset", 700)
    bench.put(M, "torque_enable", 1)
    bench.put(M, "bus_watchdog", 1)
    bench.wait(1.0)
    assert bench.plant.angles[0] == pytest.approx(700 * COUNT)


# --- protection -----------------------------------------------------------------------------------------------------


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


# --- starting anew --------------------------------------------------------------------------------------------------


def test_a_reboot_is_answered_and_then_the_motor_is_deaf_for_a_while() -> None:
    bench = running()
    answered = bench.bus.reboot(M).ok
    deaf = bench.bus.ping(M).outcome
    bench.wait(0.31)
    assert (answered, deaf, bench.bus.ping(M).ok) == (True, Outcome.SILENT, True)


def test_a_reboot_takes_the_torque_off_and_keeps_the_mode() -> None:
    bench = running(LIMITED)
    bench.bus.reboot(M)
    bench.wait(0.5)
    assert (bench.get(M, "torque_enable"), bench.get(M, "operating_mode")) == (0, LIMITED)
    assert law(bench) == Law()


def test_a_reboot_forgets_the_turns() -> None:
    bench = running()
    bench.put(M, "goal_position", 2048 + 2 * 4096)
    bench.wait(math.tau * 2 / FASTEST + 0.5)
    before = bench.get(M, "present_position")
    bench.bus.reboot(M)
    bench.wait(0.5)
    assert (before, bench.get(M, "present_position")) == (2048 + 2 * 4096, 2048)


def test_a_brown_out_is_a_start_anew() -> None:
    bench = running()
    bench.rig.set_supply(6.0)
    gone = bench.bus.ping(M).outcome
    bench.rig.set_supply(13.0)
    bench.wait(0.4)
    assert (gone, bench.get(M, "torque_enable")) == (Outcome.SILENT, 0)


def test_clear_takes_the_turns_away_where_the_motor_stands() -> None:
    bench = running()
    bench.put(M, "goal_position", 2048 + 4096)
    bench.wait(3.0)
    assert say(bench, ask.CLEAR, b"\x01\x44\x58\x4c\x22") == Status(M)
    assert bench.get(M, "present_position") == 2048


def test_clear_does_not_move_the_horn() -> None:
    bench = running()
    bench.put(M, "goal_position", 2048 + 4096)
    bench.wait(3.0)
    before = bench.plant.angles[0]
    say(bench, ask.CLEAR, b"\x01\x44\x58\x4c\x22")
    bench.wait(0.5)
    assert bench.plant.angles[0] == pytest.approx(before, abs=COUNT)


def test_clear_fails_while_the_motor_turns() -> None:
    bench = running(VELOCITY)
    bench.put(M, "goal_velocity", 100)
    bench.wait(0.1)
    assert say(bench, ask.CLEAR, b"\x01\x44\x58\x4c\x22") == Status(M, FAIL)


@pytest.mark.parametrize(("option", "kept"), [(b"\x01", (1, 1)), (b"\x02", (1, 3)), (b"\xff", (1, 1))])
def test_a_factory_reset_keeps_what_its_option_says(option: bytes, kept: tuple[int, int]) -> None:
    bench = Bench()
    bench.put(M, "current_limit", 5)
    assert say(bench, ask.FACTORY_RESET, option) == Status(M)
    registers = bench.rig.motors[M].registers
    assert (registers["id"], registers["baud_rate"], registers["current_limit"]) == (*kept, 648)


def test_a_factory_reset_of_everything_is_not_for_all() -> None:
    bench = Bench()
    bench.put(M, "current_limit", 5)
    say(bench, ask.FACTORY_RESET, b"\xff", device=254)
    assert bench.get(M, "current_limit") == 5


def test_a_factory_reset_makes_the_id_one() -> None:
    bench = Bench(paper_rig(tendon_ids=(11, 12, 13, 14)))
    motor = bench.rig.motors[11]
    motor.obey(Instruction(11, ask.FACTORY_RESET, b"\xff"), bench.rig.time)
    assert motor.id == 1


# --- instructions ---------------------------------------------------------------------------------------------------


def test_a_registered_write_waits_for_action() -> None:
    bench = running()
    bench.bus.reg_write(M, 116, (3000).to_bytes(4, "little"))
    waiting = bench.get(M, "registered_instruction"), bench.get(M, "goal_position")
    bench.bus.action()
    assert waiting == (1, 2048)
    assert (bench.get(M, "registered_instruction"), bench.get(M, "goal_position")) == (0, 3000)


def test_action_without_a_registered_write_is_an_instruction_error() -> None:
    assert say(Bench(), ask.ACTION) == Status(M, UNKNOWN)


def test_a_registered_write_is_refused_as_a_write_would_be() -> None:
    assert say(Bench(), ask.REG_WRITE, b"\x84\x00\x01\x02\x03\x04") == Status(M, ACCESS)


@pytest.mark.parametrize("code", [0x07, 0x20, 0x99, 0xFF])
def test_an_unknown_instruction_is_an_instruction_error(code: int) -> None:
    assert say(Bench(), code) == Status(M, UNKNOWN)


@pytest.mark.parametrize("code", [ask.READ, ask.WRITE, ask.REG_WRITE])
def test_too_few_parameters_are_a_length_error(code: int) -> None:
    assert say(Bench(), code, b"\x40") == Status(M, LENGTH)


@pytest.mark.parametrize(("level", "answered"), [(0, [True, False, False]), (1, [True, True, False]), (2, [True] * 3)])
def test_the_status_return_level_says_what_is_answered(level: int, answered: list[bool]) -> None:
    bench = Bench()
    bench.put(M, "status_return_level", level)
    replies = [bench.bus.ping(M), bench.bus.read(M, 64, 1), bench.bus.write(M, 65, b"\x01")]
    assert [reply.ok for reply in replies] == answered


def test_a_write_that_is_not_answered_is_carried_out() -> None:
    bench = Bench()
    bench.put(M, "status_return_level", 0)
    bench.bus.write(M, 65, b"\x01")
    assert bench.rig.motors[M].registers["led"] == 1


def test_a_new_id_holds_from_the_next_packet_on() -> None:
    bench = Bench()
    assert bench.put(M, "id", 77) == 0
    assert (bench.bus.ping(M).ok, bench.bus.ping(77).ok) == (False, True)


def test_a_new_baud_holds_from_the_next_packet_on() -> None:
    bench = Bench()
    assert bench.put(M, "baud_rate", 4) == 0
    lost = bench.bus.ping(M).outcome
    bench.rig.line.host_baud = 2_000_000
    assert (lost, bench.bus.ping(M).ok, bench.bus.ping(2).ok) == (Outcome.SILENT, True, False)


def test_a_motor_set_to_protocol_1_is_silent() -> None:
    bench = Bench()
    bench.put(M, "protocol_type", 1)
    assert bench.bus.ping(M).outcome is Outcome.SILENT


@settings(max_examples=300, deadline=None)
@given(
    asked=st.lists(
        st.tuples(
            st.sampled_from([1, 2, 3, 4, 5, 6, 8, 16, 0x20, 0x83, 0x93, 0xEE]),
            st.one_of(
                st.binary(max_size=12),
                st.builds(lambda at, data: at.to_bytes(2, "little") + data, st.integers(0, 700), st.binary(max_size=8)),
                st.sampled_from([b"\x40\x00\x01", b"\x40\x00\x00", b"\x0b\x00\x00", b"\x0b\x00\x10", b"\x62\x00\x01"]),
            ),
            st.sampled_from([1, 254]),
            st.floats(0, 0.1),
        ),
        max_size=12,
    )
)
def test_no_instruction_makes_a_motor_raise(asked: list[tuple[int, bytes, int, float]]) -> None:
    mechanics = Mechanics(StandIn(1))
    motor = Motor(XH430_W350, Horn(mechanics, 0, 1, 2048))
    for code, params, device, pause in asked:
        mechanics.go_to(mechanics.time + pause)
        motor.heed(mechanics.time)
        status = motor.obey(Instruction(device, code, params), mechanics.time)
        motor.advance(mechanics.time)
        answer = motor.answer(0, 148, mechanics.time)
        assert status is None or status.number <= 7
        assert answer is None or len(answer.params) == 148
