"""An emulated motor: its goals, modes, profile, protection, restart and watchdog."""

import math

import pytest
from tests.unit.emulator_stand_in import Bench, paper_rig

from sinew.emulator.plant import Law
from sinew.hardware import codec as ask
from sinew.hardware.bus import Outcome
from sinew.hardware.codec import Instruction, Status

# One emulated motor on the line with its torque on, and the manual's numbers for it.


M = 1  # the motor's id
FAIL, UNKNOWN, RANGE, LENGTH, LIMIT, ACCESS = 1, 2, 4, 5, 6, 7
CURRENT, VELOCITY, POSITION, EXTENDED, LIMITED, PWM = 0, 1, 3, 4, 5, 16
VOLTAGE, HOT, SHOCK, OVERLOAD = 0x01, 0x04, 0x10, 0x20
COUNT = math.tau / 4096  # rad


def running(mode: int = EXTENDED, *, torque: bool = True) -> Bench:
    """Return a bench whose first motor is in a mode, and has its torque on."""
    bench = Bench()
    bench.put(M, "operating_mode", mode)
    if mode == CURRENT:
        bench.put(M, "goal_current", 0)
    bench.put(M, "torque_enable", int(torque))
    return bench


def law(bench: Bench, device: int = M) -> Law:
    """Return the law that a motor has given to its horn."""
    return bench.plant.laws[device - 1]


def say(bench: Bench, code: int, params: bytes = b"", device: int = M) -> Status | None:
    """Give the motor itself an instruction."""
    return bench.rig.motors[M].obey(Instruction(device, code, params), bench.rig.time)


# An emulated motor on the line: torque, and what its registers tell of position and motion, by the manual.


def test_torque_on_makes_the_present_position_the_goal() -> None:
    bench = Bench()
    bench.put(M, "operating_mode", EXTENDED)
    bench.plant.angles[0] = 1000 * COUNT
    bench.put(M, "goal_position", 17)
    bench.put(M, "torque_enable", 1)
    assert bench.get(M, "goal_position") == 3048
    assert law(bench).goal == pytest.approx(1000 * COUNT)


def test_position_mode_tells_a_position_within_one_turn_while_free() -> None:
    bench = Bench()
    bench.plant.angles[0] = 3 * math.tau + 100 * COUNT
    assert bench.get(M, "present_position") == 2148


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


# Operating modes of an emulated motor: what each resets, and what law it makes of the registers.


MODES = (CURRENT, VELOCITY, POSITION, EXTENDED, LIMITED, PWM)
TURN = math.tau


OWN_GAINS = {"position_p_gain": 900, "position_d_gain": 0, "velocity_p_gain": 100, "velocity_i_gain": 1920}
PROFILE = ("profile_velocity", "profile_acceleration")


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    ("written", "after"),
    [
        (dict.fromkeys(OWN_GAINS, 123), OWN_GAINS),
        (dict.fromkeys(PROFILE, 5), dict.fromkeys(PROFILE, 0)),
        ({"current_limit": 300, "pwm_limit": 400}, {"goal_current": 300, "goal_pwm": 400}),
    ],
    ids=["the gains of the model", "no profile", "goals at their limits"],
)
def test_a_new_mode_puts_gains_profile_and_goals_back(
    written: dict[str, int], after: dict[str, int], mode: int
) -> None:
    bench = running(CURRENT, torque=False)
    for name, count in written.items():
        bench.put(M, name, count)
    bench.put(M, "operating_mode", mode)
    assert {name: bench.get(M, name) for name in after} == after


BY_POSITION = (POSITION, EXTENDED, LIMITED)


KINDS = {CURRENT: "current", VELOCITY: "velocity", PWM: "pwm"} | dict.fromkeys(BY_POSITION, "position")


