"""What the emulated bench notes of its bus watchdogs."""

import math

from tests.unit.emulator_stand_in import Bench

from sinew.emulator.rig import WATCHED_S

UNIT = 0.02  # s


def armed(bench: Bench, device: int, units: int) -> None:
    bench.put(device, "operating_mode", 4)
    bench.put(device, "torque_enable", 1)
    bench.put(device, "bus_watchdog", units)


def test_a_watchdog_trips_its_time_after_the_last_instruction_to_anybody() -> None:
    bench = Bench()
    armed(bench, 1, 4)
    bench.wait(0.05)
    bench.get(3, "present_position")
    heard = bench.rig.line.heard_at
    bench.wait(0.2)
    (trip,) = bench.rig.trips.trips
    assert (trip.motor, trip.heard) == (1, heard)
    assert math.isclose(trip.tripped - trip.heard, 4 * UNIT)


def test_a_motor_that_is_asked_in_time_has_no_trip() -> None:
    bench = Bench()
    armed(bench, 1, 4)
    for _ in range(20):
        bench.wait(0.07)
        bench.get(1, "present_position")
    assert bench.rig.trips.trips == []


def test_a_watchdog_that_is_cleared_and_armed_anew_trips_again() -> None:
    bench = Bench()
    armed(bench, 2, 3)
    bench.wait(0.5)
    bench.put(2, "bus_watchdog", 0)
    bench.put(2, "bus_watchdog", 3)
    bench.wait(0.5)
    assert [trip.motor for trip in bench.rig.trips.trips] == [2, 2]


def test_how_far_a_motor_went_after_it_was_stopped_is_noted() -> None:
    bench = Bench()
    armed(bench, 5, 2)
    bench.wait(2 * UNIT + 0.01)
    before = bench.plant.angles[4]
    bench.plant.angles[4] = before + 0.3
    bench.wait(0.1)
    bench.plant.angles[4] = before - 0.1
    bench.wait(WATCHED_S)
    bench.plant.angles[4] = before + 1.0
    bench.wait(1.0)
    assert math.isclose(bench.rig.trips.trips[0].turned, 0.3, abs_tol=0.02)  # it is on its way back at the first look


def test_a_trip_knows_how_many_reads_of_groups_had_passed() -> None:
    bench = Bench()
    armed(bench, 1, 4)
    bench.bus.sync_read(132, 4, [1, 2, 3])
    bench.get(1, "present_position")
    bench.wait(0.2)
    bench.bus.sync_read(132, 4, [1, 2, 3])
    assert (bench.rig.trips.trips[0].group_reads, bench.rig.line.group_reads) == (1, 2)
