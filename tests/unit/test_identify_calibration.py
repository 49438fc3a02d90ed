"""A rig takes over what recordings determine and nothing else; a sampled posterior is the one that it should be."""

import importlib.util
import json
import math
import re
from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import truncnorm

from sinew.identify.joint import calibration
from sinew.identify.joint.calibration import Source, calibrate, calibrated_rig, other_geometry, with_intervals
from sinew.measure.errors import RecordingError, SpecError
from sinew.measure.estimate import Estimate
from sinew.paper.numbers import (
    FREE,
    TARGETS,
    Draws,
    Effort,
    PaperPosterior,
    Scale,
    is_met,
    misfit,
    rest_stiffness,
    rig_with,
    sample_posterior,
    scale_of,
    summarise_draws,
)
from sinew.plan.parameter import Parameter
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_rig, load_rig, parse_rig

Vector = NDArray[np.float64]
RIG = load_rig("paper")
MONDAY = Source("monday.nc", "0123456789abcdef" * 4)
TENSION = "tendons.first_contact_tension"
RADIUS = "tendons.head_radius"


def recording_of(rig: RigSpec, **attrs: str) -> xr.Dataset:
    return xr.Dataset(attrs={"rig": dump_rig(rig), "source": "twin", **attrs})


def found(rig: RigSpec, name: str) -> Parameter:
    return dict(rig.parameters())[name]


# The interval of a parameter


def test_an_interval_comes_back_from_the_text_of_a_rig_in_the_units_of_the_file() -> None:
    rig = with_intervals(RIG, {RADIUS: (0.0225, 0.0229), TENSION: (8.1, 9.6)})
    text = dump_rig(rig)
    assert "bounds = [15, 45], interval90 = [22.5, 22.9]" in text
    assert parse_rig(text) == rig
    assert found(parse_rig(text), RADIUS).interval90 == (0.0225, 0.0229)


def test_a_value_that_was_changed_by_hand_no_longer_fits_its_interval() -> None:
    text = dump_rig(with_intervals(RIG, {TENSION: (8.1, 9.6)}))
    with pytest.raises(SpecError, match=r"12 N .*outside .*\[8\.1, 9\.6\].*interval90"):
        parse_rig(text.replace("value = 8.868", "value = 12"))


def test_a_rig_with_other_values_has_no_interval_left() -> None:
    moved = with_intervals(RIG, {TENSION: (8.1, 9.6)}).with_values({RADIUS: 0.025})
    assert found(moved, TENSION).interval90 is None


# A rig from estimates


def test_a_found_parameter_has_value_interval_origin_and_source_and_all_others_are_as_they_were() -> None:
    rig, followed = calibrated_rig(RIG, RIG, {TENSION: Estimate(9.1234567, 0.3, 8.63, 9.61)}, [MONDAY], "mine")
    one = found(rig, TENSION)
    assert (one.value, one.interval90, one.origin) == (9.12346, (8.63, 9.61), "calibrated")
    assert one.note == "fitted to monday.nc (0123456789ab)"
    assert (rig.name, followed) == ("mine", ())
    assert parse_rig(dump_rig(rig)) == rig
    assert {name for name, one in rig.parameters() if one != found(RIG, name)} == {TENSION}


def test_a_second_calibration_keeps_the_intervals_of_the_first() -> None:
    first, _ = calibrated_rig(RIG, RIG, {TENSION: Estimate(9.1, 0.3, 8.6, 9.6)}, [MONDAY], "mine")
    second, _ = calibrated_rig(first, first, {RADIUS: Estimate(0.0227, 1e-4, 0.0225, 0.0229)}, [MONDAY], "mine")
    assert found(second, TENSION).interval90 == (8.6, 9.6)


def test_an_interval_ends_at_the_bounds() -> None:
    rig, _ = calibrated_rig(RIG, RIG, {"drive.friction": Estimate(0.01, 0.02, -0.02, 0.04)}, [MONDAY], "mine")
    assert rig.drive.friction.interval90 == (0.0, 0.04)


def test_a_parameter_that_is_tied_to_another_moves_along_and_says_so() -> None:
    fitted = RIG.with_values({RADIUS: 0.025, "tendons.base_radius": 0.025})
    rig, followed = calibrated_rig(RIG, fitted, {RADIUS: Estimate(0.025, 1e-4, 0.0248, 0.0252)}, [MONDAY], "mine")
    assert followed == ("tendons.base_radius",)
    assert (rig.tendons.base_radius.value, rig.tendons.base_radius.interval90) == (0.025, None)
    assert rig.tendons.base_radius.note.endswith("monday.nc (0123456789ab)")


def test_a_value_outside_its_bounds_is_refused_with_both() -> None:
    with pytest.raises(SpecError, match=r"first_contact_tension .*55 N.*\[2, 30\]"):
        calibrated_rig(RIG, RIG, {TENSION: Estimate(55.0, 1, 53, 57)}, [MONDAY], "mine")