@pytest.mark.parametrize(
    ("mode", "register", "count", "key", "value"),
    [
        *((mode, "goal_position", 2048 + 1024, "goal", TURN / 4) for mode in BY_POSITION),
        *((mode, "goal_position", 2048 - 3 * 4096, "goal", -3 * TURN) for mode in (EXTENDED, LIMITED)),
        *((mode, "goal_pwm", 177, "duty_limit", 0.2) for mode in BY_POSITION),
        *((mode, "goal_current", 100, "current_limit", math.inf) for mode in (POSITION, EXTENDED)),
        (LIMITED, "goal_current", 100, "current_limit", 0.269),
        (CURRENT, "goal_current", -200, "goal", -0.538),  # 2.69 mA a count
        (VELOCITY, "goal_velocity", 100, "goal", 22.9 / 60 * TURN),  # 0.229 rpm a count
        (PWM, "goal_pwm", -885, "goal", -1.0),
    ],
)
def test_a_mode_makes_its_law_of_its_registers(mode: int, register: str, count: int, key: str, value: float) -> None:
    bench = running(mode)
    assert bench.put(M, register, count) == 0
    assert (law(bench).kind, getattr(law(bench), key)) == (KINDS[mode], pytest.approx(value))


def test_position_mode_refuses_a_goal_outside_its_window() -> None:
    bench = running(POSITION, torque=False)
    bench.put(M, "max_position_limit", 3000)
    bench.put(M, "min_position_limit", 1000)
    bench.put(M, "torque_enable", 1)
    assert [bench.put(M, "goal_position", goal) for goal in (999, 1000, 3000, 3001)] == [LIMIT, 0, 0, LIMIT]


@pytest.mark.parametrize("mode", MODES)
def test_no_mode_controls_anything_while_the_torque_is_off(mode: int) -> None:
    bench = running(mode, torque=False)
    for goal in ("goal_pwm", "goal_current", "goal_velocity", "goal_position"):
        bench.put(M, goal, 50)
    assert law(bench) == Law()


def test_reverse_mode_inverts_positions() -> None:
    bench = running(EXTENDED, torque=False)
    before = bench.get(M, "present_position")
    bench.put(M, "drive_mode", 1)
    bench.put(M, "torque_enable", 1)
    start = bench.get(M, "present_position")
    bench.put(M, "goal_position", start + 1024)
    assert law(bench).goal == pytest.approx(-TURN / 4)
    assert start % 4096 == -before % 4096


def test_torque_on_by_goal_starts_with_the_goal() -> None:
    bench = running(EXTENDED, torque=False)
    bench.put(M, "drive_mode", 8)
    bench.put(M, "goal_position", 3072)
    assert law(bench).goal == pytest.approx(TURN / 4)
    assert bench.get(M, "torque_enable") == 1


# An emulated motor on its way to a goal: profiles by velocity, by acceleration and by time, by the manual.


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


# An emulated motor that protects itself: overload, heat, voltage, and the shutdown that follows.


def test_a_stall_of_a_second_is_an_overload_and_takes_the_torque_off() -> None:
    bench = running()
    bench.plant.current[0] = 1.1
    bench.wait(0.9)
    before = bench.get(M, "torque_enable")
    bench.wait(0.2)
    assert (before, bench.get(M, "torque_enable"), bench.get(M, "hardware_error_status")) == (1, 0, OVERLOAD)


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


def test_a_bad_voltage_raises_the_alert_and_leaves_the_torque_on() -> None:
    bench = running()
    bench.rig.set_supply(9.0)
    reply = bench.bus.ping(M)
    assert (reply.alert, reply.number, bench.get(M, "torque_enable")) == (True, 0, 1)
    assert bench.get(M, "hardware_error_status") == VOLTAGE


def test_after_a_shutdown_only_a_reboot_brings_the_torque_back() -> None:
    bench = running()
    bench.rig.motors[M].fail(SHOCK)
    refused = bench.put(M, "torque_enable", 1)
    bench.bus.reboot(M)
    bench.wait(0.5)
    assert (refused, bench.put(M, "torque_enable", 1)) == (FAIL, 0)


# An emulated motor that starts anew: reboot, brown-out, clearing of turns, factory reset.


def test_a_reboot_is_answered_and_then_the_motor_is_deaf_for_a_while() -> None:
    bench = running()
    answered = bench.bus.reboot(M).ok
    deaf = bench.bus.ping(M).outcome
    bench.wait(0.31)
    assert (answered, deaf, bench.bus.ping(M).ok) == (True, Outcome.SILENT, True)


def test_clear_takes_the_turns_away_where_the_motor_stands() -> None:
    bench = running()
    bench.put(M, "goal_position", 2048 + 4096)
    bench.wait(3.0)
    assert say(bench, ask.CLEAR, b"\x01\x44\x58\x4c\x22") == Status(M)
    assert bench.get(M, "present_position") == 2048


