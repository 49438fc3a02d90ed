"""Faults of the emulated bench: how they are written down, and what they do in virtual time."""

import numpy as np
import pytest
from tests.unit.emulator_stand_in import StandIn

from sinew.emulator.bench import EmulatedRig, VirtualPort
from sinew.emulator.faults import DRAWN_KINDS, FAULT_KINDS, Faults, FaultSpec, parse_fault, random_fault
from sinew.hardware.bus import Bus, BusTiming
from sinew.hardware.registers import OPENCR_NODE, XH430_W350, Register, encode_raw
from sinew.measure.errors import SpecError
from sinew.plan.toml import load_rig

BRIEF = {
    "drop:p=0.01": FaultSpec("drop", (("p", 0.01),)),
    "drop": FaultSpec("drop", (("p", 0.01),)),
    "drop:p=20%@5-8": FaultSpec("drop", (("p", 0.2),), 5.0, 8.0),
    "delay:p=0.01,by=0.02": FaultSpec("delay", (("p", 0.01), ("by", 0.02))),
    "delay:by=20ms,p=0.01": FaultSpec("delay", (("p", 0.01), ("by", 0.02))),
    "unplug@12.5": FaultSpec("unplug", (), 12.5),
    "overheat:motor=3@5": FaultSpec("overheat", (("motor", 3.0), ("rate", 20.0)), 5.0),
    "slip-tendon:tendon=2,by=1mm@4": FaultSpec("slip-tendon", (("tendon", 2.0), ("by", 1.0)), 4.0),
    "slip-tendon:tendon=2,by=1@4": FaultSpec("slip-tendon", (("tendon", 2.0), ("by", 1.0)), 4.0),
    "brown-out:to=5V@3-3.4": FaultSpec("brown-out", (("to", 5.0),), 3.0, 3.4),
    " imu-freeze@1e-1-2 ": FaultSpec("imu-freeze", (), 0.1, 2.0),
}
WRONG = {
    "drip": "did you mean drop",
    "meteor": "there is drop, flip, duplicate, delay, truncate, unplug, brown-out",
    "drop:q=0.1": "unknown key 'q'; there is p",
    "unplug:p=0.1": "it has none",
    "drop:p": "is not a number",
    "drop:p=2": "from 0 to 1",
    "drop:p=-1": "is not a number",
    "drop:p=nan": "is not a number",
    "delay:by=1min": "from 0 to 10 s",
    "overheat": "does not say motor",
    "overheat:motor=1.5": "a whole number from 0 to 252",
    "stuck-tendon:tendon=0": "from 1 to 12",
    "slip-tendon:tendon=1@3-4": "happens at once",
    "unplug@soon": "'soon' is no time",
    "unplug@": "'' is no time",
    "unplug@5-": "'5-' is no time",
    "unplug@5-3": "stops before it starts",
}


@pytest.mark.parametrize(("text", "fault"), BRIEF.items())
def test_a_fault_is_what_its_text_says(text: str, fault: FaultSpec) -> None:
    assert parse_fault(text) == fault


@pytest.mark.parametrize("kind", FAULT_KINDS)
def test_the_example_of_a_kind_is_a_fault_of_that_kind(kind: str) -> None:
    assert parse_fault(FAULT_KINDS[kind].example).kind == kind


@pytest.mark.parametrize(("text", "sentence"), WRONG.items())
def test_a_wrong_fault_is_refused_with_what_there_is(text: str, sentence: str) -> None:
    with pytest.raises(SpecError) as refusal:
        parse_fault(text)
    assert sentence in str(refusal.value)


def test_random_faults_are_of_every_kind_begin_in_time_and_are_read_back_and_drawn_again() -> None:
    first, second = np.random.default_rng(1), np.random.default_rng(1)
    faults = [random_fault(first, latest=2.5) for _ in range(500)]
    assert {fault.kind for fault in faults} == set(DRAWN_KINDS)
    assert max(fault.start for fault in faults) <= 2.5
    assert [parse_fault(str(fault)) for fault in faults] == faults
    assert [random_fault(second, latest=2.5) for _ in range(500)] == faults


RIG = load_rig("paper")


class Bench:
    """A bench with faults, and a master on its line, in virtual time."""

    def __init__(self, *faults: str, seed: int = 0) -> None:
        self.plant = StandIn()
        self.rig = EmulatedRig(RIG, self.plant)
        self.faults = Faults(self.rig, [parse_fault(text) for text in faults], seed)
        self.port = VirtualPort(self.rig)
        self.bus = Bus(self.port, self.port, BusTiming(latency=5e-3), retries=0)

    def at(self, time: float) -> "Bench":
        self.port.wait_until(time)
        return self

    def read(self, device: int, row: Register) -> int:
        reply = self.bus.read(device, row.address, row.size)
        assert reply.ok
        return int.from_bytes(reply.data, "little", signed=row.signed)

    def write(self, device: int, name: str, count: int) -> None:
        row = XH430_W350[name]
        assert self.bus.write(device, row.address, encode_raw(row, count)).ok


@pytest.mark.parametrize("kind", ["drop", "truncate"])
def test_who_loses_every_packet_hears_nothing_whole(kind: str) -> None:
    assert not Bench(f"{kind}:p=1").bus.read(1, 132, 4).ok


