"""The head's sensor: axes of the head, samples that have an age, and answers of an earlier time."""

import math
import struct

import pytest
from tests.unit.emulator_stand_in import Bench, paper_rig
from tests.unit.hardware_line import Line, ManualClock

from sinew.hardware.believable import SensorBounds
from sinew.hardware.bus import Bus, Outcome, Reply
from sinew.hardware.imu import ClockTrack, Imu


def answer(gyro=(0, 0, 0), force=(0, 0, 0), sample_us: int = 0, clock_us: int = 0) -> Reply:  # type: ignore[no-untyped-def]
    """Return a node's answer, bytes 32 to 59, as its manual and `sample_time`, `clock` have them."""
    data = struct.pack("<9h", *gyro, *force, 0, 0, 0) + bytes(2) + struct.pack("<II", sample_us, clock_us)
    return Reply(200, Outcome.ANSWERED, data)


def imu(axes: tuple[str, ...] = ("+x", "+y", "+z")) -> Imu:
    clock = ManualClock()
    return Imu(Bus(Line(clock), clock), 200, axes)


@pytest.mark.parametrize("axes", [("+x", "+y", "+z"), ("+z", "-y", "+x"), ("-z", "+x", "-y")])
def test_a_chip_mounted_as_the_wiring_says_gives_what_the_head_does(axes: tuple[str, str, str]) -> None:
    bench = Bench(paper_rig(imu_axes=axes), imu_ppm=0.0)
    bench.plant.gyro, bench.plant.acceleration = (1.0, -2.0, 3.0), (9.0, 3.0, -1.0)
    bench.wait(0.1)
    reading = Imu(bench.bus, 200, axes).read()
    assert reading.gyro == pytest.approx(bench.plant.gyro, abs=0.02)
    assert reading.acceleration == pytest.approx(bench.plant.acceleration, abs=0.1)


@pytest.mark.parametrize(
    ("sample_us", "clock_us", "age_s"),
    [
        (1_000_000, 1_003_500, 3.5e-3),
        (2**32 - 1000, 1500, 2.5e-3),  # over the wrap of the node's clock
        (1_000_010, 1_000_000, -10e-6),  # it came while the node answered
    ],
)
def test_a_sample_is_as_old_as_the_node_says(sample_us: int, clock_us: int, age_s: float) -> None:
    reading = imu().decode(answer(sample_us=sample_us, clock_us=clock_us), 50.0)
    assert reading is not None
    assert reading.time == pytest.approx(50.0 - age_s)


def test_an_answer_of_an_earlier_cycle_is_no_reading() -> None:
    sensor = imu()
    for cycle in range(10):
        sensor.decode(answer(clock_us=5000 * cycle), 1.0 + 5e-3 * cycle)
    assert sensor.decode(answer(clock_us=5000 * 9), 1.0 + 5e-3 * 10) is None


def test_where_the_time_of_the_answer_is_not_known_the_nodes_clock_tells_it() -> None:
    sensor = imu()
    sensor.decode(answer(clock_us=1_000_000), 50.0)
    reading = sensor.decode(answer(sample_us=1_004_000, clock_us=1_006_000), math.nan)
    assert reading is not None
    assert reading.time == pytest.approx(50.004)


def test_without_any_known_time_there_is_no_reading() -> None:
    assert imu().decode(answer(), math.nan) is None


def tick_of(time: float) -> int:
    return int(time * 1000) % 32_768


def track() -> ClockTrack:
    return ClockTrack(1e-3, 32_768)


def test_answers_of_their_own_time_are_fresh_over_many_wraps_and_with_a_drifting_crystal() -> None:
    followed = track()
    times = [5e-3 * cycle for cycle in range(30_000)]  # 150 s, more than four wraps
    assert all(followed.is_fresh(tick_of(time * (1 + 200e-6)), time) for time in times)


def test_an_answer_one_cycle_old_is_not_fresh_and_the_next_good_one_is() -> None:
    followed = track()
    for cycle in range(100):
        followed.is_fresh(tick_of(5e-3 * cycle), 5e-3 * cycle)
    assert not followed.is_fresh(tick_of(0.495), 0.500)
    assert followed.is_fresh(tick_of(0.505), 0.505)


def test_a_counter_that_stands_still_is_fresh_no_more() -> None:
    followed = track()
    fresh = [followed.is_fresh(1000, 5e-3 * cycle) for cycle in range(50)]
    assert not any(fresh[1:])


def test_a_device_that_has_started_anew_is_not_fresh_until_reset() -> None:
    followed = track()
    for cycle in range(100):
        followed.is_fresh(tick_of(9.0 + 5e-3 * cycle), 5e-3 * cycle)
    after = [followed.is_fresh(tick_of(5e-3 * cycle), 0.5 + 5e-3 * cycle) for cycle in range(100)]
    followed.reset()
    assert not any(after)
    assert followed.is_fresh(tick_of(0.6), 1.1)


