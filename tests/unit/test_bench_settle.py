"""The adaptive settle rule against the closed-form transient of a damped joint that is driven from rest."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy import signal

from sinew.bench.group import SettleRule
from sinew.plan.plan import Sweep

RATE_HZ = 200.0
TOLERANCE = 0.01
SETTLE_S, MOST_S = 1.0, 20.0


@dataclass(frozen=True)
class Driven:
    """φ̈ + 2Dω₀φ̇ + ω₀²φ = -s θ̈, θ = θ₁ sin Ωt from t = 0 on: the jump of θ̇ kicks the joint by -s Ω θ₁.

    natural_hz, damping: ω₀/2π, D. frequency_hz, amplitude_rad: Ω/2π, θ₁. share: s.
    """

    natural_hz: float
    damping: float
    frequency_hz: float
    share: float = 0.6
    amplitude_rad: float = math.radians(20.0)

    @property
    def steady(self) -> complex:
        """Complex amplitude of the steady rate, of exp(jΩt), imaginary part taken."""
        ratio = self.frequency_hz / self.natural_hz
        torsion = self.amplitude_rad * self.share * ratio**2 / (1 - ratio**2 + 2j * self.damping * ratio)
        return 2j * math.pi * self.frequency_hz * torsion

    @property
    def decay_rate(self) -> float:
        return self.damping * 2 * math.pi * self.natural_hz

    @property
    def free(self) -> complex:
        """Complex amplitude of the dying rate, of exp(pt), real part taken."""
        omega = 2 * math.pi * self.frequency_hz
        torsion = self.steady / (1j * omega)
        start = -torsion.imag
        kick = -self.share * self.amplitude_rad * omega - self.steady.imag
        damped = 2 * math.pi * self.natural_hz * math.sqrt(1 - self.damping**2)
        constant = start - 1j * (kick + self.decay_rate * start) / damped
        return constant * complex(-self.decay_rate, damped)

    def rate(self, time: np.ndarray) -> np.ndarray:
        damped = 2 * math.pi * self.natural_hz * math.sqrt(1 - self.damping**2)
        steady = (self.steady * np.exp(2j * math.pi * self.frequency_hz * time)).imag
        return steady + (self.free * np.exp(complex(-self.decay_rate, damped) * time)).real

    def remaining(self, time: float) -> float:
        """Envelope of the transient over the steady amplitude."""
        return abs(self.free) * math.exp(-self.decay_rate * time) / abs(self.steady)

    def needed(self) -> float:
        """When the remaining share is at the tolerance [s]."""
        return math.log(self.remaining(0.0) / TOLERANCE) / self.decay_rate


def settle(
    joint: Driven, random: np.random.Generator | None, *, noise: float = math.radians(0.08)
) -> tuple[float, SettleRule]:
    """When the rule lets the recording begin [s], and the rule; noise [rad/s] as behind the gyroscope's filters."""
    time = np.arange(round((MOST_S + 1.0) * RATE_HZ)) / RATE_HZ
    rate = joint.rate(time) + math.radians(0.05)
    if random is not None:
        coloured = signal.lfilter(*signal.butter(2, 41.0, fs=RATE_HZ), random.standard_normal(time.size + 2))
        coloured = np.convolve(coloured, np.ones(3) / 3, "valid")
        rate += noise * coloured / coloured.std()
    rule = SettleRule(joint.frequency_hz, SETTLE_S, TOLERANCE, MOST_S)
    turn = 0
    while not rule.is_settled:
        inside = (time >= turn / joint.frequency_hz - 1e-9) & (time < (turn + 1) / joint.frequency_hz - 1e-9)
        rule.feed(time[inside].tolist(), rate[inside].tolist())
        turn += 1
    return turn / joint.frequency_hz, rule


def drawn(count: int, seed: int) -> list[tuple[Driven, np.random.Generator]]:
    """Joints and drives as a sweep meets them, D from 0.02 to 0.25."""
    random = np.random.default_rng(seed)
    return [
        (Driven(random.uniform(2.8, 4.5), math.exp(random.uniform(math.log(0.02), math.log(0.25))), frequency), random)
        for frequency in random.uniform(1.5, 6.0, count)
    ]


def test_the_transient_in_closed_form_starts_from_rest() -> None:
    assert Driven(3.2, 0.08, 2.5).rate(np.array([0.0]))[0] == pytest.approx(-0.6 * math.radians(20) * 2 * math.pi * 2.5)