def test_a_flipped_bit_is_no_answer() -> None:
    bench = Bench("flip:p=1")
    assert not any(bench.bus.read(1, 132, 4).ok for _ in range(200))


@pytest.mark.parametrize(("size", "left"), [(1, []), (2, [1]), (4, [1, 2, 3])])
def test_what_is_truncated_loses_a_byte_at_least_and_keeps_one(size: int, left: list[int]) -> None:
    faults = Faults(EmulatedRig(RIG, StandIn()), [parse_fault("truncate:p=1")])
    struck = [part for _ in range(100) for _, part in faults.disturb(0.0, bytes(range(size)))]
    assert sorted({len(part) for part in struck}) == left
    assert all(part == bytes(range(len(part))) for part in struck)


def test_a_delayed_answer_comes_later_by_as_much_each_way() -> None:
    instruction = b"\xff\xff\xfd\x00\x01\x03\x00\x01\x19\x4e"
    due = []
    for faults in ((), ("delay:p=1,by=20ms",)):
        bench = Bench(*faults)
        bench.rig.receive(instruction, 0.0)
        while not bench.rig.transmit(bench.rig.time):
            bench.at(bench.rig.next_event())
        due.append(bench.rig.time)
    assert due[1] - due[0] == pytest.approx(0.040)


def test_a_fault_is_there_between_its_start_and_its_stop_only() -> None:
    bench = Bench("drop:p=1@1-2")
    assert [bench.at(time).bus.read(1, 132, 4).ok for time in (0.9, 1.1, 1.9, 2.1)] == [True, False, False, True]


def test_with_the_same_seed_the_same_packets_are_struck() -> None:
    logs = []
    for seed in (5, 5, 6):
        bench = Bench("drop:p=0.1", "flip:p=0.1", seed=seed)
        for _ in range(100):
            bench.bus.read(1, 132, 4)
        logs.append(bench.rig.log)
    assert (logs[0] == logs[1], logs[0] == logs[2]) == (True, False)


def test_the_log_tells_when_a_fault_came_and_went() -> None:
    bench = Bench("imu-freeze@1-1.5", "slip-tendon:tendon=2,by=1mm@0.25").at(3.0)
    log = [(each.time, each.kind, each.what) for each in bench.rig.log]
    assert log == [(0.25, "slip-tendon", "begins"), (1.0, "imu-freeze", "begins"), (1.5, "imu-freeze", "ends")]


def test_an_overheated_motor_lets_go() -> None:
    bench = Bench("overheat:motor=3,rate=100@1")
    bench.write(3, "torque_enable", 1)
    assert bench.at(2.0).read(3, XH430_W350["torque_enable"]) == 0


def test_an_overloaded_motor_lets_go_after_a_second() -> None:
    bench = Bench("overload:motor=2@1")
    bench.write(2, "torque_enable", 1)
    held = [bench.at(time).read(2, XH430_W350["torque_enable"]) for time in (1.8, 2.2)]
    assert (held, bench.read(2, XH430_W350["hardware_error_status"])) == ([1, 0], 0x20)


def test_a_motor_without_torque_bears_no_load() -> None:
    assert Bench("overload:motor=2@1").at(5.0).read(2, XH430_W350["hardware_error_status"]) == 0


def test_a_frozen_sensor_has_no_new_sample() -> None:
    bench, time = Bench("imu-freeze@1-2"), OPENCR_NODE["sample_time"]
    stamps = [bench.at(at).read(200, time) for at in (1.1, 1.9, 2.1)]
    assert stamps[0] == stamps[1] < stamps[2]


def test_a_board_loses_a_share_of_the_samples_and_counts_them() -> None:
    bench = Bench("imu-lose:share=25%@1-2")
    lost = [bench.at(at).read(200, OPENCR_NODE["lost_samples"]) for at in (0.9, 2.1, 3.0)]
    assert lost == [0, 50, 50]


def test_a_tendon_is_stuck_for_as_long_as_the_fault_is_there() -> None:
    bench = Bench("stuck-tendon:tendon=1@0-2")
    assert [dict(bench.at(at).plant.stuck) for at in (1.9, 4.0)] == [{0: True}, {0: False}]


def test_a_tendon_slips_once() -> None:
    bench = Bench("slip-tendon:tendon=2,by=1mm@0.5").at(3.0)
    assert bench.plant.slipped == {1: 0.001}


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [("overheat:motor=9", "no motor 9; there is 1, 2, 3, 4, 5"), ("stuck-tendon:tendon=5", "expected 1 to 4")],
)
def test_a_fault_of_what_the_rig_does_not_have_is_refused(fault: str, sentence: str) -> None:
    with pytest.raises(SpecError, match=sentence):
        Bench(fault)


def test_pushes_add_up_and_are_over_when_they_end() -> None:
    spec = load_rig("paper")
    plant = StandIn()
    rig = EmulatedRig(spec, plant)
    Faults(rig, [parse_fault("push:torque=0.5@1-2"), parse_fault("push:torque=0.2@1.5-3")])
    seen = []
    for time in (0.9, 1.1, 1.6, 2.5, 3.1):
        rig.advance(time)
        seen.append(plant.pushed)
    assert seen == pytest.approx([0.0, 0.5, 0.7, 0.2, 0.0])
