"""Rigs drawn from a calibration: the covariance that was stored, ties kept, bounds kept, nothing from nothing."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import pearsonr
from tests.tables import rows

from sinew.identify.joint.calibration import Source, calibrated_together, with_intervals, with_ties
from sinew.measure.errors import SpecError
from sinew.plan.rig import Calibrated, RigSpec
from sinew.plan.toml import dump_rig, load_rig, parse_rig
from sinew.predict.band import carried_over, draw_rigs, spread_of

RIG = load_rig("paper")
RADIUS, BASE, TENSION = "tendons.head_radius", "tendons.base_radius", "tendons.first_contact_tension"
LEVER, HEAD = "inertia.lever", "inertia.head"
FOUND = (RADIUS, TENSION, LEVER)
STD, CORRELATION = np.array([2e-4, 0.1, 5e-6]), np.array([[1, -0.9, 0.2], [-0.9, 1, 0], [0.2, 0, 1]])
DRAWS = 4000


def calibrated(names: tuple[str, ...] = FOUND, covariance: NDArray[np.float64] | None = None) -> RigSpec:
    """Return the paper's rig as if it had been calibrated, with what follows from what was found."""
    own = np.outer(STD, STD) * CORRELATION if covariance is None else covariance
    tied = tuple(tie for name, tie in ((RADIUS, BASE), (LEVER, HEAD)) if name in names)
    whole = with_ties(RIG, names, tied, own)
    record = calibrated_together([*names, *tied], whole, [Source("monday.nc", "0123456789abcdef" * 4)], [4.0, 0.0])
    return RIG.model_copy(update={"calibration": record})


def value(rig: RigSpec, name: str) -> float:
    return dict(rig.parameters())[name].value


def test_a_calibration_comes_back_from_the_text_of_a_rig() -> None:
    rig = calibrated()
    assert parse_rig(dump_rig(rig)) == rig
    assert rig.calibration is not None
    assert (rig.calibration.recordings, rig.calibration.pretension_mm) == (("monday.nc (0123456789ab)",), (0.0, 4.0))


def test_a_rig_with_other_values_was_not_calibrated_to_them() -> None:
    assert calibrated().with_values({TENSION: 9.0}).calibration is None


def test_draws_have_the_covariance_that_was_stored() -> None:
    names, values = (draws := draw_rigs(calibrated(), DRAWS, 1000)).names, draws.values
    assert names[:3] == FOUND
    # The standard error of a standard deviation is 1/sqrt(2n), that of a correlation (1 - r²)/sqrt(n).
    assert values[:, :3].std(axis=0) == pytest.approx(STD, rel=4 / np.sqrt(2 * DRAWS))
    found = np.corrcoef(values[:, :3], rowvar=False)
    assert np.all(np.abs(found - CORRELATION) <= 4 * (1 - CORRELATION**2) / np.sqrt(DRAWS) + 1e-12)
    error = 4 * STD / np.sqrt(DRAWS)
    assert np.all(np.abs(values[:, :3].mean(axis=0) - [value(RIG, name) for name in FOUND]) < error)


def test_what_is_tied_stays_tied_in_every_draw() -> None:
    whole = value(RIG, HEAD) + value(RIG, LEVER)
    for rig in draw_rigs(calibrated(), 50, 1001).rigs:
        assert value(rig, HEAD) + value(rig, LEVER) == pytest.approx(whole, rel=1e-9)
        assert value(rig, BASE) == pytest.approx(value(rig, RADIUS), rel=1e-9)


def test_a_well_known_combination_of_two_vague_parameters_stays_well_known() -> None:
    names, std = (RADIUS, TENSION), np.array([2e-3, 0.8])
    almost = 1 - 1e-7
    covariance = np.outer(std, std) * np.array([[1, -almost], [-almost, 1]])
    values = draw_rigs(calibrated(names, covariance), DRAWS, 1002).values[:, :2]
    sure = values / std @ np.array([1, 1])
    # Var(a + b) = 2 (1 - 0.9999999); eight digits of the correlation change that by a twentieth.
    assert sure.std() == pytest.approx(np.sqrt(2e-7), rel=4 / np.sqrt(2 * DRAWS) + 0.03)


def test_draws_stay_inside_the_bounds_of_the_parameters() -> None:
    covariance = np.diag([0.01**2, 5.0**2])
    draws = draw_rigs(calibrated((RADIUS, TENSION), covariance), 400, 1003)
    table = dict(RIG.parameters())
    for name, column in zip(draws.names, draws.values.T, strict=True):
        low, high = table[name].bounds
        assert low <= column.min() <= column.max() <= high


def test_the_same_seed_gives_the_same_rigs_and_another_one_others() -> None:
    first, again, other = (draw_rigs(calibrated(), 5, seed).values for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_intervals_without_a_calibration_are_drawn_independently_and_that_is_said() -> None:
    rig = with_intervals(RIG, {TENSION: (8.4, 9.4), RADIUS: (0.0225, 0.0229)})
    draws = draw_rigs(rig, DRAWS, 1004)
    first, second = draws.values.T
    assert np.abs(pearsonr(first, second).statistic) < 4 / np.sqrt(DRAWS)
    half = {RADIUS: 2e-4, TENSION: 0.5}
    expected = [half[name] / 1.645 for name in draws.names]
    assert draws.values.std(axis=0) == pytest.approx(expected, rel=4 / np.sqrt(2 * DRAWS))
    assert any("independently" in sentence for sentence in draws.remarks)


def test_a_rig_without_intervals_is_refused() -> None:
    with pytest.raises(SpecError, match="the rig paper holds no intervals"):
        spread_of(RIG)


def test_correlations_that_contradict_each_other_are_refused() -> None:
    record = Calibrated(parameters=FOUND, std=(1e-4, 0.1, 1e-6), correlation=((1.0,), (0.9, 1.0), (0.9, -0.9, 1.0)))
    with pytest.raises(SpecError, match="contradict each other"):
        spread_of(RIG.model_copy(update={"calibration": record}))


@pytest.mark.parametrize(
    ("parameters", "std", "correlation", "sentence"),
    rows("""
        ["a", "a"] => [1, 1] => [[1], [0, 1]] => lists a name twice
        ["a", "b"] => [1] => [[1], [0, 1]] => std has 1 numbers
        ["a", "b"] => [1, 1] => [[1, 0], [0, 1]] => its lower triangle
        ["a"] => [1] => [[0.5]] => its diagonal
        ["a"] => [1] => [[1]] => names a, which is not in the rig
        ["silicone.length"] => [1] => [[1]] => silicone.length, which has origin paper
    """),
)
def test_a_table_that_cannot_be_meant_is_refused(parameters: str, std: str, correlation: str, sentence: str) -> None:
    table = f"parameters = {parameters}\nstd = {std}\ncorrelation = {correlation}"
    with pytest.raises(SpecError, match=sentence):
        parse_rig(f"{dump_rig(RIG)}\n[calibration]\n{table}\n")


def test_a_designed_joint_keeps_what_is_known_of_what_it_keeps() -> None:
    base = calibrated()
    designed = base.with_values({LEVER: 0.007, HEAD: 0.0055})
    known, changed = carried_over(base, designed)
    assert set(changed) == {LEVER, HEAD}
    assert known.calibration is not None
    assert known.calibration.parameters == (RADIUS, TENSION, BASE)
    assert known.calibration.correlation[1][0] == pytest.approx(-0.9)
    assert {value(rig, LEVER) for rig in draw_rigs(known, 5, 0).rigs} == {0.007}