def test_of_many_recordings_three_are_named_and_the_rest_counted() -> None:
    sources = [Source(f"{i}.nc", f"{i}" * 64) for i in range(5)]
    rig, _ = calibrated_rig(RIG, RIG, {TENSION: Estimate(9.1, 0.3, 8.6, 9.6)}, sources, "mine")
    assert rig.tendons.first_contact_tension.note.endswith("2.nc (222222222222) and 2 more")


# From recordings

Fits = Callable[..., Any]


def stand_in_fit(asked: list[list[str]], repeats: int = 1, **estimates: Estimate) -> Fits:
    """Return a joint fit with these estimates, by the last word of the name; it notes what was free each time."""

    def fit(recordings: Sequence[xr.Dataset], rig: RigSpec, *, free: Sequence[str], progress: object) -> Any:
        asked.append(list(free))
        mine = {name: estimates[name.split(".")[1]] for name in free}
        fitted = rig.with_values({name: one.value for name, one in mine.items()})
        spread = SimpleNamespace(matrix=np.diag([one.std**2 for one in mine.values()]))
        more = SimpleNamespace(covariance=spread, pretension_mm=(0.0, 4.0), converged=True, message="", rmse={})
        settings = {"repeats": repeats, "repeatability": (1e-4, 0.03) if repeats == 1 else (2e-4, 0.05)}
        return SimpleNamespace(parameters=mine, fitted_rig=fitted, unidentifiable=(), **settings, **vars(more))

    return fit


SURE = Estimate(9.1, 0.3, 8.6, 9.6)
VAGUE = Estimate(0.03, 0.1, -0.1, 0.2)


def test_what_the_recordings_do_not_determine_is_held_and_the_rest_fitted_beside_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[list[str]] = []
    monkeypatch.setattr(calibration, "fit_joint", stand_in_fit(asked, first_contact_tension=SURE, head_radius=VAGUE))
    done = calibrate(RIG, recording_of(RIG), name="mine", free=[TENSION, RADIUS])
    assert asked == [[TENSION, RADIUS], [TENSION]]
    assert (list(done.found), done.undetermined) == ([TENSION], (RADIUS,))
    assert found(done.rig, RADIUS) == found(RIG, RADIUS)
    assert any("not determined" in sentence and RADIUS in sentence for sentence in done.remarks)


@pytest.mark.parametrize(
    ("repeats", "sentence"),
    [
        (1, r"set once.* the rig's repeatability \(pretension 0\.1 mm, guide friction 3 %\); record repeats"),
        (3, r"scatter over 3 repeats: pretension 0\.2 mm, guide friction 5 % \(the rig says pretension 0\.1 mm"),
    ],
)
def test_it_is_said_where_the_scatter_between_settings_is_from(
    repeats: int, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibration, "fit_joint", stand_in_fit([], repeats, first_contact_tension=SURE))
    done = calibrate(RIG, recording_of(RIG), name="mine", free=[TENSION])
    assert [re.search(sentence, one) is not None for one in done.remarks] == [True]


@pytest.mark.parametrize("vague", [VAGUE, Estimate(0.03, math.nan, math.nan, math.nan)])
def test_recordings_that_determine_nothing_are_refused(monkeypatch: pytest.MonkeyPatch, vague: Estimate) -> None:
    monkeypatch.setattr(calibration, "fit_joint", stand_in_fit([], head_radius=vague))
    with pytest.raises(RecordingError, match=r"determine none of tendons\.head_radius"):
        calibrate(RIG, recording_of(RIG), name="mine", free=[RADIUS])


def test_an_unknown_parameter_is_refused_before_anything_is_fitted() -> None:
    with pytest.raises(SpecError, match=r"'tendons\.radius'.*silicone\.length, "):
        calibrate(RIG, recording_of(RIG), name="mine", free=["tendons.radius"])


def test_a_recording_of_the_same_rig_needs_no_remark() -> None:
    hidden = RIG.with_values({TENSION: 12.0, RADIUS: 0.025, "silicone.diameter": 0.06})
    assert other_geometry(RIG, recording_of(hidden), "monday.nc") == []


def test_a_recording_of_a_longer_joint_is_noticed() -> None:
    other = RIG.with_values({"silicone.length": 0.1})
    (sentence,) = other_geometry(RIG, recording_of(other), "monday.nc")
    assert [
        fact for fact in ("monday.nc", "another rig", "silicone.length 0.1 ", " 0.095") if fact not in sentence
    ] == []


def test_a_recording_with_other_tendons_is_refused() -> None:
    data = RIG.model_dump(exclude={"wiring"})
    data["tendons"]["count"] = 3
    with pytest.raises(SpecError, match="recorded with 3 tendons, the rig has 4"):
        other_geometry(RIG, recording_of(RigSpec.model_validate(data)), "monday.nc")