@pytest.mark.slow
def test_less_than_twice_the_tolerance_is_left_in_95_of_100_noisy_cases() -> None:
    left = [joint.remaining(settle(joint, random)[0]) for joint, random in drawn(150, 5)]
    assert np.mean(np.array(left) < 2 * TOLERANCE) >= 0.95


@pytest.mark.slow
def test_it_waits_no_more_than_a_few_periods_longer_than_needed() -> None:
    late = []
    for joint, random in drawn(150, 6):
        # Five periods are the fewest that tell what is left.
        needed = max(SETTLE_S, joint.needed(), 5 / joint.frequency_hz)
        late.append((settle(joint, random)[0] - needed) * joint.frequency_hz)
    assert np.quantile(late, 0.95) < 3.0


@pytest.mark.parametrize("frequency_hz", [1.6, 2.4, 3.2, 4.8, 6.0])
def test_a_decay_at_any_ratio_to_the_drive_is_seen(frequency_hz: float) -> None:
    joint = Driven(3.2, 0.03, frequency_hz)
    assert joint.remaining(settle(joint, np.random.default_rng(0))[0]) < 2 * TOLERANCE


def test_it_says_how_much_is_left() -> None:
    joint = Driven(3.2, 0.03, 3.3)
    end, rule = settle(joint, None)
    assert rule.remaining == pytest.approx(joint.remaining(end), rel=0.15)


def test_a_well_damped_joint_waits_as_long_as_the_paper_does() -> None:
    rule = SettleRule(4.0, 3.0, TOLERANCE, MOST_S)
    time = np.arange(0.0, 10.0, 1 / RATE_HZ)
    rate = Driven(3.2, 0.25, 4.0).rate(time)
    turns = 0
    while not rule.is_settled:
        rule.feed(time[turns * 50 : turns * 50 + 50].tolist(), rate[turns * 50 : turns * 50 + 50].tolist())
        turns += 1
    assert turns == 12


def test_it_gives_up_at_its_longest_time() -> None:
    joint = Driven(3.2, 0.0005, 3.3)
    end, rule = settle(joint, None)
    assert (rule.is_out_of_time, end) == (True, pytest.approx(MOST_S, abs=1 / 3.3))


def test_noise_beyond_the_tolerance_is_not_taken_for_steady() -> None:
    _, rule = settle(Driven(3.2, 0.2, 3.3), np.random.default_rng(0), noise=2.0)
    assert rule.is_out_of_time


def test_scatter_without_a_decay_counts_whole_as_the_deviation_of_all_periods() -> None:
    sizes = 1 + 0.02 * np.random.default_rng(2).standard_normal(9)  # a draw in which no decay is significant
    rule, time = SettleRule(4.0, 0.0, TOLERANCE, MOST_S), np.arange(0.0, 0.25, 1 / RATE_HZ)
    for turn, size in enumerate(sizes):
        rule.feed((0.25 * turn + time).tolist(), (size * np.sin(8 * np.pi * time)).tolist())
    assert rule.remaining == pytest.approx(sizes.std() / sizes.mean(), rel=1e-9)


def test_a_period_without_samples_makes_it_begin_anew() -> None:
    joint, time = Driven(3.2, 0.2, 4.0), np.arange(0.0, 10.0, 1 / RATE_HZ)
    rule = SettleRule(4.0, 0.0, TOLERANCE, MOST_S)
    for turn in range(8):
        inside = slice(turn * 50, turn * 50 + 50)
        rule.feed(time[inside].tolist(), joint.rate(time)[inside].tolist())
    rule.feed([], [])
    assert not rule.is_settled


def test_the_rule_of_a_sweep_has_its_numbers() -> None:
    sweep = Sweep(frequency_hz=(3.0,), settle="adaptive", settle_s=0.5, settle_tolerance=0.05, settle_most_s=2.0)
    rule, time = SettleRule.of(sweep, 3.0), np.arange(0.0, 3.0, 1 / RATE_HZ)
    turns = 0
    while not rule.is_settled:
        inside = (time >= turns / 3.0) & (time < (turns + 1) / 3.0)
        rule.feed(time[inside].tolist(), Driven(3.2, 0.001, 3.0).rate(time)[inside].tolist())
        turns += 1
    assert turns == 6
