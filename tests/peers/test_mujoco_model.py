"""The exported joint in MuJoCo, beside the twin."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from sinew.apps.cli import main
from sinew.measure.errors import SpecError
from sinew.plan.plan import Pose
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_rig, load_rig, save_rig
from sinew.predict.design import Design, design_rig, load_material
from sinew.predict.modes import Finder, ModesRequest
from sinew.predict.multibody import Bodies, export_model, joint_bodies, write_mjcf
from sinew.predict.section import circle_section, ellipse_section
from sinew.tune.candidate import DesignTarget
from sinew.tune.design import Draft, _rig, _with_window

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")

PRETENSION_MM = 6.0


@pytest.fixture(scope="module")
def rig() -> RigSpec:
    return load_rig("paper")


@pytest.fixture(scope="module", params=[False, pytest.param(True, marks=pytest.mark.slow)], ids=["upright", "sways"])
def bodies(rig: RigSpec, request: pytest.FixtureRequest) -> Bodies:
    return joint_bodies(rig, ModesRequest((PRETENSION_MM,), (0.0,)), sway=request.param)


def forces(model: Any, data: Any, place: Any, speed: Any) -> Any:
    data.qpos[:], data.qvel[:] = place, speed
    mujoco.mj_forward(model, data)
    return (data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias).copy()


def swings(model: Any) -> tuple[Any, Any]:
    """Return the eigenvalues [1/s] that swing, slowest first, the lever locked, and how much of each is twist."""
    data, n = mujoco.MjData(model), model.nv
    still, mass = np.zeros(n), np.zeros((n, n))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    spring = np.array(
        [forces(model, data, still - e, still) - forces(model, data, still + e, still) for e in 1e-6 * np.eye(n)]
    )
    damper = np.array([forces(model, data, still, -e) - forces(model, data, still, e) for e in 1e-3 * np.eye(n)])
    kept = [i for i in range(n) if i != model.joint("lever").dofadr[0]]
    k, c, m = (matrix[np.ix_(kept, kept)] for matrix in (spring.T / 2e-6, damper.T / 2e-3, mass))
    one = np.eye(len(kept))
    system = np.block([[0 * one, one], [-np.linalg.solve(m, k), -np.linalg.solve(m, c)]])
    values, shapes = np.linalg.eig(system)
    twists = [row for row, i in enumerate(kept) if model.joint(int(model.dof_jntid[i])).name.startswith("twist")]
    moved = np.abs(shapes[twists].sum(axis=0)) / np.linalg.norm(shapes[: len(kept)], axis=0)
    order = sorted(np.flatnonzero(values.imag > 1), key=lambda i: abs(values[i]))
    return values[order], moved[order]


def poles(model: Any) -> Any:
    """Return the eigenvalues [1/s] that swing, slowest first, the lever locked."""
    return swings(model)[0]


TARGET = DesignTarget((0.7, 1.1), 7.0, 0.25)


def designed(shape: str, material: str, *sizes: float) -> RigSpec:
    """Return the rig of a candidate as `sinew design` proposes it."""
    draft = Draft(dump_rig(load_rig("paper")), TARGET, shape, material, sizes, (0.0, 0.02), (0.1, 0.1))
    return _with_window(_rig(draft), 24.0)


def torso_of_the_tutorial() -> RigSpec:
    silicone = load_material("dragon-skin-30")
    design = Design(circle_section(0.085), 0.12, silicone, tendon_circle=0.04, head_inertia=0.25, lever_inertia=0.05)
    return design_rig(load_rig("paper"), replace(design, head_mass=20.0))


MADE: dict[str, tuple[Callable[[], RigSpec], float]] = {
    "paper": (lambda: load_rig("paper"), 6.0),
    "torso": (torso_of_the_tutorial, 4.0),
    "annulus": (lambda: designed("annulus", "dragon-skin-30", 0.049, 29 / 49, 0.134, 0.0755, 0.0223), 21.77),
    "circle": (lambda: designed("circle", "base", 0.048, 1.0, 0.107, 0.033, 0.0286), 24.12),
    "ellipse": (lambda: designed("ellipse", "dragon-skin-30", 0.05, 43 / 50, 0.108, 0.061, 0.0335), 17.67),
    "oval": (lambda: design_rig(load_rig("paper"), Design(section=ellipse_section(0.065, 0.040), name="oval")), 6.0),
}
"""Rigs as Sinew makes them, and the pretension [mm] at which they are exported."""


@pytest.mark.parametrize("sway", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["upright", "sways"])
@pytest.mark.parametrize("name", MADE)
def test_every_rig_that_is_made_loads_in_mujoco_and_resonates_there_within_two_per_cent(name: str, sway: bool) -> None:
    make, pretension_mm = MADE[name]
    made = joint_bodies(make(), ModesRequest((pretension_mm,), (0.0,), swing_deg=7.0), sway=sway)
    values, twist = swings(mujoco.MjModel.from_xml_string(write_mjcf(made, [])))
    resonance_hz = abs(values[np.argmax(twist)]) / (2 * np.pi)
    assert resonance_hz == pytest.approx(made.modes["torsion"][0], rel=0.02)
    if name in ("annulus", "circle", "ellipse"):  # found by harmonic balance for the upper end of the band
        assert resonance_hz == pytest.approx(TARGET.stride_band_hz[1], rel=0.02)


def test_a_model_of_assumed_moments_says_so_and_loads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = load_rig("paper").model_dump()
    data["inertia"]["head"] |= {"value": 0.25, "bounds": (0.1, 0.5)}  # across, 0.0025 kg m² are left
    save_rig(RigSpec.model_validate(data), tmp_path / "torso.toml")
    assert main(["model", str(tmp_path / "torso.toml"), "--out", str(tmp_path / "joint.xml"), "--no-sway"]) == 0
    assert "0.125 kg m², the nearest possible, is assumed" in capsys.readouterr().out
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "joint.xml")).body("head").inertia.min() == 0.125


def test_an_exported_joint_rests_where_it_is_loaded_and_its_tendons_pull_as_the_twins(bodies: Bodies) -> None:
    model = mujoco.MjModel.from_xml_string(write_mjcf(bodies, []))
    data = mujoco.MjData(model)
    left = forces(model, data, model.qpos0, np.zeros(model.nv))
    assert np.max(np.abs(left)) < 1e-4 * float(bodies.tension.sum())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.body("head").xpos[2] == pytest.approx(bodies.plate[0], abs=1e-8)
    assert -data.actuator_force[:4] == pytest.approx(bodies.tension, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["position", "current"])
def test_torsion_and_sways_of_the_chain_are_the_twins_modes(rig: RigSpec, mode: Any) -> None:
    asked = ModesRequest((PRETENSION_MM,), (0.0,), 0.0, mode, swing_deg=0.1)  # so small that guides hold
    ours = Finder(rig, asked).at(PRETENSION_MM, 0.0).modes[:3]
    made = joint_bodies(rig, asked)
    theirs = poles(mujoco.MjModel.from_xml_string(write_mjcf(made, [])))[:3]
    # Six pieces are within 0.7 % of the rod, sways held by current the furthest off.
    assert np.abs(theirs) / (2 * np.pi) == pytest.approx([one.frequency_hz for one in ours], rel=7e-3)
    if mode == "position":  # held by current the two sways have one memory, at the mean of their frequencies
        assert -theirs.real / np.abs(theirs) == pytest.approx([one.damping for one in ours], rel=0.06)


@pytest.mark.slow
def test_a_chain_in_a_bent_pose_rests_there(rig: RigSpec) -> None:
    made = joint_bodies(rig, ModesRequest((PRETENSION_MM,), (20.0,), 90.0))
    model = mujoco.MjModel.from_xml_string(write_mjcf(made, []))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    lean = math.degrees(math.acos(data.body("head").xmat.reshape(3, 3)[2, 0]))
    assert lean == pytest.approx(20.0, abs=1e-3)


@pytest.mark.slow
def test_mujocos_head_bends_as_the_twins_where_its_tendons_are_taken_up(rig: RigSpec) -> None:
    from tests.experiments.mujoco_model import rest_beside

    ours, theirs = rest_beside(rig, PRETENSION_MM, Pose(bend_deg=10.0, azimuth_deg=0.0), pieces=4)
    assert theirs.bend_deg == pytest.approx(ours.bend_deg, rel=0.01)
    assert theirs.azimuth_deg == pytest.approx(ours.azimuth_deg, abs=0.1)


def test_the_name_of_a_rig_cannot_break_the_file(rig: RigSpec, tmp_path: Path) -> None:
    export_model(rig.model_copy(update={"name": "a--b--->"}), tmp_path / "joint.xml", PRETENSION_MM, sway=False)
    assert ElementTree.parse(tmp_path / "joint.xml").getroot().tag == "mujoco"


def test_a_rig_without_its_masses_is_told_how_to_go_on(rig: RigSpec, tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=r"no \[space\]"):
        export_model(rig.model_copy(update={"space": None}), tmp_path / "joint.xml")
