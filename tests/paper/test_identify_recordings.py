"""Oscillations that others measured, identified: what their mechanics are, in numbers that are known otherwise.

The recordings are no part of this repository; each has a SOURCE.txt.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sinew.identify.comparison import Comparison, compare
from sinew.identify.fit import fit
from sinew.identify.fitted import Fit
from sinew.identify.held_out import split_record
from sinew.identify.model import MODELS, get_model
from sinew.identify.record import Record, make_record

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="real recordings are not beside this repository")

# name: length of the pendulum [mm], by the labels and the note in SOURCE.txt
LENGTH_MM = {
    "60": 60,
    "70": 70,
    "80P": 80,
    "90p": 90,
    "100": 100,
    "110Pnedulum-120-14-1.6-2": 100,
    "120Pnedulum-120-14-1.6-2": 110,
    "120Pnedulum-120-14-1.6": 120,
}
BEAMS = [f"beam_{load}_V2" for load in ("gravity", "load52", "load101")]
each_pendulum = pytest.mark.parametrize("name", LENGTH_MM)


def pendulum_record(name: str) -> Record:
    """Return every third sample from the largest swing on; the even clock that SOURCE.txt tells."""
    table = pd.read_csv(DATA / "torsion_spring_pendulum" / f"{name}.csv")
    index = np.arange(len(table))
    time = np.polyfit(index, table["host_time_s"], 1)[0] * index
    angle = np.deg2rad(table["angle_deg"].to_numpy())
    first = int(np.argmax(np.abs(angle - np.median(angle[-200:]))))
    return make_record(time[first::3], angle[first::3], output_unit="rad")


@cache
def pendulum(name: str) -> Comparison:
    """Return the damping laws compared; gravity on a spring makes the restoring torque quadratic and cubic."""
    laws = ("cubic-quadratic", "loss-factor-cubic-quadratic", "coulomb-cubic-quadratic")
    return compare(split_record(pendulum_record(name), None, None), [MODELS[law] for law in laws])


@cache
def swing(name: str, model: str) -> Fit:
    angle = np.loadtxt(DATA / "rotary_pendulum_swing" / f"pendulum_free_swing_data_{name}.txt", skiprows=2)
    angle = np.deg2rad(angle)
    first = int(np.argmax(np.abs(angle) > 0.98 * np.abs(angle).max()))
    return fit(make_record(np.arange(angle.size - first) / 1000, angle[first:], output_unit="rad"), model)


@cache
def beam(name: str) -> Fit:
    table = pd.read_csv(DATA / "silicone_beam_dragonskin10" / f"{name}.csv")
    x = table[[f"Tip-{i}_x_m" for i in (1, 2, 3)]].mean(axis=1).to_numpy()
    first = int(np.argmax(np.abs(x - x[:20].mean()) > 1e-3)) + 3
    record = make_record(table["t_s"].to_numpy()[first:], x[first:], output_unit="m")
    return fit(record, get_model("linear").resting("creep"))


@pytest.mark.slow
@each_pendulum
def test_the_spring_pendulum_is_damped_by_viscous_and_dry_friction(name: str) -> None:
    assert pendulum(name).rows[0].model.damping == "coulomb"


@pytest.mark.slow
@each_pendulum
def test_dry_friction_makes_the_held_out_error_of_the_spring_pendulum_smaller(name: str) -> None:
    rmse = {row.model.damping: row.rmse_test for row in pendulum(name).rows}
    assert rmse["coulomb"] < min(rmse["viscous"], rmse["loss-factor"])


@pytest.mark.slow
def test_the_friction_torque_of_the_spring_pendulum_is_the_same_for_all_lengths() -> None:
    # Its inertia goes with the square of the length, so what is constant is (c/I) L².
    torque = [
        pendulum(name).best.parameters["coulomb_rad_per_s2"].value * (length / 100) ** 2
        for name, length in LENGTH_MM.items()
    ]
    assert np.std(torque) < 0.2 * np.mean(torque)


@pytest.mark.slow
def test_the_frequency_of_the_spring_pendulum_goes_with_one_over_its_length() -> None:
    product = [pendulum(name).best.natural_frequency_hz.value * length for name, length in LENGTH_MM.items()]
    assert np.std(product) < 0.02 * np.mean(product)


@pytest.mark.parametrize("name", ["02", "03"])
def test_the_rod_swings_by_the_law_of_gravity_with_its_own_small_swing_frequency(name: str) -> None:
    # A rod of 124 mm about its end: sqrt(3 g/2L)/2π = 1.734 Hz; the hinge's own inertia is small.
    assert swing(name, "pendulum").natural_frequency_hz.value == pytest.approx(1.734, rel=0.01)


@pytest.mark.parametrize("name", ["01", "02", "03"])
def test_gravity_leaves_less_than_a_linear_spring_of_the_rods_swing(name: str) -> None:
    assert swing(name, "pendulum").rmse < 0.5 * swing(name, "linear").rmse


@pytest.mark.parametrize("name", [f"{beam_}_{side}" for beam_ in BEAMS for side in "ab"])
def test_creep_is_needed_to_explain_the_silicone_beam(name: str) -> None:
    drift = beam(name).nuisance["drift"]
    assert abs(drift.value) > 3 * drift.std


@pytest.mark.parametrize("name", BEAMS[:2])
def test_the_damping_of_two_releases_of_a_beam_differs_by_less_than_an_eighth(name: str) -> None:
    a, b = (beam(f"{name}_{side}").damping_ratio.value for side in "ab")
    assert a == pytest.approx(b, rel=0.125)


def test_with_creep_modelled_the_heavier_beam_still_differs_in_damping_from_release_to_release() -> None:
    # So what differs is the motion itself, not where it settles: 18 %, more than its two standard deviations.
    a, b = (beam(f"beam_load101_V2_{side}").damping_ratio for side in "ab")
    assert b.value - a.value > 2 * np.hypot(a.std, b.std)
