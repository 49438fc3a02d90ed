"""The guide's steps without mechanics: who is on the bus, where tendons stand, what goes into the rig."""

import math
from contextlib import AbstractContextManager

import numpy as np
import pytest
from tests.experiments.wrong_wirings import Scene, Wrong
from tests.unit.emulator_stand_in import StandIn, paper_rig

from sinew.bench.guide import STEPS, Guide, OpenRig, arrange, lead, look_around
from sinew.bench.guide_moves import LeverMove, Pull, answer_to, moving, pull_current
from sinew.emulator.bench import EmulatedRig, VirtualPort
from sinew.hardware.bus import Bus, Clock
from sinew.hardware.ports import PLUG_DRIVE
from sinew.hardware.rig import Rig
from sinew.measure.errors import PortError, StoppedError
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig

DEVICES = STEPS[:2]


def rigged(spec: RigSpec) -> tuple[Rig, VirtualPort, EmulatedRig]:
    """Return a rig in virtual time, whose motors turn without a joint."""
    emulated = EmulatedRig(spec, StandIn())
    port = VirtualPort(emulated)
    return Rig(Bus(port, port), port, spec), port, emulated


def test_a_move_that_breaks_off_takes_the_torque_from_its_motor_and_says_why() -> None:
    rig, port, emulated = rigged(paper_rig())

    def move() -> None:
        with moving(rig, port, [rig.drive], lambda: None) as loop:
            loop.run(0.1)
            assert emulated.states()[rig.drive.id].torque
            raise StoppedError("the input ended")

    with pytest.raises(StoppedError, match="the input ended"):
        move()
    assert not emulated.states()[rig.drive.id].torque


@pytest.mark.parametrize(("limit_a", "most"), [(1.3, 0.0423), (0.1, 0.025)])
def test_a_tendon_is_pulled_with_first_contacts_current_and_a_quarter_of_the_limit_at_most(
    limit_a: float, most: float
) -> None:
    # 8.868 N at the paper's pulley and 2.62 N m/A are 42.3 mA; a count is 2.69 mA.
    spec = paper_rig()
    spec = spec.model_copy(update={"limits": spec.limits.model_copy(update={"tendon_current_a": limit_a})})
    assert pull_current(rigged(spec)[0]) == pytest.approx(most - 0.00135, abs=0.00135)


class Somebody(Scene):
    """A person before motors without a joint; the `breaks_off`th question is the last. mistaken: the act done instead
    of what is asked."""

    def __init__(self, wrong: Wrong, breaks_off: int = 99, mistaken: int | None = None) -> None:
        super().__init__(wrong, has_joint=False)
        self.left, self.mistaken = breaks_off, mistaken

    def do(self, words: str, act: int) -> None:
        self.left -= 1
        if self.left < 0:
            raise StoppedError("the input ended")
        super().do(words, act if self.mistaken is None else self.mistaken)

    def notes(self) -> str:
        return "; ".join(f"{told.subject}: {told.found}" for told in self.told if told.severity == "note")

    def wired(self) -> list[tuple[int, int]]:
        """Return id and baud of every motor."""
        return [(motor.id, motor.baud) for motor in self.motors]


NEW_MOTORS = Wrong({}, is_new=True)
ALL_SET = [(device, 1_000_000) for device in (1, 2, 3, 4, 5)]


def test_new_motors_get_ids_and_the_boards_baud_one_by_one() -> None:
    person = Somebody(NEW_MOTORS)
    assert person.guided(person.spec, DEVICES)[0]
    assert person.wired() == ALL_SET


def test_shuffled_ids_are_named_and_taken_as_they_are() -> None:
    ids = (12, 3, 7, 9, 4)
    person = Somebody(Wrong({}, ids=dict(enumerate(ids))))
    well, rig = person.guided(person.spec, DEVICES)
    assert (well, set(rig.wiring.tendon_ids), rig.wiring.drive_id) == (True, set(ids[:4]), ids[4])
    assert f"motor {ids[4]} is the drive" in person.notes()


def test_ids_that_were_taken_as_they_are_are_no_labels_when_the_step_is_repeated() -> None:
    person = Somebody(Wrong({}, ids=dict(enumerate((12, 3, 7, 9, 4)))))
    guide = Guide(person.open_rig, person, person.spec, lambda _: None, person.check)
    assert lead(guide, (*DEVICES, *DEVICES))
    assert not guide.is_labelled


def test_a_wrong_baud_is_named_and_put_right() -> None:
    person = Somebody(Wrong({}, bauds={1: 57_600, 4: 4_000_000}))
    assert person.guided(person.spec, DEVICES[:1])[0]
    assert person.wired() == ALL_SET
    assert all(said in person.notes() for said in ("motor 2: 57600 baud", "motor 5: 4000000 baud"))


def test_two_motors_with_one_id_are_named_and_told_apart_one_by_one() -> None:
    person = Somebody(Wrong({}, ids={2: 2}))
    assert person.guided(person.spec, DEVICES[:1])[0]
    assert sorted(person.wired()) == ALL_SET
    assert "they go one by one" in [told.advice for told in person.told]


