"""The trend of the current against the closed form of a linear joint on a lever with an armature."""

import numpy as np
import pytest

from sinew.analysis.sweep.energy import fit_line_trend, fit_swing_trend

HEAD, LEVER, ARMATURE = 0.005, 0.008, 0.009
STIFFNESS, DAMPING = 4.5, 0.02
CONSTANT = 1.9
FREQUENCY = np.arange(1.5, 6.01, 0.15)


def torque_per_swing(frequency_hz: np.ndarray) -> np.ndarray:
    """τ/φ of I φ̈ + d φ̇ + k φ = -I_l θ̈ and τ = I_l φ̈ + (I_l + J_a) θ̈, complex [N m/rad]."""
    omega = 2 * np.pi * frequency_hz
    inertia = HEAD + LEVER
    lever = (STIFFNESS - inertia * omega**2 + 1j * omega * DAMPING) / (LEVER * omega**2)
    return -(omega**2) * (LEVER + (LEVER + ARMATURE) * lever)


def current(frequency_hz: np.ndarray, swing: np.ndarray) -> np.ndarray:
    """Root mean square of the current of an ideal motor [A]."""
    return np.abs(torque_per_swing(frequency_hz)) * swing / CONSTANT / np.sqrt(2)


@pytest.fixture
def swing() -> np.ndarray:
    return np.random.default_rng(1003).uniform(0.05, 0.8, FREQUENCY.size)


def test_the_spring_is_the_torque_that_holds_a_slow_swing(swing: np.ndarray) -> None:
    trend = fit_swing_trend(FREQUENCY, current(FREQUENCY, swing), swing)
    static = (1 + ARMATURE / LEVER) * STIFFNESS / CONSTANT / np.sqrt(2)
    assert trend is not None
    assert np.sqrt(trend.spring) == pytest.approx(static, rel=1e-6)


def test_the_inertia_is_the_heads_and_the_armatures_as_the_lever_sees_it(swing: np.ndarray) -> None:
    trend = fit_swing_trend(FREQUENCY, current(FREQUENCY, swing), swing)
    whole = HEAD + ARMATURE / LEVER * (HEAD + LEVER)
    assert trend is not None
    assert np.sqrt(trend.inertia) == pytest.approx(whole * (2 * np.pi) ** 2 / CONSTANT / np.sqrt(2), rel=1e-6)


def test_what_they_save_is_twice_their_product_but_for_the_damping(swing: np.ndarray) -> None:
    trend = fit_swing_trend(FREQUENCY, current(FREQUENCY, swing), swing)
    assert trend is not None
    damper = (2 * np.pi * DAMPING * (1 + ARMATURE / LEVER) / CONSTANT) ** 2 / 2
    assert trend.saved == pytest.approx(2 * np.sqrt(trend.spring * trend.inertia) - damper, rel=1e-6)


def test_a_current_that_goes_with_no_swing_is_friction(swing: np.ndarray) -> None:
    with_friction = np.hypot(current(FREQUENCY, swing), 0.12)
    trend = fit_swing_trend(FREQUENCY, with_friction, swing)
    assert trend is not None
    assert np.sqrt(trend.friction) == pytest.approx(0.12, rel=1e-6)


def test_a_joint_without_resonance_saves_nothing(swing: np.ndarray) -> None:
    rigid = (0.3 + 0.05 * FREQUENCY**4) ** 0.5 * swing
    trend = fit_swing_trend(FREQUENCY, rigid, swing)
    assert trend is not None
    assert trend.saved == pytest.approx(0.0, abs=1e-9)


def test_the_line_leaves_the_resonance_out() -> None:
    straight = 0.1 + 0.15 * FREQUENCY
    near = (FREQUENCY > 2.5) & (FREQUENCY < 3.6)
    line = fit_line_trend(FREQUENCY, np.where(near, 5.0, straight), 3.0)
    assert line is not None
    assert line.current(3.0) == pytest.approx(0.55, rel=1e-9)
