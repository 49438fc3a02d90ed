"""The emulated bench as a whole: wiring, supply, plug, and the truth about its motors."""

import math

import pytest
from tests.unit.emulator_stand_in import Bench, StandIn, paper_rig

from sinew.emulator.bench import EYE, EmulatedRig
from sinew.hardware import codec as ask
from sinew.hardware.bus import Bus, BusTiming
from sinew.hardware.codec import Read, Write, encode
from sinew.hardware.ports import PLUG_ALL, TURN_LEVER
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


def test_a_motor_under_way_is_neither_stopped_nor_safe() -> None:
    bench = Bench()
    held(bench, goal_pwm=300)
    bench.put(2, "goal_position", 30_000)
    bench.wait(0.1)
    assert (bench.rig.stopped(), bench.rig.in_safe_state()) == (False, False)


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
        ({"imu_model": "MPU-9250"}, None, "MPU-9250"),
        ({}, 12_345, "12345"),
    ],
)
def test_what_is_not_emulated_is_refused_by_name(wiring: dict[str, object], baud: int | None, word: str) -> None:
    with pytest.raises(SpecError, match=word):
        EmulatedRig(paper_rig(**wiring), StandIn(), baud=baud)


# What a guide asks of a person, the bench does: motors are plugged in by what their labels say, the lever is turned.


def heard(bench: Bench, baud: int) -> list[int]:
    """Return the ids that answer at a baud."""
    bench.rig.line.host_baud = baud
    bench.wait(0.5)
    return sorted(Bus(bench.port, bench.port, BusTiming(baud)).scan())


def test_new_motors_are_on_the_table_and_one_that_is_plugged_in_has_the_factorys_id_and_baud() -> None:
    bench = Bench()
    bench.rig.unbox()
    before = heard(bench, 57_600), heard(bench, 1_000_000)
    bench.rig.do(2)
    assert (before, heard(bench, 57_600)) == (([], [200]), [1])


def test_a_motor_is_plugged_in_by_its_label_whatever_it_pulls_and_one_that_is_not_loses_its_torque() -> None:
    bench = Bench(paper_rig(tendon_ids=(2, 1, 3, 4)))
    bench.put(3, "torque_enable", 1)
    bench.rig.do(1)
    assert [device.id for device in bench.rig.line.devices] == [1, 200]
    assert not bench.rig.motors[3].torque
    bench.rig.do(PLUG_ALL)
    assert len(bench.rig.line.devices) == 6


def test_the_lever_is_turned_to_its_middle_as_far_as_an_eye_sees() -> None:
    bench = Bench()
    bench.plant.angles[-1] = 0.7
    bench.rig.do(TURN_LEVER)
    assert abs(bench.rig.motion().drive.angle) < 5 * EYE
