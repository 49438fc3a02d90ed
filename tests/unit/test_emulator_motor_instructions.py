"""An emulated motor and its instructions: what is answered, with which error, and what holds from when on."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.unit.emulator_motor_bench import ACCESS, FAIL, LENGTH, RANGE, UNKNOWN, M, running, say
from tests.unit.emulator_stand_in import Bench, StandIn

from sinew.emulator.motor import Motor
from sinew.emulator.plant import Horn, Mechanics
from sinew.hardware import codec as ask
from sinew.hardware.bus import Outcome
from sinew.hardware.codec import Instruction, Status
from sinew.hardware.registers import XH430_W350


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


@pytest.mark.parametrize("code", [0x07, 0x21, 0x99, 0xFF])
def test_an_unknown_instruction_is_an_instruction_error(code: int) -> None:
    assert say(Bench(), code) == Status(M, UNKNOWN)


STORE, RESTORE = b"\x01CTRL", b"\x02CTRL"


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


@pytest.mark.parametrize("params", [STORE, RESTORE])
def test_nothing_is_backed_up_or_restored_while_the_torque_is_on(params: bytes) -> None:
    bench = Bench()
    backed_up(bench)
    bench.put(M, "torque_enable", 1)
    assert say(bench, ask.CONTROL_TABLE_BACKUP, params) == Status(M, FAIL)


def test_without_a_backup_nothing_is_restored() -> None:
    bench = Bench()
    assert (say(bench, ask.CONTROL_TABLE_BACKUP, RESTORE), bench.get(M, "backup_ready")) == (Status(M, FAIL), 0)


@pytest.mark.parametrize("params", [b"", b"\x01", b"\x03CTRL", b"\x01CTR"])
def test_a_backup_without_its_fixed_values_is_a_range_error(params: bytes) -> None:
    assert say(Bench(), ask.CONTROL_TABLE_BACKUP, params) == Status(M, RANGE)


def test_firmware_before_45_knows_no_backup() -> None:
    assert backed_up(Bench(firmware=44)) == Status(M, UNKNOWN)


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
