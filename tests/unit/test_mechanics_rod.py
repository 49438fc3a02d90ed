"""The rod with six strains: poses against an integrator of ordinary equations, energies against closed forms."""

import jax
import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.integrate import solve_ivp

from sinew.mechanics.rod import move_rod, rod_energy, rod_poses
from sinew.plan.toml import load_rig
from sinew.solve.programs import configure
from sinew.twin.parameters import space_from_rig

configure()
ROD = space_from_rig(load_rig("paper")).rod
ENERGY, POSES = jax.jit(rod_energy), jax.jit(rod_poses)
LENGTH = float(ROD.joint.length)
BENT = np.array(
    [[0.5, 0.1, -0.1], [0.6, -0.3, 0.1], [-0.4, 0.2, 0.2], [-0.1, 0.02, 0.01], [0.05, 0.0, 0.02], [-0.03, 0.04, 0.0]]
)


def integrated(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation and position of the rod's end by an adaptive integrator: R' = R κ×, r' = R ν."""

    def rate(share: float, y: np.ndarray) -> np.ndarray:
        strains = q @ legendre.legvander(np.array([2 * share - 1]), q.shape[1] - 1)[0] + np.array([0, 0, 0, 1, 0, 0])
        turned = y[:9].reshape(3, 3)
        return np.concatenate([(turned @ np.cross(strains[:3], np.eye(3)).T).ravel(), LENGTH * turned @ strains[3:]])

    start = np.concatenate([np.eye(3).ravel(), np.zeros(3)])
    end = solve_ivp(rate, (0, 1), start, rtol=1e-11, atol=1e-12).y[:, -1]
    return end[:9].reshape(3, 3), end[9:]


def test_the_pose_of_a_bent_rods_end_is_that_of_an_integrator() -> None:
    turned, moved = (np.asarray(part)[-1] for part in POSES(BENT, ROD))
    expected_turn, expected_place = integrated(BENT)
    # 1e-5: what seven ways of fourth order leave of a bend by more than one radian
    assert turned == pytest.approx(expected_turn, abs=1e-5)
    assert moved == pytest.approx(expected_place, abs=1e-5 * LENGTH)


def test_sections_of_a_moving_rod_have_velocity_and_acceleration_of_their_poses() -> None:
    speed, h = 3.0 * BENT[::-1], 1e-4
    before, now, after = ([np.asarray(x) for x in POSES(BENT + t * speed, ROD)] for t in (-h, 0.0, h))
    _, rates = jax.jit(move_rod)(BENT, speed, ROD)
    ends = np.arange(now[1].shape[0])
    turning = (after[0] - before[0]) / (2 * h) @ now[0].transpose(0, 2, 1)  # ω×
    assert rates.spin == pytest.approx(np.stack([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]], 1), abs=1e-5)
    assert rates.velocity(now[1], ends) == pytest.approx((after[1] - before[1]) / (2 * h), abs=1e-6)
    gaining = (after[1] - 2 * now[1] + before[1]) / h**2
    assert rates.acceleration(now[1], ends) == pytest.approx(gaining, abs=1e-4 * np.abs(gaining).max())


def test_a_constant_bend_is_an_arc() -> None:
    q = np.zeros((6, 3))
    q[2, 0] = 1.0  # one radian about z
    place = np.asarray(POSES(q, ROD)[1])[-1]
    assert place == pytest.approx(LENGTH * np.array([np.sin(1.0), 1 - np.cos(1.0), 0.0]), abs=1e-12)


def test_the_energy_of_a_small_bend_is_that_of_a_beam() -> None:
    q = np.zeros((6, 3))
    q[1, 0] = 1e-3
    e_i = 3 * float(ROD.bending[0])  # E = 3 G
    assert float(ENERGY(q, ROD)) == pytest.approx(0.5 * e_i * 1e-6 / LENGTH, rel=1e-6)


def test_the_energy_of_twist_and_compression_is_rivlins() -> None:
    q = np.zeros((6, 3))
    q[0, 0], q[3, 0] = 0.7, -0.12
    p, stretch = ROD.joint, 0.88
    axial = float(p.axial_rigidity) * LENGTH * (stretch**2 + 2 / stretch - 3)
    expected = 0.5 * (axial + float(p.torsional_rigidity) * 0.7**2 / (LENGTH * stretch))
    assert float(ENERGY(q, ROD)) == pytest.approx(expected, rel=1e-12)
