"""The pretension routine on emulated devices with the joint behind them, in virtual time; the mechanics know best."""

import math
from dataclasses import dataclass, field
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tests.experiments.modes import MODES, Row, run_trial

from sinew.bench.pretension import GOOD_ENOUGH_DEG, MOST_S, Contact, Held, MotorMap, level
from sinew.bench.record.sample import MISSING
from sinew.measure.errors import LostError
from sinew.plan.plan import TendonMode
from sinew.plan.servo import PULSE
from sinew.plan.toml import load_rig


@cache
def trial(mode: TendonMode, seed: int = 0) -> list[Row]:
    return run_trial(mode, seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(2, 6))])
@pytest.mark.parametrize("mode", MODES)
def test_any_slack_and_any_lean_come_out_the_same(mode: TendonMode, seed: int) -> None:
    for row in trial(mode, seed):
        assert row.tilt_deg < 0.2
        if mode == "current":
            assert abs(row.current_a / row.asked_current_a - 1) < 0.05
        else:
            assert abs(row.reached_mm - row.pretension_mm) < 0.1


def test_a_tilted_plate_is_answered_by_shortening_the_cable_under_its_raised_side() -> None:
    spec = load_rig("paper")
    motors = MotorMap(spec, "position", Contact((3.0,) * 4, 0.042), {})
    level, leaning = motors.goals(4.0, (0.0, 0.0)), motors.goals(4.0, (0.01, 0.0))  # +0.01 rad about y raises +z
    rise = 0.01 * spec.tendons.head_radius.value / spec.tendons.pulley_radius.value
    moved = [b - a for a, b in zip(level, leaning, strict=True)]
    assert moved == pytest.approx([0.0, rise, 0.0, -rise], abs=2 * PULSE)  # either goal is in whole counts


def test_a_correction_of_tilt_leaves_the_pretension_where_it_was() -> None:
    # What one tendon takes up its opposite lets go. Rounded to counts one by one, all four may step the same way.
    motors = MotorMap(load_rig("paper"), "position", Contact((3.0, 3.1, 2.9, 3.05), 0.042), {})
    leans = np.random.default_rng(0).uniform(-0.02, 0.02, (300, 2))
    counts = [sum(round(goal / PULSE) for goal in motors.goals(4.0, (y, z))) for y, z in leans]
    assert max(counts) == min(counts)


def test_goals_by_current_are_never_negative() -> None:
    motors = MotorMap(load_rig("paper"), "current", Contact((3.0,) * 4, 0.042), {0.0: Held((0.0,) * 4, (0.5,) * 4)})
    assert min(motors.goals(0.0, (math.radians(10), 0.0))) == 0.0


@dataclass
class Plate:
    """A plate that leans by what its tendons do not take up, 60 ms late; of each ten cycles the sensor misses some."""

    lean: tuple[float, float]
    missed: int
    period: float = 0.005
    watch: Any = field(default_factory=lambda: SimpleNamespace(by_current=False))
    correction: tuple[float, ...] = (0.0, 0.0)
    cycles: int = 0

    def __post_init__(self) -> None:
        self.tilt = self.lean

    def cycle(self) -> Any:
        weight = self.period / 0.06
        pairs = zip(self.tilt, self.lean, self.correction, strict=True)
        self.tilt = tuple(old + weight * (lean - taken - old) for old, lean, taken in pairs)  # type: ignore[assignment]
        self.cycles += 1
        y, z = self.tilt
        seen = (9.81, -9.81 * math.tan(z), 9.81 * math.tan(y))
        sensed = (MISSING,) * 3 if self.cycles % 10 < self.missed else seen
        return SimpleNamespace(acceleration_m_s2=sensed, tendon_current_a=())

    def set_goals(self, goals: tuple[float, ...]) -> None:
        self.correction = goals


def test_a_plate_comes_level_though_its_sensor_misses_every_second_answer() -> None:
    plate = Plate((math.radians(3.0), math.radians(-2.0)), missed=5)
    found = level(cast("Any", plate), lambda offsets: offsets, (0.0, 0.0))
    assert math.hypot(*plate.tilt) < math.radians(GOOD_ENOUGH_DEG)
    assert found.offsets == pytest.approx(plate.lean, abs=math.radians(0.2))


def test_a_plate_whose_sensor_never_answers_is_not_called_level() -> None:
    with pytest.raises(LostError):
        level(cast("Any", Plate((0.0, 0.0), missed=10)), lambda offsets: offsets, (0.0, 0.0))


