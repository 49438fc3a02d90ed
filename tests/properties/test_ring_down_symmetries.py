"""What a ring-down must not care about: unit, sign, offset and origin of time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.analysis.decay.ring_down import analyse_ring_down

T = np.arange(300) / 100
NOISE = 0.3 * np.random.default_rng(2).standard_normal(T.size)
factors = st.floats(1e-6, 1e6)
offsets = st.floats(-100.0, 100.0)
cases = settings(max_examples=25, deadline=None)


def decay(damping: float, phase: float = 0.3) -> np.ndarray:
    omega = 6 * np.pi
    swing = np.cos(omega * np.sqrt(1 - damping**2) * T + phase)
    return 30 * np.exp(-damping * omega * T) * swing + NOISE


@cases
@given(factor=factors)
def test_the_unit_of_the_response_leaves_the_damping_and_scales_its_amplitudes(factor: float) -> None:
    base, other = (analyse_ring_down(T, k * decay(0.08), unit="m") for k in (1.0, factor))
    assert other.damping_ratio.value == pytest.approx(base.damping_ratio.value, rel=1e-5)
    assert other.dependence.amplitude == pytest.approx(factor * base.dependence.amplitude, rel=1e-5)


@cases
@given(offset=offsets)
def test_the_origin_of_time_moves_the_start_with_it(offset: float) -> None:
    base, other = (analyse_ring_down(T + c, decay(0.08)) for c in (0.0, offset))
    assert other.start_s - offset == pytest.approx(base.start_s, abs=1e-6)


@cases
@given(damping=st.floats(0.02, 0.25), phase=st.floats(0.0, 2 * np.pi))
def test_the_sign_of_the_response_leaves_the_damping(damping: float, phase: float) -> None:
    base, other = (analyse_ring_down(T, sign * decay(damping, phase)) for sign in (1.0, -1.0))
    assert other.damping_ratio.value == pytest.approx(base.damping_ratio.value, rel=1e-4)