@pytest.mark.parametrize(("option", "kept"), [(b"\x01", (1, 1)), (b"\x02", (1, 3)), (b"\xff", (1, 1))])
def test_a_factory_reset_keeps_what_its_option_says(option: bytes, kept: tuple[int, int]) -> None:
    bench = Bench()
    bench.put(M, "current_limit", 5)
    assert say(bench, ask.FACTORY_RESET, option) == Status(M)
    registers = bench.rig.motors[M].registers
    assert (registers["id"], registers["baud_rate"], registers["current_limit"]) == (*kept, 648)


# An emulated motor's bus watchdog: when it trips, what it does in each mode, and how it is cleared.


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


@pytest.mark.parametrize("goal", ["goal_pwm", "goal_current", "goal_velocity", "goal_position"])
def test_a_tripped_watchdog_refuses_goals_as_out_of_range(goal: str) -> None:
    assert tripped().put(M, goal, 10) == RANGE


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


# An emulated motor and its instructions: what is answered, with which error, and what holds from when on.


STORE, RESTORE = b"\x01CTRL", b"\x02CTRL"


@pytest.mark.parametrize(
    ("code", "params", "torque", "number"),
    [
        *((ask.CONTROL_TABLE_BACKUP, params, True, FAIL) for params in (STORE, RESTORE)),
        (ask.CONTROL_TABLE_BACKUP, RESTORE, False, FAIL),  # without a backup
        *((ask.CONTROL_TABLE_BACKUP, params, False, RANGE) for params in (b"", b"\x01", b"\x03CTRL", b"\x01CTR")),
        (ask.FACTORY_RESET, b"\x02", True, ACCESS),
        (ask.ACTION, b"", False, UNKNOWN),  # without a registered write
        (ask.REG_WRITE, b"\x84\x00\x01\x02\x03\x04", False, ACCESS),
        *((code, b"", False, UNKNOWN) for code in (0x07, 0x21, 0x99, 0xFF)),
        *((code, b"\x40", False, LENGTH) for code in (ask.READ, ask.WRITE, ask.REG_WRITE)),
    ],
)
def test_what_cannot_be_carried_out_is_refused_and_changes_nothing(
    code: int, params: bytes, torque: bool, number: int
) -> None:
    bench = running(torque=torque)
    before = bytes(bench.rig.motors[M].registers.memory[:64])
    assert say(bench, code, params) == Status(M, number)
    assert bytes(bench.rig.motors[M].registers.memory[:64]) == before


@pytest.mark.parametrize("turns", [False, True])
def test_clear_fails_while_the_motor_turns(turns: bool) -> None:
    bench = running(VELOCITY)
    bench.put(M, "goal_velocity", 100 * turns)
    bench.wait(0.1)
    assert say(bench, ask.CLEAR, b"\x01\x44\x58\x4c\x22") == Status(M, FAIL * turns)


def backed_up(bench: Bench) -> Status | None:
    return say(bench, ask.CONTROL_TABLE_BACKUP, STORE)


def test_a_backup_brings_the_registers_back_that_outlive_a_loss_of_power_and_the_motor_starts_anew() -> None:
    bench = Bench()
    bench.put(M, "pwm_limit", 300)
    stored = backed_up(bench)
    ready = bench.get(M, "backup_ready")
    bench.put(M, "pwm_limit", 885)
    bench.put(M, "led", 1)
    restored = say(bench, ask.CONTROL_TABLE_BACKUP, RESTORE)
    deaf = bench.bus.ping(M).outcome
    bench.wait(0.5)
    assert (stored, ready, restored, deaf) == (Status(M), 1, Status(M), Outcome.SILENT)
    assert [bench.get(M, name) for name in ("pwm_limit", "led", "backup_ready")] == [300, 0, 1]


def test_a_motor_set_to_protocol_1_is_silent() -> None:
    bench = Bench()
    bench.put(M, "protocol_type", 1)
    assert bench.bus.ping(M).outcome is Outcome.SILENT


def test_realtime_tick_counts_milliseconds_and_wraps_at_32768() -> None:
    bench = Bench()
    before, then = bench.get(M, "realtime_tick"), bench.port.now()
    bench.port.wait_until(then + 32.768 + 0.1)
    assert abs(bench.get(M, "realtime_tick") - before - 100) <= 2
