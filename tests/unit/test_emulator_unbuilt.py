"""An emulated bench that is not set up yet: what is wrong with it, and the hands that plug and turn."""

import math

import pytest
from tests.unit.emulator_stand_in import paper_rig

from sinew.emulator.found import EYE, KINDS, Hands, Unbuilt, VirtualPort, draw_unbuilt, parse_kinds
from sinew.emulator.plant import Unloaded
from sinew.emulator.rig import EmulatedRig
from sinew.hardware.bus import Bus, BusTiming
from sinew.measure.errors import SpecError


def bench(*kinds: str, seed: int = 0) -> tuple[EmulatedRig, Hands, Unbuilt]:
    spec = paper_rig()
    unbuilt = draw_unbuilt(spec, kinds, seed)
    rig = EmulatedRig(unbuilt.spec, Unloaded(4, unbuilt.spec))
    return rig, Hands(rig, unbuilt), unbuilt


def heard(rig: EmulatedRig, baud: int) -> list[int]:
    """Return the ids that answer at a baud."""
    port = VirtualPort(rig)
    rig.line.host_baud = baud
    port.wait_until(rig.time + 0.5)
    return sorted(Bus(port, port, BusTiming(baud)).scan())


def test_new_motors_are_on_the_table_and_the_board_alone_answers() -> None:
    rig, _, _ = bench("new")
    assert (heard(rig, 57_600), heard(rig, 1_000_000)) == ([], [200])


def test_a_new_motor_that_is_plugged_in_has_the_factorys_id_and_baud() -> None:
    rig, hands, _ = bench("new")
    hands.do("plug tendon 2")
    assert heard(rig, 57_600) == [1]


def test_hands_plug_in_the_motor_that_people_call_so_whatever_it_pulls() -> None:
    rig, hands, unbuilt = bench("tendons")
    hands.do("plug tendon 1")
    assert rig.line.devices[0] is list(rig.motors.values())[unbuilt.called[0]]


def test_a_motor_that_is_unplugged_has_no_torque() -> None:
    rig, hands, _ = bench("pulls")
    motor = rig.motors[1]
    motor.write(64, b"\x01", rig.time)
    was = motor.torque
    hands.do("plug drive")
    assert (was, motor.torque) == (True, False)


def test_hands_turn_the_lever_to_its_middle_as_far_as_an_eye_sees() -> None:
    rig, hands, _ = bench("zero")
    hands.do("turn lever")
    assert abs(rig.motion().drive.angle) < 5 * EYE


def test_hands_say_what_they_cannot() -> None:
    _, hands, _ = bench("new")
    with pytest.raises(SpecError, match=r"hands cannot 'plug tendon 9'; expected plug tendon 1"):
        hands.do("plug tendon 9")


@pytest.mark.parametrize("seed", range(6))
def test_all_senses_and_axes_that_are_drawn_make_a_rig(seed: int) -> None:
    _, _, unbuilt = bench("ids", "baud", "tendons", "pulls", "lever", "zero", "board", seed=seed)
    wiring = unbuilt.spec.wiring
    window = 0.25 * 4096
    assert len(set(unbuilt.ids)) == 5
    assert wiring.imu_axes != ("+x", "+y", "+z")
    assert -1 in wiring.tendon_pull
    assert wiring.drive_sign == -1
    assert window <= wiring.drive_zero_counts <= 4095 - window
    assert math.isfinite(unbuilt.lever)


def test_a_seed_draws_the_same_again() -> None:
    assert bench(*KINDS.keys() - {"new"}, seed=5)[2] == bench(*KINDS.keys() - {"new"}, seed=5)[2]


def test_two_motors_of_one_id_speak_at_once() -> None:
    _, _, unbuilt = bench("double", seed=3)
    assert len(set(unbuilt.ids)) == 4


def test_new_motors_have_no_ids_of_their_own() -> None:
    with pytest.raises(SpecError, match="new have no ids"):
        draw_unbuilt(paper_rig(), ("new", "ids"), 0)


def test_a_word_that_is_no_kind_is_refused_with_the_words_there_are() -> None:
    with pytest.raises(SpecError, match="found 'wires' to build wrongly, expected all, or some of new"):
        parse_kinds("ids,wires")
