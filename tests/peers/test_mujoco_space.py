"""The rigid head with its lever on tendons, in space, against MuJoCo."""

import jax.numpy as jnp
import numpy as np
import pytest
from tests.experiments import mujoco_space
from tests.experiments.mujoco_space import Motion

from sinew.solve.programs import configure

pytest.importorskip("mujoco", reason="MuJoCo is not installed")
configure()

POSES = [
    np.zeros(6),
    np.array([0.6, 0.0, 0.0, -0.05, 0.0, 0.0]),
    np.array([-0.4, 0.5, -0.3, -0.04, 0.03, -0.02]),
]
"""Coordinates of a rod of constant strain: twist, two bends, stretch, two shears."""


@pytest.mark.parametrize("flat", POSES)
def test_spans_of_a_head_in_space_are_mujocos(flat: np.ndarray) -> None:
    space = mujoco_space.held_head()
    _, data = mujoco_space.mujoco_state(flat, Motion(np.zeros(3), np.zeros(3), 0.0, 0.0), space)
    spans, _ = mujoco_space.felt(jnp.asarray(flat.reshape(6, 1)), space)
    assert np.asarray(spans) == pytest.approx(data.ten_length, rel=1e-9)


@pytest.mark.slow
def test_a_head_with_a_turning_lever_accelerates_as_mujocos() -> None:
    space, flat = mujoco_space.held_head(), POSES[2]
    speed = np.array([3.0, -4.0, 2.0, 0.3, -0.2, 0.4])
    motion, rates = mujoco_space.own_accelerations(flat, speed, 0.7, -8.0, space)
    _, data = mujoco_space.mujoco_state(flat, motion, space)
    assert rates == pytest.approx(data.qacc, rel=1e-7, abs=1e-7 * np.max(np.abs(rates)))


@pytest.mark.slow
def test_a_head_on_taut_tendons_swings_at_mujocos_six_frequencies() -> None:
    space = mujoco_space.held_head()
    flat = mujoco_space.resting(space)
    ours = mujoco_space.own_frequencies(flat, space)
    assert ours == pytest.approx(mujoco_space.mujoco_frequencies(flat, space), rel=1e-5)
