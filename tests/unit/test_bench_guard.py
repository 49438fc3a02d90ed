"""The guard, on readings made up one by one: at rest all is well, and each fault alone is caught, by name."""

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from sinew.bench.guard import LOST_AFTER_S, Guard, Watch
from sinew.bench.loop import Loop
from sinew.hardware.imu import ImuReading
from sinew.hardware.rig import Climate, Lack, MotorReading, Reading
from sinew.measure.errors import LimitError, LostError
from sinew.plan.toml import load_rig

SPEC = load_rig("paper")
LIMITS = SPEC.limits
RADIUS = SPEC.tendons.pulley_radius.value
PERIOD = 0.005
CURRENT = 0.1
GIVE = CURRENT * SPEC.tendons.torque_constant.value / RADIUS / SPEC.tendons.servo_stiffness.value / RADIUS
HORN = MotorReading(angle=3.0 - GIVE, speed=0.0, current=CURRENT, duty=0.1, tick=0, alert=False)
WATCH = Watch(origin=(3.0,) * 4, goals=(3.0,) * 4, resting=True, share=(0.25,) * 4)

LEVEL = (0.0, 0.0)


def reading(cycle: int = 0) -> Reading:
    imu = ImuReading((0.0, 0.0, 0.0), (9.81, 0.0, 0.0), counter=5000 * cycle, time=PERIOD * cycle)
    lever = replace(HORN, angle=0.0)
    return Reading(PERIOD * cycle, lever, (HORN,) * 4, imu, Climate("drive", 12.0, 30.0), ())


def with_tendon(which: int, **changes: object) -> tuple[MotorReading, ...]:
    return tuple(replace(HORN, **changes) if i == which else HORN for i in range(4))  # type: ignore[arg-type]


def watch(cycles: int, watched: Watch = WATCH, tilt: tuple[float, float] = (0.0, 0.0), **changes: object) -> None:
    """Guard so many cycles of which each is at rest but for the changes."""
    guard = Guard(SPEC)
    for cycle in range(cycles):
        guard.check(replace(reading(cycle), **changes), tilt, PERIOD * cycle, watched)  # type: ignore[arg-type]


def test_a_joint_at_rest_is_left_alone_for_ten_seconds() -> None:
    watch(2000)


ONE_CYCLE: dict[str, dict[str, Any]] = {
    "tendon_current_a": {"tendons": with_tendon(2, current=LIMITS.tendon_current_a * 1.01)},
    "tension_n": {"tendons": with_tendon(0, current=LIMITS.tension_n * RADIUS / 2.62 * 1.01)},
    "tendon_travel_mm": {"tendons": with_tendon(1, angle=3.0 + 1e-3 * LIMITS.tendon_travel_mm[1] / RADIUS * 1.01)},
    "drive_window_deg": {"drive": replace(HORN, angle=-math.radians(LIMITS.drive_window_deg * 1.01))},
    "temperature_c": {"climate": Climate("tendon 3", 12.0, LIMITS.temperature_c + 1)},
    "voltage_v": {"climate": Climate("tendon 3", LIMITS.voltage_v[0] - 0.1, 30.0)},
    "tendon_current_a: it pushes": {"tendons": with_tendon(2, current=-LIMITS.tendon_current_a * 1.01)},
    "tendon_travel_mm: it gives": {
        "tendons": with_tendon(1, angle=3.0 + 1e-3 * LIMITS.tendon_travel_mm[0] / RADIUS - 0.01)
    },
    "drive_window_deg: forwards": {"drive": replace(HORN, angle=math.radians(LIMITS.drive_window_deg * 1.01))},
    "tilt_deg": {"tilt": (math.radians(LIMITS.tilt_deg * 1.01), 0.0)},
    "voltage_v: too much": {"climate": Climate("tendon 3", LIMITS.voltage_v[1] + 0.1, 30.0)},
}


@pytest.mark.parametrize("key", ONE_CYCLE)
def test_a_value_beyond_its_limit_stops_the_run_in_that_very_cycle(key: str) -> None:
    with pytest.raises(LimitError, match=key.split(":")[0]):
        watch(1, **ONE_CYCLE[key])


def test_a_drive_current_that_stays_beyond_its_limit_stops_the_run() -> None:
    with pytest.raises(LimitError, match="drive_current_a"):
        watch(200, drive=replace(HORN, angle=0.0, current=-LIMITS.drive_current_a * 1.05))


def test_a_spike_of_the_drive_current_of_two_cycles_does_not() -> None:
    guard = Guard(SPEC)
    for cycle in range(100):
        current = 1.5 * LIMITS.drive_current_a if cycle in (50, 51) else 0.5
        lever = replace(HORN, angle=0.0, current=current)
        guard.check(replace(reading(cycle), drive=lever), LEVEL, PERIOD * cycle, WATCH)


