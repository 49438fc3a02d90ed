"""The predicted response of the joint against time integration of the full twin."""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from sinew.plan.plan import Group
from sinew.plan.toml import load_rig
from sinew.predict.joint import RESOLUTION, joint_problem
from sinew.solve.branch import Prediction
from sinew.solve.curves import predict
from sinew.solve.march import Track
from sinew.twin.simulate import lane_parameters, simulate_tracks

pytestmark = pytest.mark.slow
BAND_HZ, SAMPLE_HZ, SEED = (1.0, 6.0), 400.0, 20
CURVES, POINTS = 12, 5
HARMONICS = np.arange(1, 20)


class Case(NamedTuple):
    """A predicted steady motion and the track of the twin at the same pretension, amplitude and frequency."""

    group: Group
    amplitude: float
    phase: float
    track: Track


@cache
def lanes() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return pretensions [mm] and amplitudes of the command [deg]."""
    rng = np.random.default_rng(SEED)
    return rng.uniform(0, 12, CURVES), rng.uniform(3, 25, CURVES)


@cache
def prediction() -> Prediction:
    return predict(joint_problem(load_rig("paper"), *lanes(), BAND_HZ), BAND_HZ, RESOLUTION)


@cache
def cases() -> list[Case]:
    rng = np.random.default_rng(SEED + 1)
    groups, expected = [], []
    for pretension, amplitude, branch in zip(*lanes(), prediction().branches, strict=True):
        for i in rng.choice(np.flatnonzero(branch.stable), POINTS, replace=False):
            groups.append(
                Group("steady", float(pretension), float(branch.frequency_hz[i]), float(amplitude), 0, 14.0, 2.0)
            )
            expected.append((float(branch.amplitude[i]), float(branch.phase[i])))
    tracks = simulate_tracks(lane_parameters(groups, load_rig("paper")), groups, SAMPLE_HZ)
    return [Case(g, *e, t) for g, e, t in zip(groups, expected, tracks, strict=True)]


def waves(values: NDArray[np.float64], frequency_hz: float) -> NDArray[np.complex128]:
    """Return the complex amplitudes of `HARMONICS` over the last four periods of samples, by least squares."""
    count = round(4 * SAMPLE_HZ / frequency_hz)
    time_s = np.arange(values.size)[-count:] / SAMPLE_HZ
    turns = np.outer(time_s, 2 * np.pi * frequency_hz * HARMONICS)
    basis = np.concatenate([np.ones((count, 1)), np.cos(turns), np.sin(turns)], axis=1)
    found = np.linalg.lstsq(basis, values[-count:], rcond=None)[0][1:]
    return found[: HARMONICS.size] - 1j * found[HARMONICS.size :]


def half_range(c: NDArray[np.complex128]) -> float:
    turn = np.exp(1j * np.outer(np.linspace(0, 2 * np.pi, 2000), HARMONICS))
    return float(np.ptp((turn @ c).real) / 2)


def test_every_curve_goes_through_the_band() -> None:
    assert [branch.message for branch in prediction().branches if not branch.complete] == []


def test_amplitudes_are_those_of_the_time_integration_within_half_a_percent() -> None:
    found = np.array([half_range(waves(case.track.torsion, case.group.frequency_hz)) for case in cases()])
    assert np.array([case.amplitude for case in cases()]) == pytest.approx(found, rel=5e-3)


def test_phases_are_those_of_the_time_integration_within_half_a_degree() -> None:
    for case in cases():
        torsion, lever = (waves(x, case.group.frequency_hz)[0] for x in (case.track.torsion, case.track.lever))
        apart = np.angle(np.exp(1j * (case.phase - np.angle(lever / torsion))))
        assert abs(np.degrees(apart)) < 0.5


def test_the_error_estimate_covers_what_the_time_integration_finds() -> None:
    largest = {float(p): float(b.amplitude.max()) for p, b in zip(lanes()[0], prediction().branches, strict=True)}
    for case in cases():
        found = half_range(waves(case.track.torsion, case.group.frequency_hz))
        assert abs(case.amplitude - found) < prediction().error_estimate * largest[case.group.pretension_mm]
