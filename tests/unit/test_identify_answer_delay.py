"""Which delay: asked of responses that are recorded so much later than the budget says."""

import numpy as np
import pytest
import xarray as xr
from tests.unit.identify_campaigns import RIG

from sinew.paper.sweeps import answer_delay
from sinew.plan.plan import Plan, Pretension, RingDown
from sinew.twin.simulate import simulate


def response(delay_s: float, viscous: float = 0.0, softening: float = 0.15, seed: int = 1) -> xr.Dataset:
    """Return results of a joint with a loss factor, viscous damping and a stiffness that falls with amplitude.

    The torsion is recorded so much later than the budget says. Solved by iteration on the amplitude.
    """
    frequency = np.concatenate([np.arange(1.6, 3.0, 0.2), np.arange(3.0, 4.6, 0.1), np.arange(4.8, 6.1, 0.4)])
    rng = np.random.default_rng(seed)
    shape = (3, frequency.size, 3)
    gain, lag, amplitude = np.empty(shape), np.empty(shape), np.empty(shape)
    for p in range(3):
        natural = 2 * np.pi * (3.2 + 0.4 * p)
        omega, drive = 2 * np.pi * frequency, np.radians(12.0)
        swing = np.zeros(frequency.size)
        for _ in range(400):
            stiffness = natural**2 * (1 - softening * swing)
            loss = natural**2 * (0.08 + 0.1 * swing) + viscous * omega * natural
            found = 0.6 * omega**2 / (stiffness + 1j * loss - omega**2)
            swing = 0.9 * swing + 0.1 * np.abs(found) * drive
        late = found * np.exp(-1j * omega * delay_s)
        for r in range(3):
            noisy = late * (1 + 0.002 * (rng.standard_normal(omega.size) + 1j * rng.standard_normal(omega.size)))
            gain[p, :, r], lag[p, :, r] = np.abs(noisy), np.mod(-np.angle(noisy) + 0.5 * np.pi, 2 * np.pi) - 0.5 * np.pi
            amplitude[p, :, r] = np.abs(noisy) * drive
    dims = ("pretension_mm", "frequency_hz", "repeat")
    return xr.Dataset(
        {"gain_measured_drive": (dims, gain), "phase_lag_rad": (dims, lag), "amplitude_rad": (dims, amplitude)},
        {"pretension_mm": ("pretension_mm", [0.0, 6.0, 12.0]), "frequency_hz": ("frequency_hz", frequency)},
    )


@pytest.fixture(scope="module")
def resting() -> xr.Dataset:
    """A recording at 200 Hz, for the delay budget."""
    ring_down = RingDown(frequency_hz=(3.0, 3.0), repeats=1)
    return simulate(Plan(name="rest", pretension=Pretension(pretension_mm=(0.0,)), ring_down=ring_down), RIG)


@pytest.mark.slow
@pytest.mark.parametrize("viscous", [0.0, 0.05])
@pytest.mark.parametrize("delay_s", [0.0, 0.002, -0.003])
def test_an_extra_delay_is_found_whatever_the_law_of_the_damping(
    delay_s: float, viscous: float, resting: xr.Dataset
) -> None:
    found = answer_delay(response(delay_s, viscous), resting, RIG).numbers["extra_delay_s"]
    assert found.value == pytest.approx(delay_s, abs=0.15e-3)


@pytest.mark.slow
def test_the_interval_of_the_delay_covers_it(resting: xr.Dataset) -> None:
    hits = 0
    for seed in range(20):
        found = answer_delay(response(0.001, 0.02, seed=seed), resting, RIG).numbers["extra_delay_s"]
        hits += found.low <= 0.001 <= found.high
    assert hits >= 15


def test_a_delay_within_the_budgets_uncertainty_is_explained_and_one_beyond_is_named(resting: xr.Dataset) -> None:
    assert answer_delay(response(0.0), resting, RIG).verdict == "the written budget"
    beyond = answer_delay(response(0.004), resting, RIG)
    assert beyond.verdict == "an extra delay"
    assert "beyond the written budget" in beyond.sentences[0]