BENT = replace(WATCH, pose=(0.0, math.radians(20.0)))


def test_a_head_in_the_pose_that_was_asked_for_is_left_alone() -> None:
    watch(1, watched=BENT, tilt=BENT.pose)


def test_a_bent_head_that_stands_upright_is_stopped_as_one_that_leans_from_its_pose() -> None:
    with pytest.raises(LimitError, match=r"tilt of the head plate from its pose is 20 °.*tilt_deg"):
        watch(1, watched=BENT)


def test_a_bent_head_that_twists_turns_its_sensor_but_stays_in_its_pose() -> None:
    # 40° of torsion within 0.2 s, of which a bent head's gyroscope reads (1 + cos 20°)/2; the sensor's tilt turns back.
    guard, bend, rate = Guard(SPEC), math.radians(20.0), math.radians(200.0)
    share = (1 + math.cos(bend)) / 2
    for cycle in range(41):
        torsion = rate * PERIOD * cycle
        seen = replace(reading(cycle).imu, gyro=(rate * share if cycle else 0.0, 0.0, 0.0))  # type: ignore[type-var]
        leaning = (bend * math.sin(torsion), bend * math.cos(torsion))
        guard.check(replace(reading(cycle), imu=seen), leaning, PERIOD * cycle, BENT)
    assert math.degrees(guard.torsion) == pytest.approx(40.0, abs=2.5)


def swing(share_of_limit: float, cycles: int) -> None:
    guard, omega = Guard(SPEC), 2 * math.pi * 3.0
    amplitude = share_of_limit * math.radians(LIMITS.torsion_deg)
    for cycle in range(cycles):
        rate = amplitude * omega * math.cos(omega * PERIOD * cycle)
        imu = ImuReading((rate, 0.0, 0.0), (9.81, 0.0, 0.0), 5000 * cycle, PERIOD * cycle)
        guard.check(replace(reading(cycle), imu=imu), LEVEL, PERIOD * cycle, WATCH)


def test_a_swing_beyond_the_limit_of_torsion_stops_the_run() -> None:
    with pytest.raises(LimitError, match="torsion_deg"):
        swing(1.05, 400)


def test_a_swing_within_the_limit_of_torsion_is_left_alone() -> None:
    swing(0.9, 2000)


LOST: dict[str, tuple[int, Watch, dict[str, Any]]] = {
    "tendon 4 raises its alert": (1, WATCH, {"tendons": with_tendon(3, alert=True)}),
    "drive has not answered": (2 + round(LOST_AFTER_S / PERIOD), WATCH, {"drive": None}),
    "IMU repeats one sample": (2 + round(LOST_AFTER_S / PERIOD), WATCH, {"imu": reading().imu}),
    "tendon 2 stands": (100, WATCH, {"tendons": with_tendon(1, angle=HORN.angle - 1.2e-3 / RADIUS)}),
    "tendon 1 pulls with 70 mA, expected 100": (
        100,
        replace(WATCH, by_current=True, goals=(CURRENT,) * 4, share=None),
        {"tendons": with_tendon(0, current=0.07)},
    ),
    "tendon 3 carries .* has a cable slipped or caught": (
        600,
        replace(WATCH, resting=False),
        {"tendons": with_tendon(2, current=0.5 * CURRENT)},
    ),
}


@pytest.mark.parametrize("said", LOST)
def test_a_device_that_is_not_as_it_must_be_is_named_after_so_many_cycles(said: str) -> None:
    cycles, watched, changes = LOST[said]
    with pytest.raises(LostError, match=said):
        watch(cycles, watched, **changes)


def test_a_pause_of_the_computer_is_not_taken_for_a_silent_device() -> None:
    guard = Guard(SPEC)
    guard.check(reading(0), LEVEL, 0.0, WATCH)
    guard.check(replace(reading(20), drive=None), LEVEL, 20 * PERIOD, WATCH)


def test_a_tendon_on_its_way_is_not_called_stuck() -> None:
    watch(100, replace(WATCH, resting=False), tendons=with_tendon(1, angle=HORN.angle - 1.2e-3 / RADIUS))


def test_a_pretension_whose_tendons_carry_other_parts_than_the_one_before_is_left_alone() -> None:
    # A pose of 20° at 6 mm, then at 12 mm: the parts of the tension that are right there.
    guard, cycles = Guard(SPEC), itertools.count()
    for currents in ((0.25, 0.41, 0.25, 0.09), (0.25, 0.31, 0.25, 0.19)):
        tendons = tuple(replace(HORN, current=0.4 * part) for part in currents)
        for watched in (replace(WATCH, share=None, resting=False), replace(WATCH, share=currents, resting=False)):
            for cycle in itertools.islice(cycles, 100):
                guard.check(replace(reading(cycle), tendons=tendons), LEVEL, PERIOD * cycle, watched)