@dataclass
class Swaying:
    """A plate with mass on tendons: a mode of 9 Hz, Lehr damping 0.02; its accelerometer sees how it is pushed, too."""

    lean: tuple[float, float]
    period: float = 0.005
    watch: Any = field(default_factory=lambda: SimpleNamespace(by_current=False))
    correction: tuple[float, ...] = (0.0, 0.0)

    def __post_init__(self) -> None:
        self.tilt, self.rate = list(self.lean), [0.0, 0.0]

    def cycle(self) -> Any:
        omega, arm, pushed = math.tau * 9.0, 0.05, [0.0, 0.0]
        for _ in range(10):
            for i in range(2):
                lacking = self.lean[i] - self.correction[i] - self.tilt[i]
                pushed[i] = omega**2 * lacking - 0.04 * omega * self.rate[i]
                self.rate[i] += 0.1 * self.period * pushed[i]
                self.tilt[i] += 0.1 * self.period * self.rate[i]
        (y, z), (a, b) = self.tilt, pushed
        seen = (9.81 * math.cos(math.hypot(y, z)), -9.81 * math.sin(z) + arm * b, 9.81 * math.sin(y) - arm * a)
        return SimpleNamespace(acceleration_m_s2=seen, tendon_current_a=())

    def set_goals(self, goals: tuple[float, ...]) -> None:
        self.correction = goals


@pytest.mark.parametrize("pose_deg", [0.0, 10.0, 25.0])
def test_a_plate_with_mass_comes_to_its_pose_without_being_made_to_sway(pose_deg: float) -> None:
    pose = (0.0, math.radians(pose_deg))
    plate = Swaying((math.radians(2.0), math.radians(-1.5) + pose[1]))
    level(cast("Any", plate), lambda offsets: offsets, (0.0, 0.0), pose)
    assert math.dist(plate.tilt, pose) < math.radians(2 * GOOD_ENOUGH_DEG)


@dataclass
class Counted(Plate):
    """A plate on motors that hold currents in whole counts, each of which tilts it by so much."""

    count: float = math.radians(0.28)

    def whole(self, goals: tuple[float, float]) -> tuple[float, float]:
        y, z = (self.count * round(goal / self.count) for goal in goals)
        return y, z

    def set_goals(self, goals: tuple[float, ...]) -> None:
        self.correction = self.whole((goals[0], goals[1]))


@pytest.mark.parametrize("between", [0.1, 0.35, 0.5, 0.65, 0.9])
def test_a_plate_between_two_counts_of_current_is_left_at_the_nearest(between: float) -> None:
    watch = SimpleNamespace(by_current=True)
    count = math.radians(0.28)
    plate = Counted(((7 + between) * count, (-4 + between) * count), missed=0, watch=watch)
    found = level(cast("Any", plate), lambda offsets: offsets, (0.0, 0.0), count=count, whole=plate.whole)
    assert max(map(abs, plate.tilt)) < 0.51 * count
    assert found.duration_s < MOST_S


def test_counts_of_current_leave_half_a_count_of_tilt_at_most_and_of_the_mean() -> None:
    spec = load_rig("paper")
    lsb = spec.tendons.current_lsb.value
    motors = MotorMap(spec, "current", Contact((3.0,) * 4, 0.042), {2.0: Held((2.0,) * 4, (20.0,) * 4)})
    for step in range(50):
        lean = (math.radians(0.013 * step), math.radians(-0.037 * step))
        counts = [goal / lsb for goal in motors.goals(2.0, lean)]
        wanted = [lean[0] / motors.count(2.0), -lean[1] / motors.count(2.0)]  # of tendons 2 less 4, of 1 less 3
        found = [counts[1] - counts[3], counts[0] - counts[2]]
        assert counts == pytest.approx([round(count) for count in counts], abs=1e-9)
        assert found == pytest.approx(wanted, abs=0.501)
        assert sum(counts) / 4 == pytest.approx(spec.tendons.current(20.0) / lsb, abs=0.501)


def test_whole_counts_make_of_a_correction_what_their_tensions_bend() -> None:
    motors = MotorMap(load_rig("paper"), "current", Contact((3.0,) * 4, 0.042), {2.0: Held((2.0,) * 4, (20.0,) * 4)})
    made = motors.whole(2.0, (math.radians(3.0), math.radians(-2.0)))
    assert made == pytest.approx((math.radians(3.0), math.radians(-2.0)), abs=0.51 * motors.count(2.0))


def test_a_pose_held_by_currents_has_the_tension_of_each_tendon() -> None:
    spec = load_rig("paper")
    held = {6.0: Held((6.0,) * 4, (42.0, 69.0, 42.0, 15.0))}
    motors = MotorMap(spec, "current", Contact((3.0,) * 4, 0.042), held)
    half = 0.501 * spec.tendons.current_lsb.value
    wanted = [spec.tendons.current(t) for t in (42.0, 69.0, 42.0, 15.0)]
    assert motors.goals(6.0, (0.0, 0.0)) == pytest.approx(wanted, abs=2 * half)
