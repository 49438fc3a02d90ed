"""The guide's steps without mechanics: who is on the bus, where tendons stand, what goes into the rig."""

import math
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager

import numpy as np
import pytest
from tests.unit.emulator_stand_in import StandIn, paper_rig

from sinew.bench.doctor import Finding
from sinew.bench.guide import STEPS, Guide, OpenRig, Step, arrange, lead, look_around
from sinew.bench.guide_moves import LeverMove, Pull, answer_to, moving, pull_current
from sinew.emulator.bench import EmulatedRig, VirtualPort
from sinew.hardware.bus import Bus, BusTiming, Clock
from sinew.hardware.ports import PLUG_DRIVE
from sinew.hardware.registers import BAUD_RATES
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


class Somebody:
    """A person who does what is asked; the `breaks_off`th question is the last. mistaken: the act done instead."""

    def __init__(self, bench: EmulatedRig, breaks_off: int = 99, mistaken: int | None = None) -> None:
        self.bench, self.left, self.mistaken = bench, breaks_off, mistaken
        self.told: list[Finding] = []

    def begin(self, step: Step) -> None: ...

    def tell(self, finding: Finding) -> None:
        self.told.append(finding)

    def do(self, words: str, act: int) -> None:
        self.left -= 1
        if self.left < 0:
            raise StoppedError("the input ended")
        self.bench.do(act if self.mistaken is None else self.mistaken)

    def agrees(self, question: str) -> bool:
        return True

    def repeats(self, what: str, failed: bool) -> bool:
        return False

    def notes(self) -> str:
        return "; ".join(f"{told.subject}: {told.found}" for told in self.told if told.severity == "note")


class OnTheTable:
    """Motors without a joint that are not set up, and the guide before them. ids, bauds: of the motors; None: new."""

    def __init__(self, ids: Sequence[int] | None = (1, 2, 3, 4, 5), bauds: Sequence[int] = (1_000_000,) * 5) -> None:
        self.kept = paper_rig()
        self.emulated = EmulatedRig(self.kept, StandIn())
        self.port = VirtualPort(self.emulated)
        if ids is None:
            self.emulated.unbox()
            return
        for motor, device, baud in zip(self.emulated.motors.values(), ids, bauds, strict=True):
            motor.registers["id"], motor.registers["baud_rate"] = device, BAUD_RATES.index(baud)

    @contextmanager
    def open_rig(self, spec: RigSpec) -> Iterator[tuple[Rig, Clock]]:
        self.emulated.line.host_baud = spec.wiring.baud
        yield Rig(Bus(self.port, self.port, BusTiming(spec.wiring.baud, latency=4e-3)), self.port, spec), self.port

    def keep(self, spec: RigSpec) -> None:
        self.kept = spec

    def lead(self, person: Somebody, steps: Sequence[Step] = DEVICES) -> bool:
        return lead(Guide(self.open_rig, person, self.kept, self.keep), steps)

    def motors(self) -> list[tuple[int, int]]:
        """Return id and baud of every motor."""
        return [(motor.id, BAUD_RATES[motor.registers["baud_rate"]]) for motor in self.emulated.motors.values()]


def test_new_motors_get_ids_and_the_boards_baud_one_by_one() -> None:
    table = OnTheTable(None)
    assert table.lead(Somebody(table.emulated))
    assert table.motors() == [(device, 1_000_000) for device in (1, 2, 3, 4, 5)]


def test_shuffled_ids_are_named_and_taken_as_they_are() -> None:
    table = OnTheTable((12, 3, 7, 9, 4))
    ids = [device for device, _ in table.motors()]
    person = Somebody(table.emulated)
    assert table.lead(person)
    assert (set(table.kept.wiring.tendon_ids), table.kept.wiring.drive_id) == (set(ids[:4]), ids[4])
    assert f"drive {ids[4]}" in person.notes()


def test_a_wrong_baud_is_named_and_put_right() -> None:
    wrong = {2: 57_600, 5: 4_000_000}
    table = OnTheTable(bauds=[wrong.get(device, 1_000_000) for device in (1, 2, 3, 4, 5)])
    person = Somebody(table.emulated)
    assert table.lead(person, STEPS[:1])
    assert {baud for _, baud in table.motors()} == {1_000_000}
    assert all(f"motor {device}: {baud} baud" in person.notes() for device, baud in wrong.items())


