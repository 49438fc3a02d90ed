"""The emulated bench as a whole: wiring, supply, plug, and the truth about its motors."""

import math

import pytest
from tests.unit.emulator_stand_in import Bench, StandIn, paper_rig

from sinew.emulator.rig import EmulatedRig
from sinew.hardware import codec as ask
from sinew.hardware.codec import Read, Write, encode
from sinew.measure.errors import SpecError

COUNT = math.tau / 4096
DRIVE = 5


def held(bench: Bench, **puts: int) -> None:
    """Put all torques on, in extended mode, with further registers set."""
    for device in bench.rig.motors:
        bench.put(device, "operating_mode", 4)
        bench.put(device, "torque_enable", 1)
        for name, count in puts.items():
            bench.put(device, name, count)


def test_the_devices_are_those_of_the_wiring() -> None:
    bench = Bench(paper_rig(tendon_ids=(11, 12, 13, 14), drive_id=20, imu_id=30))
    found = {device: int.from_bytes(reply.data[:2], "little") for device, reply in bench.bus.scan().items()}
    assert found == {11: 1000, 12: 1000, 13: 1000, 14: 1000, 20: 1020, 30: 0x7400}


def test_the_drives_encoder_reads_its_zero_in_the_middle() -> None:
    bench = Bench(paper_rig(drive_zero_counts=1500))
    assert bench.get(DRIVE, "present_position") == 1500


def test_a_drive_mounted_the_other_way_round_counts_down() -> None:
    bench = Bench(paper_rig(drive_sign=-1))
    bench.plant.angles[4] = 100 * COUNT
    assert bench.get(DRIVE, "present_position") == 1948


def test_tendon_motors_begin_at_the_counts_asked() -> None:
    assert Bench(tendon_counts=333).get(3, "present_position") == 333


def test_the_bench_feeds_the_plant_the_rigs_supply() -> None:
    bench = Bench()
    assert bench.plant.supply == bench.spec.drive.supply_voltage.value


def test_another_supply_reaches_plant_and_registers() -> None:
    bench = Bench()
    bench.rig.set_supply(11.1)
    assert (bench.plant.supply, bench.get(1, "present_input_voltage")) == (11.1, 111)


def test_below_brown_out_no_device_answers() -> None:
    bench = Bench()
    bench.rig.set_supply(6.0)
    assert bench.bus.scan() == {}


def test_after_a_brown_out_devices_come_back_without_torque() -> None:
    bench = Bench()
    held(bench)
    bench.rig.set_supply(6.0)
    bench.rig.set_supply(13.0)
    bench.wait(0.2)
    early = len(bench.bus.scan())
    bench.wait(0.2)
    assert (early, len(bench.bus.scan())) == (0, 6)
    assert not any(state.torque for state in bench.rig.states().values())


def test_an_unplugged_bench_hears_and_says_nothing_and_goes_on() -> None:
    bench = Bench()
    held(bench, bus_watchdog=5)
    bench.rig.unplugged = True
    bench.rig.receive(encode(ask.ping(1)), bench.rig.time)
    bench.rig.advance(bench.rig.time + 1.0)
    assert bench.rig.transmit(bench.rig.time) == b""
    assert all(state.is_tripped for state in bench.rig.states().values())


def test_time_does_not_go_back() -> None:
    bench = Bench()
    bench.rig.advance(1.0)
    bench.rig.advance(0.5)
    assert bench.rig.time == 1.0


@pytest.mark.parametrize("step", [0.3, 1e-2, 1e-3])
def test_what_happens_does_not_depend_on_how_finely_time_is_advanced(step: float) -> None:
    bench = Bench(imu_ppm=10.0)
    bench.put(1, "operating_mode", 4)
    bench.put(1, "torque_enable", 1)
    bench.put(1, "profile_velocity", 50)
    bench.put(1, "goal_position", 4000)
    begin = bench.rig.time
    for at in range(1, round(0.3 / step) + 1):
        bench.rig.advance(begin + at * step)
    bench.rig.motion()
    speed = 50 * 0.229 * 4096 / 60  # counts/s
    assert bench.plant.angles[0] / COUNT == pytest.approx(speed * 0.3, abs=speed * 4e-3)


def test_a_stuck_pulley_and_a_slip_reach_the_plant() -> None:
    bench = Bench()
    bench.rig.stick(2, True)
    bench.rig.slip(1, 0.003)
    assert (bench.plant.stuck, bench.plant.slipped) == ({2: True}, {1: 0.003})


def test_a_new_bench_is_stopped_and_safe() -> None:
    bench = Bench()
    assert (bench.rig.stopped(), bench.rig.in_safe_state()) == (True, True)


def test_a_bench_that_holds_with_full_output_is_stopped_but_not_safe() -> None:
    bench = Bench()
    held(bench)
    bench.wait(0.1)
    assert (bench.rig.stopped(), bench.rig.in_safe_state()) == (True, False)


def test_a_bench_that_holds_with_limited_output_is_safe() -> None:
    bench = Bench()
    held(bench, goal_pwm=300)
    bench.wait(0.1)
    assert bench.rig.in_safe_state()


def test_a_motor_under_way_is_neither_stopped_nor_safe() -> None:
    bench = Bench()
    held(bench, goal_pwm=300)
    bench.put(2, "goal_position", 30_000)
    bench.wait(0.1)
    assert (bench.rig.stopped(), bench.rig.in_safe_state()) == (False, False)


def test_a_bench_whose_watchdogs_tripped_is_safe() -> None:
    bench = Bench()
    held(bench, bus_watchdog=5)
    bench.put(2, "goal_position", 30_000)
    bench.wait(0.5)
    assert bench.rig.in_safe_state()


def test_a_cycle_of_five_goals_and_six_answers_fits_into_five_milliseconds() -> None:
    bench = Bench(return_delay=0)
    held(bench)
    reads = [Read(DRIVE, 120, 16), Read(200, 32, 28), *(Read(device, 120, 16) for device in (1, 2, 3, 4))]
    start = bench.port.now()
    bench.bus.bulk_write([Write(device, 116, (2048).to_bytes(4, "little")) for device in bench.rig.motors])
    replies = bench.bus.bulk_read(reads)
    assert all(reply.ok for reply in replies.values())
    assert bench.port.now() - start < 4e-3


@pytest.mark.parametrize(
    ("wiring", "baud", "word"),
    [
        ({"imu_model": "TurtleBot3"}, None, "TurtleBot3"),
        ({}, 12_345, "12345"),
    ],
)
def test_what_is_not_emulated_is_refused_by_name(wiring: dict[str, object], baud: int | None, word: str) -> None:
    with pytest.raises(SpecError, match=word):
        EmulatedRig(paper_rig(**wiring), StandIn(), baud=baud)


def test_two_benches_of_one_seed_say_the_same() -> None:
    said = []
    for _ in range(2):
        bench = Bench(seed=5)
        bench.wait(0.5)
        said.append(bench.bus.read(200, 32, 24))
    assert said[0] == said[1]


def test_a_torque_refused_by_a_fault_shows_in_the_truth() -> None:
    bench = Bench()
    held(bench)
    bench.rig.motors[3].fail()
    states = bench.rig.states()
    assert [states[device].torque for device in (2, 3)] == [True, False]
