"""An emulated motor that starts anew: reboot, brown-out, clearing of turns, factory reset."""

import math

import pytest
from tests.unit.emulator_motor_bench import COUNT, FAIL, LIMITED, VELOCITY, M, law, running, say
from tests.unit.emulator_stand_in import FASTEST, Bench, paper_rig

from sinew.emulator.plant import Law
from sinew.hardware import codec as ask
from sinew.hardware.bus import Outcome
from sinew.hardware.codec import Instruction, Status


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