def test_two_motors_with_one_id_are_named_and_told_apart_one_by_one() -> None:
    table = OnTheTable((1, 2, 2, 4, 5))
    person = Somebody(table.emulated)
    assert table.lead(person, STEPS[:1])
    assert sorted(device for device, _ in table.motors()) == [1, 2, 3, 4, 5]
    assert "they go one by one" in [told.advice for told in person.told]


@pytest.mark.parametrize("question", [0, 3, 5])
def test_a_guide_that_was_broken_off_is_begun_again_without_harm(question: int) -> None:
    table = OnTheTable(None)
    with pytest.raises(StoppedError):
        table.lead(Somebody(table.emulated, question))
    assert table.lead(Somebody(table.emulated), STEPS[:1])
    assert sorted(device for device, _ in table.motors()) == [1, 2, 3, 4, 5]


def test_a_window_about_the_middle_of_an_attempt_before_is_no_fault() -> None:
    table = OnTheTable()
    drive = list(table.emulated.motors.values())[-1]
    drive.registers["min_position_limit"], drive.registers["max_position_limit"] = 1776, 3824
    person = Somebody(table.emulated)
    assert table.lead(person, STEPS[: [step.name for step in STEPS].index("settings") + 1])
    assert not [told for told in person.told if told.severity == "fault"]


def test_a_missing_board_is_a_fault_that_says_what_to_do() -> None:
    table = OnTheTable()
    table.emulated.imu.set_power(False, 0.0)
    person = Somebody(table.emulated)
    assert not table.lead(person)
    assert "leave its board on the bus" in person.told[-1].advice


def test_the_wrong_motor_in_the_hand_is_a_fault_that_names_both_models() -> None:
    table = OnTheTable(None)
    person = Somebody(table.emulated, mistaken=PLUG_DRIVE)
    assert not table.lead(person)
    assert "found id 1 at 57600 baud (XM430-W350), expected a XH430-W350 as tendon 1" in person.told[-1].found


def test_a_port_that_knows_no_baud_is_refused_and_one_that_knows_the_rigs_is_not() -> None:
    table = OnTheTable()

    def known(*bauds: int) -> OpenRig:
        def open_rig(spec: RigSpec) -> AbstractContextManager[tuple[Rig, Clock]]:
            if spec.wiring.baud not in bauds:
                raise PortError(f"the port does not know {spec.wiring.baud} baud")
            return table.open_rig(spec)

        return open_rig

    assert len(look_around(known(1_000_000), table.kept)) == 6  # five motors and the board
    with pytest.raises(PortError, match="does not know"):
        look_around(known(), table.kept)


def test_what_a_tendon_did_is_told_under_its_number(monkeypatch: pytest.MonkeyPatch) -> None:
    table = OnTheTable()
    leans = [(-math.sin(turn), math.cos(turn)) for turn in np.radians([0.0, 90.0, 180.0, 270.0])]
    monkeypatch.setattr("sinew.bench.guide.pull_tendon", lambda _, __, index: Pull(1, lean=leans[index]))
    person = Somebody(table.emulated)
    step = next(step for step in STEPS if step.name == "tendons")
    assert table.lead(person, [step])
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


def test_two_motors_that_pull_in_one_direction_have_no_arrangement() -> None:
    assert arrange(degrees(0, 5, 180, 270)) is None


# Numbers go into the rig with their origin, if they are thinkable.


def test_a_number_that_is_not_thinkable_stays_out_of_the_rig() -> None:
    table = OnTheTable()
    guide = Guide(table.open_rig, Somebody(table.emulated), table.kept, table.keep)
    told = guide.measure("imu.residual_delay", -0.004, 0.0002, "by a step")
    assert (told.severity, guide.spec) == ("warning", table.kept)


TICK_S = 0.005


def ticks(duration: float) -> np.ndarray:
    return TICK_S * np.arange(round(duration / TICK_S))


def test_a_head_that_does_not_follow_the_lever_is_all_misfit() -> None:
    times = ticks(4.0)
    noise = np.random.default_rng(0).standard_normal(times.size)
    move = LeverMove(times, 0.2 * np.sin(2 * times), times, noise)
    assert answer_to(move, load_rig("paper")).misfit == pytest.approx(1.0, abs=0.05)  # five numbers explain nothing