def test_an_imported_table_is_refused() -> None:
    with pytest.raises(SpecError, match="was imported from a table"):
        other_geometry(RIG, recording_of(RIG, source="import"), "monday.nc")


def test_a_recording_without_a_rig_is_taken_and_said_to_be_so() -> None:
    assert "does not say with which rig" in other_geometry(RIG, xr.Dataset(attrs={"rig": ""}), "monday.nc")[0]


# The paper's numbers


def test_a_number_at_the_end_of_its_tolerance_is_met_and_three_standard_deviations_off() -> None:
    observed = np.array([target.value + target.within * (1 - 1e-9) for target in TARGETS])
    assert misfit(observed) == pytest.approx(np.full(len(TARGETS), 3.0))
    assert bool(is_met(observed))
    assert not is_met(observed + 1e-6)


def test_the_radii_stay_equal_and_the_inertia_is_that_of_equation_4() -> None:
    values = scale_of(RIG).likely
    rig = rig_with(RIG, values)
    assert rig.tendons.base_radius.value == rig.tendons.head_radius.value == values[0]
    assert rig.inertia.head.value + rig.inertia.lever.value == pytest.approx(12.74e-3, rel=1e-12)


# The sampler


FAR = np.full(2, 8.0)
SMALL = Effort(first=60, rounds=1, points=60, chains=4, draws=400)
needs_numpyro = pytest.mark.skipif(importlib.util.find_spec("numpyro") is None, reason="NumPyro is not installed")


def moments(draws: Draws) -> tuple[Vector, Vector]:
    return draws.flat.mean(axis=0), np.cov(draws.flat, rowvar=False)


@pytest.mark.slow
@needs_numpyro
def test_a_linear_model_gives_the_normal_posterior_of_the_textbook() -> None:
    """Prior N(0, 1), misfit A x - b: covariance (AᵀA + 1)⁻¹, mean that times Aᵀb."""
    slope, offset = np.array([[3.0, 2.9], [0.2, -0.3]]), np.array([2.0, 0.1])
    covariance = np.linalg.inv(slope.T @ slope + np.eye(2))
    draws = sample_posterior(lambda x: x @ slope.T - offset, np.zeros(2), -FAR, FAR, seed=11, effort=SMALL)
    mean, spread = moments(draws)
    error = np.sqrt(np.diagonal(covariance) / draws.ess)
    assert np.all(np.abs(mean - covariance @ slope.T @ offset) < 4 * error)
    assert np.diagonal(spread) == pytest.approx(np.diagonal(covariance), rel=0.25)
    assert draws.acceptance > 0.95  # a cubic polynomial holds a straight line exactly
    assert draws.rhat.max() < 1.05


@pytest.mark.slow
@needs_numpyro
def test_a_model_that_says_nothing_gives_back_the_prior_cut_off_at_the_bounds() -> None:
    low, high = np.array([-0.5, -8.0]), np.array([8.0, 1.0])
    draws = sample_posterior(lambda x: np.zeros((len(x), 1)), np.zeros(2), low, high, seed=12, effort=SMALL)
    assert draws.flat.min(axis=0)[0] >= -0.5
    assert draws.flat.max(axis=0)[1] <= 1.0
    for column, prior in zip(draws.flat.T, (truncnorm(-0.5, 8), truncnorm(-8, 1)), strict=True):
        assert np.quantile(column, [0.05, 0.5, 0.95]) == pytest.approx(prior.ppf([0.05, 0.5, 0.95]), abs=0.15)


@pytest.mark.slow
@needs_numpyro
def test_a_model_that_no_polynomial_follows_is_still_sampled_as_it_is() -> None:
    """Misfit 3 |x₁| + x₂ - 1 has its kink where the posterior is; the answer is from a sum over a fine grid."""

    def kinked(x: Vector) -> Vector:
        return np.asarray(3 * np.abs(x[:, :1]) + x[:, 1:] - 1)

    axis = np.linspace(-6, 6, 1201)
    grid = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    weight = np.exp(-0.5 * (kinked(grid)[:, 0] ** 2 + (grid**2).sum(axis=1)))
    weight /= weight.sum()
    draws = sample_posterior(kinked, np.array([0.3, 0.1]), -FAR, FAR, seed=13, effort=SMALL)
    assert draws.acceptance < 0.95  # the surrogate is wrong, and the model says so
    size = np.abs(draws.flat[:, 0])
    expected = float(weight @ np.abs(grid[:, 0]))
    spread = math.sqrt(float(weight @ (np.abs(grid[:, 0]) - expected) ** 2))
    assert size.mean() == pytest.approx(expected, abs=4 * spread / math.sqrt(draws.ess.min()))
    assert size.std() == pytest.approx(spread, rel=0.25)


