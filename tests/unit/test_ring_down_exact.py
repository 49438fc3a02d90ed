"""A decay that was computed has no noise, so nothing is tested against it."""

import re

import numpy as np
import pandas as pd
import pytest

import sinew as sn
from sinew.analysis.analysed import Analysed
from sinew.analysis.decay.ring_down import analyse_ring_down

T = np.arange(0, 4, 0.01)
FIRST_DEG, RATE, HZ = 20.0, 1.2, 3.0
DECAY = FIRST_DEG * np.exp(-RATE * T) * np.cos(2 * np.pi * HZ * T)


@pytest.fixture(scope="module")
def exact() -> Analysed:
    return sn.analyse(sn.read(pd.DataFrame({"t": T, "phi": DECAY}), time="t", response="phi:deg"))


def test_round_off_is_no_uncertainty_and_no_drift(exact: Analysed) -> None:
    assert not re.search(r"e-1\d", str(exact))
    assert "±" not in str(exact).replace("value ± std", "")


def test_an_exact_decay_is_an_exponential_without_a_test_of_it(exact: Analysed) -> None:
    assert exact.to_dict()["exponential"]
    assert "round-off" in exact.to_dict()["reason"]
    assert "p =" not in exact.to_dict()["reason"]


def test_an_exact_decay_has_no_misfit(exact: Analysed) -> None:
    decay = exact.to_dict()["decay_rate_per_s"]
    assert exact.to_dict()["misfit"] == ""
    assert decay["value"] == pytest.approx(RATE, rel=1e-9)
    assert decay["std"] < 1e-9 * RATE


@pytest.mark.parametrize("bend", [0.0, 2e-4, 4e-4, 6e-4, 8e-4])
def test_no_change_is_explained_by_noise_that_the_test_refutes(bend: float) -> None:
    noise = np.random.default_rng(3).normal(0, 0.001, T.size)
    x = np.exp(-RATE * T - bend * T**2) * np.cos(2 * np.pi * HZ * T + 2 * bend * T**2) + noise
    shape = analyse_ring_down(T, x).shape
    assert ("than the residual of the fit explains" in shape.reason) == (shape.p_value >= 0.01)