@pytest.mark.parametrize("question", [0, 3, 5])
def test_a_guide_that_was_broken_off_is_begun_again_without_harm(question: int) -> None:
    person = Somebody(NEW_MOTORS, question)
    assert person.guided(person.spec, DEVICES)[0] == "StoppedError"
    person.left = 99
    assert person.guided(person.spec, DEVICES[:1])[0] is True
    assert sorted(person.wired()) == ALL_SET


def test_a_window_about_the_middle_of_an_attempt_before_is_no_fault() -> None:
    person = Somebody(Wrong({}))
    drive = person.motors[-1].registers
    drive["min_position_limit"], drive["max_position_limit"] = 1776, 3824
    assert person.guided(person.spec, DEVICES)[0]
    assert not [told for told in person.told if told.severity == "fault"]


def test_a_missing_board_is_a_fault_that_says_what_to_do() -> None:
    person = Somebody(Wrong({}))
    person.bench.imu.set_power(False, 0.0)
    assert not person.guided(person.spec, DEVICES)[0]
    assert "leave its board on the bus" in person.told[-1].advice


def test_the_wrong_motor_in_the_hand_is_a_fault_that_names_both_models() -> None:
    person = Somebody(NEW_MOTORS, mistaken=PLUG_DRIVE)
    assert not person.guided(person.spec, DEVICES)[0]
    assert "found id 1 at 57600 baud (XM430-W350), expected a XH430-W350 as tendon 1" in person.told[-1].found


def test_a_port_that_knows_no_baud_is_refused_and_one_that_knows_the_rigs_is_not() -> None:
    table = Somebody(Wrong({}))

    def known(*bauds: int) -> OpenRig:
        def open_rig(spec: RigSpec) -> AbstractContextManager[tuple[Rig, Clock]]:
            if spec.wiring.baud not in bauds:
                raise PortError(f"the port does not know {spec.wiring.baud} baud")
            return table.open_rig(spec)

        return open_rig

    assert len(look_around(known(1_000_000), table.spec)) == 6  # five motors and the board
    with pytest.raises(PortError, match="does not know"):
        look_around(known(), table.spec)


def test_what_a_tendon_did_is_told_under_its_number(monkeypatch: pytest.MonkeyPatch) -> None:
    person = Somebody(Wrong({}))
    leans = [(-math.sin(turn), math.cos(turn)) for turn in np.radians([0.0, 90.0, 180.0, 270.0])]
    monkeypatch.setattr("sinew.bench.guide.pull_tendon", lambda _, __, index: Pull(1, lean=leans[index]))
    step = next(step for step in STEPS if step.name == "tendons")
    assert person.guided(person.spec, [step])[0]
    told = [(one.subject, one.found.split(",")[0]) for one in person.told if one.subject.startswith("tendon ")]
    assert told == [(f"tendon {number}", f"id {number}") for number in (1, 2, 3, 4)]


# Where tendons stand: directions of a perfect head, worked out by hand.


def degrees(*angles: float) -> list[float]:
    return [math.radians(angle) for angle in angles]


def test_two_swapped_neighbours_are_found_whichever_way_the_board_is_turned() -> None:
    found = [arrange(degrees(*(angle + 90 * turn for angle in (90, 0, 180, 270)))) for turn in range(4)]
    assert [there.order for there in found if there] == [(1, 0, 2, 3)] * 4
    assert [there.turns for there in found if there] == [0, 1, 2, 3]


def test_of_two_facing_tendons_that_are_swapped_the_usual_board_tells_which() -> None:
    there = arrange(degrees(180, 90, 0, 270))
    assert there is not None
    assert (there.order, there.turns) == ((2, 1, 0, 3), 0)


def test_of_motors_without_labels_the_fewest_turns_of_the_board_are_believed() -> None:
    turned = degrees(90, 180, 270, 0)  # the ids in their order on a board turned by a quarter, or all of them misplaced
    assert [arrange(turned, is_labelled=known).turns for known in (True, False)] == [1, 0]  # type: ignore[union-attr]


def test_two_motors_that_pull_in_one_direction_have_no_arrangement() -> None:
    assert arrange(degrees(0, 5, 180, 270)) is None


# Numbers go into the rig with their origin, if they are thinkable.


def test_a_number_that_is_not_thinkable_stays_out_of_the_rig() -> None:
    person = Somebody(Wrong({}))
    guide = Guide(person.open_rig, person, person.spec, lambda _: None)
    told = guide.measure("imu.residual_delay", -0.004, 0.0002, "by a step")
    assert (told.severity, guide.spec) == ("warning", person.spec)


def test_a_head_that_does_not_follow_the_lever_is_all_misfit() -> None:
    times = 0.005 * np.arange(800)
    noise = np.random.default_rng(0).standard_normal(times.size)
    move = LeverMove(times, 0.2 * np.sin(2 * times), times, noise)
    assert answer_to(move, load_rig("paper")).misfit == pytest.approx(1.0, abs=0.05)  # five numbers explain nothing