@pytest.mark.slow
@needs_numpyro
def test_the_same_seed_gives_the_same_draws() -> None:
    def once() -> Vector:
        tiny = Effort(first=30, rounds=0, points=0, chains=2, draws=20)
        return sample_posterior(lambda x: 2 * x, np.zeros(1), -FAR[:1], FAR[:1], seed=3, effort=tiny).values

    assert np.array_equal(once(), once())


def test_without_numpyro_a_posterior_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _name: None)
    with pytest.raises(SpecError, match=r"needs NumPyro, .*\[posterior\]"):
        sample_posterior(lambda x: x, np.zeros(1), -FAR[:1], FAR[:1], seed=1)


# What a posterior determines


def described(logs: Vector) -> PaperPosterior:
    """Return the summary of draws whose logarithms are given, about 1 with a prior width of 0.5."""
    names = ["a.x", "a.y", "a.z"][: logs.shape[1]]
    k = len(names)
    scale = Scale(np.ones(k), np.full(k, 0.5), np.full(k, 0.01), np.full(k, 5.0))
    values = (np.exp(logs) - 1) / 0.5
    draws = Draws(values[None], 0.5, np.ones(k), np.full(k, 100.0), 10)
    twice = [[{"twice_1": 2 * x} for x in column] for column in (np.linspace(0, 1, 101), np.exp(logs[:, 0]))]
    return summarise_draws(draws, scale, dict.fromkeys(names, "1"), twice, seed=1)


def test_draws_of_the_prior_determine_nothing() -> None:
    rng = np.random.default_rng(22)
    values = truncnorm((0.01 - 1) / 0.5, (5 - 1) / 0.5, 1, 0.5).rvs((20000, 3), random_state=rng)
    said = described(np.log(values))
    assert [one.ratio for one in said.parameters.values()] == pytest.approx([1, 1, 1], abs=0.03)
    assert said.sentences()[0] == "narrowed to less than half: nothing"


def test_the_parts_of_the_stiffness_at_rest_are_those_of_the_formulas() -> None:
    """At first contact the tension is that of the rig: 4 T r²/ℓ and 4 μ T/φ_s; the silicone is shorter by under 2 %."""
    parts, tendons = rest_stiffness(RIG, (0.0, 12.0)), RIG.tendons
    tension, radius = tendons.first_contact_tension.value, tendons.head_radius.value
    assert parts["tension_n[0 mm]"] == pytest.approx(tension, rel=1e-9)
    assert parts["tendon_stiffness_n_m_rad[0 mm]"] == pytest.approx(4 * tension * radius**2 / 0.095, rel=0.02)
    guide = 4 * tendons.guide_friction.value * tension
    assert parts["guide_torque_n_m[0 mm]"] == pytest.approx(guide, rel=1e-9)
    assert parts["guide_stiffness_n_m_rad[0 mm]"] == pytest.approx(guide / tendons.presliding_angle.value, rel=1e-9)
    silicone = parts["joint_stiffness_n_m_rad[0 mm]"] - guide / tendons.presliding_angle.value
    assert silicone - parts["tendon_stiffness_n_m_rad[0 mm]"] == pytest.approx(0.29 / 0.095, rel=0.02)
    assert parts["tension_n[12 mm]"] > 3 * tension


# What ships


def shipped_posterior() -> dict[str, Any]:
    text = files("sinew").joinpath("rigs", "paper-posterior.json").read_text(encoding="utf-8")
    return dict(json.loads(text))


def test_the_posterior_that_ships_is_that_of_the_shipped_rig_and_well_sampled() -> None:
    rows = shipped_posterior()["parameters"]
    assert list(rows) == [free.name for free in FREE]
    for name, row in rows.items():
        one = found(RIG, name)
        low, high = row["posterior90"]
        assert one.bounds[0] <= low <= one.value <= high <= one.bounds[1], name
        assert row["rhat"] < 1.02
        assert row["ess"] > 200


def test_the_table_of_the_physics_page_has_the_numbers_of_the_posterior_that_ships() -> None:
    page = (Path(__file__).parents[2] / "docs" / "explanation" / "physics.md").read_text(encoding="utf-8")
    shipped = shipped_posterior()
    rows = {**shipped["parameters"], **shipped["derived"]}
    rows.pop("tension_n[0 mm]")  # the first-contact tension, once more
    for name, row in rows.items():
        scale = 1e3 if row.get("unit") in ("m", "kg*m^2") else 1.0
        cells = [" to ".join(f"{scale * end:.3g}" for end in row[key]) for key in ("prior90", "posterior90")]
        assert f"| {cells[0]} | {cells[1]} | {row['ratio']:.0%}".replace("%", " % |") in page, name