def _check_all(guard: Guard, cycles: list[tuple[Reading, tuple[float, float], float, Watch]]) -> None:
    for cycle in cycles:
        guard.check(*cycle)


def test_a_silent_sensor_is_borne_as_long_as_it_may_be_and_no_longer() -> None:
    guard = Guard(SPEC)
    guard.imu_patience = 0.5
    for cycle in range(100):
        guard.check(replace(reading(cycle), imu=reading().imu), LEVEL, PERIOD * cycle, WATCH)
    late = [(replace(reading(cycle), imu=reading().imu), LEVEL, PERIOD * cycle, WATCH) for cycle in range(100, 110)]
    with pytest.raises(LostError, match="IMU repeats one sample"):
        _check_all(guard, late)


def test_a_motor_is_not_given_the_sensors_patience() -> None:
    guard = Guard(SPEC)
    guard.imu_patience = 10.0
    silent = [(replace(reading(cycle), drive=None), LEVEL, PERIOD * cycle, WATCH) for cycle in range(30)]
    with pytest.raises(LostError, match="drive has not answered"):
        _check_all(guard, silent)


def test_a_rate_that_stands_still_does_not_turn_the_head_further() -> None:
    guard = Guard(SPEC)
    guard.imu_patience = 1.0
    stuck = ImuReading((10.0, 0.0, 0.0), (9.81, 0.0, 0.0), counter=1, time=0.0)  # 10 rad/s for 0.5 s would be 286°
    for cycle in range(100):
        guard.check(replace(reading(cycle), imu=stuck), LEVEL, PERIOD * cycle, WATCH)
    assert abs(guard.torsion) < math.radians(10)


def looped(told: list[Reading]) -> Loop:
    """Return a loop whose rig gives these readings one by one."""
    rig = SimpleNamespace(spec=SPEC, tendons=range(4), motors=(), write_goals=lambda *_: None, read=lambda: told.pop(0))
    rig.bus, rig.goals_s = SimpleNamespace(others=0), 0.0
    rig.pace = lambda _period: None
    clock, guard = SimpleNamespace(now=lambda: 0.0, wait_until=lambda _: None), SimpleNamespace()
    guard.check = guard.forget = lambda *_: None
    tilt = SimpleNamespace(update=lambda *_: 0.0, components=(0.0, 0.0))
    return Loop(cast("Any", rig), cast("Any", clock), cast("Any", guard), cast("Any", tilt), PERIOD, lambda _: None)


def test_a_cycle_without_an_answer_of_the_sensor_is_recorded_without_its_values() -> None:
    sample = looped([replace(reading(), imu=None)]).cycle()
    assert all(math.isnan(value) for value in (sample.imu_time_s, sample.imu_counter_s, *sample.gyro_rad_s))


def test_after_a_standstill_the_means_that_hold_samples_from_before_it_are_unknown() -> None:
    stood = [replace(reading(k), imu=reading(min(k, 4)).imu) for k in range(10)]
    loop = looped([*stood, *map(reading, range(10, 20))])
    known = [not math.isnan(loop.cycle().gyro_rad_s[0]) for _ in range(20)]
    mixed = SPEC.imu.average_samples - 1  # of the means after the standstill, so many reach back before it
    assert known == [True] * 10 + [False] * mixed + [True] * (10 - mixed)


@pytest.mark.parametrize(
    ("why", "words", "said"),
    [
        ("damaged", "its answers come damaged", r"tendon 3: .*its answers come damaged; noise, or two devices at once"),
        ("stale", "its answers come late", r"tendon 3: .*latency timer"),
        ("impossible", "its position jumps by 170° in 5 ms", r"tendon 3: .*jumps by 170° in 5 ms; check supply"),
        ("silent", "it sends nothing", r"tendon 3 has not answered for .*check cables and supply"),
    ],
)
def test_a_device_whose_answers_do_not_count_is_named_with_the_reason(why: Any, words: str, said: str) -> None:
    without = tuple(None if i == 2 else HORN for i in range(4))
    with pytest.raises(LostError, match=said):
        watch(30, tendons=without, lacks=(Lack("tendon 3", why, words),))


def test_where_all_fall_silent_at_once_the_supply_is_named() -> None:
    lacks = tuple(Lack(name, "silent", "it sends nothing") for name in ("tendon 1", "drive", "IMU"))
    with pytest.raises(LostError, match=r"all devices at once have not answered .* their supply failed or dipped"):
        watch(30, tendons=(None,) * 4, drive=None, imu=None, climate=None, lacks=lacks)