@pytest.mark.parametrize("wrong", [-20e-3, -6e-3, 6e-3, 20e-3])
@pytest.mark.parametrize("when", [0, 1, 2, 7, 14])
def test_one_wrong_answer_among_the_first_does_not_make_the_later_ones_stale(wrong: float, when: int) -> None:
    followed = track()
    times = [1.0 + 5e-3 * cycle for cycle in range(40)]
    fresh = [followed.is_fresh(tick_of(time + wrong * (i == when)), time) for i, time in enumerate(times)]
    assert all(fresh[max(when + 1, 2) :])


def test_one_wrong_answer_after_a_gap_does_not_make_the_later_ones_stale() -> None:
    followed = track()
    for cycle in range(40):
        followed.is_fresh(tick_of(1.0 + 5e-3 * cycle), 1.0 + 5e-3 * cycle)
    followed.is_fresh(tick_of(3.010), 3.0)
    assert all([followed.is_fresh(tick_of(3.005 + 5e-3 * cycle), 3.005 + 5e-3 * cycle) for cycle in range(40)][1:])


@pytest.fixture
def bounds() -> SensorBounds:
    """Return bounds after ten samples 5 ms apart at rest."""
    bounds = SensorBounds(paper_rig())
    for n in range(10):
        assert bounds.objection((0.0, 0.0, 0.0), (16_384, 0, 0), 5000 * n, 5000 * n + 300) == ""
    return bounds


@pytest.mark.parametrize(
    ("rate", "forces", "counter", "clock", "found"),
    [
        (5.0, (16_384, 0, 0), 50_000, 50_300, ""),
        (30.0, (16_384, 0, 0), 50_000, 50_300, "its rates jump"),
        (0.0, (0, 0, 0), 50_000, 50_300, "it tells no acceleration at all, as in free fall"),
        (0.0, (16_384, 0, 0), 40_000, 50_300, "its sample is dated before the last one, or after its answer"),
        (0.0, (16_384, 0, 0), 90_000, 50_300, "its sample is dated before the last one, or after its answer"),
        (0.1, (16_384, 0, 0), 45_000, 50_300, "two different samples have one time"),
        (0.0, (16_384, 0, 0), 45_000, 50_300, ""),
    ],
)
def test_a_sample_that_cannot_follow_the_last_one_is_told(
    bounds: SensorBounds, rate: float, forces: tuple[int, int, int], counter: int, clock: int, found: str
) -> None:
    assert bounds.objection((rate, 0.0, 0.0), forces, counter, clock) == found


@pytest.mark.parametrize(("counter", "clock"), [(2_000, 1_000_000), (1_000_000, 1_000_300), (2**32 - 100, 200)])
def test_the_first_sample_may_be_of_any_time_before_its_answer(counter: int, clock: int) -> None:
    assert SensorBounds(paper_rig()).objection((0.0, 0.0, 0.0), (16_384, 0, 0), counter, clock) == ""


@pytest.mark.parametrize(("counter", "clock"), [(1_000_000, 900_000), (200, 2**32 - 100_000)])
def test_the_first_sample_cannot_be_dated_after_its_answer(counter: int, clock: int) -> None:
    found = SensorBounds(paper_rig()).objection((0.0, 0.0, 0.0), (16_384, 0, 0), counter, clock)
    assert found == "its sample is dated after its answer"


def test_the_strongest_swing_of_the_paper_is_far_inside_what_a_sample_may_do(bounds: SensorBounds) -> None:
    # 60° at 4.3 Hz: the rate reaches 28 rad/s, and changes by 3.8 rad/s in 5 ms where it is quickest.
    rates = [math.radians(60) * math.tau * 4.3 * math.sin(math.tau * 4.3 * 5e-3 * n) for n in range(200)]
    clocks = range(50_000, 50_000 + 200 * 5000, 5000)
    told = [bounds.objection((r, 0.0, 0.0), (16_384, 0, 0), at, at + 300) for r, at in zip(rates, clocks, strict=True)]
    assert set(told) == {""}


def test_a_false_first_sample_costs_two_and_not_all() -> None:
    bounds = SensorBounds(paper_rig())
    told = [bounds.objection((30.0 if n == 0 else 0.0, 0, 0), (16_384, 0, 0), 5000 * n, 5000 * n) for n in range(4)]
    assert [bool(words) for words in told] == [False, True, False, False]


def test_the_age_survives_the_wrap_of_the_nodes_clock() -> None:
    reading = imu().decode(answer(sample_us=2**32 - 1000, clock_us=1500), 50.0)
    assert reading is not None
    assert reading.time == pytest.approx(50.0 - 2.5e-3)
