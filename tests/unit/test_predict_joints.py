"""Joints that are not built yet: silicones, their rig, what tendons and plates do to them."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from tools.write_materials import materials_text

from sinew.measure.errors import RecordingError, SpecError
from sinew.mechanics.silicone import compressive_load, silicone_energy, twist_rigidity
from sinew.plan.rig import RigSpec
from sinew.plan.toml import dump_rig, load_rig, parse_rig
from sinew.predict.band import spread_of
from sinew.predict.design import Design, design_rig, fit_tensile, list_materials, load_material, section_of
from sinew.predict.joint import joint_problem
from sinew.predict.section import annulus_section, circle_section, ellipse_section
from sinew.predict.validity import (
    bonded_axial_factor,
    bonded_torsion_factor,
    check_joint,
    euler_load,
    largest_strain,
    loads_of,
    twisting_stretch,
)
from sinew.twin.parameters import from_rig
from sinew.twin.simulate import rest_tension

PAPER = load_rig("paper")
ROOT = Path(__file__).resolve().parents[2]
CURVES = ROOT.parent / "shared" / "data" / "silicone_tensile"
TABLE = ROOT / "src" / "sinew" / "predict" / "materials.toml"


@pytest.mark.skipif(not CURVES.is_dir(), reason="the measured tensile curves are not here")
def test_the_table_of_silicones_is_what_the_measured_curves_give() -> None:
    assert TABLE.read_text(encoding="utf-8") == materials_text(CURVES)


def test_a_neo_hookean_curve_with_slack_gives_its_modulus_back() -> None:
    strain = np.linspace(0.05, 1.5, 60)
    stretch = (1 + strain) / 1.03
    found = fit_tensile(strain, 2e5 * (stretch - stretch**-2))
    assert found.shear_modulus_pa.value == pytest.approx(2e5, rel=1e-6)
    assert found.slack == pytest.approx(0.03, rel=1e-5)
    assert found.shear_modulus_pa.std > 0


def test_a_curve_that_ends_early_is_refused() -> None:
    strain = np.linspace(0, 0.5, 30)
    with pytest.raises(RecordingError, match="none beyond 50%"):
        fit_tensile(strain, strain)


def test_silicones_are_known_by_their_names_in_any_spelling() -> None:
    assert load_material("Dragon Skin 30") is load_material("dragon-skin-30")
    assert len(list_materials()) == 5


def test_an_unknown_silicone_is_refused_with_the_nearest() -> None:
    with pytest.raises(SpecError, match="did you mean dragon-skin-30"):
        load_material("dragonskin30")


def test_a_rig_without_a_section_keeps_its_axial_stiffness_to_the_last_bit() -> None:
    silicone = PAPER.silicone
    diameter = silicone.diameter.value
    modulus = silicone.torsional_rigidity.value / (np.pi * diameter**4 / 32)
    assert float(from_rig(PAPER).axial_rigidity) == modulus * np.pi * diameter**2 / 4
    assert "[section]" not in dump_rig(PAPER)


def test_the_circle_that_the_rig_has_changes_nothing() -> None:
    same = design_rig(PAPER, Design(section=circle_section(PAPER.silicone.diameter.value)))
    assert same.section is None
    for new, old in zip(jax.tree.leaves(from_rig(same)), jax.tree.leaves(from_rig(PAPER)), strict=True):
        assert np.allclose(new, old, rtol=1e-12, atol=0)


def test_a_section_reaches_the_equations_by_its_rigidities() -> None:
    modulus = 2e5
    rig = design_rig(PAPER, Design(section=annulus_section(0.06, 0.03), shear_modulus=modulus))
    p = from_rig(rig)
    assert float(p.torsional_rigidity) == pytest.approx(modulus * np.pi * (0.06**4 - 0.03**4) / 32)
    assert float(p.axial_rigidity) == pytest.approx(modulus * np.pi * (0.06**2 - 0.03**2) / 4)
    # Small compression of the bar takes E A/L = 3 G A/L.
    with jax.enable_x64(True):
        energy = float(silicone_energy(jnp.zeros(()), jnp.asarray(1e-5), p))
    assert 2 * energy / 1e-10 == pytest.approx(3 * modulus * section_of(rig).area / 0.095, rel=1e-3)


def test_what_a_design_changes_is_marked_as_assumed_and_the_rest_is_not_touched() -> None:
    design = Design(length=0.12, tendons=3, tendon_circle=0.03, head_inertia=0.02, loss_factor=0.5, head_mass=5.0)
    rig = design_rig(PAPER, design)
    before = dict(PAPER.parameters())
    changed = {name for name, one in rig.parameters() if one.value != before[name].value}
    expected = {
        "silicone.length",
        "silicone.loss_factor",
        "tendons.base_radius",
        "tendons.head_radius",
        "tendons.free_span",
        "inertia.head",
        "inertia.head_mass",
        "space.head_across",
    }
    assert changed == expected
    assert {one.origin for name, one in rig.parameters() if name in changed} == {"assumed"}
    assert (rig.tendons.count, len(rig.wiring.tendon_ids)) == (3, 3)
    assert rig.tendons.free_span.value == pytest.approx(0.12)


@pytest.mark.parametrize(
    ("design", "sentence"),
    [
        (Design(material=load_material("dragon-skin-10"), shear_modulus=1e5), "expected one of them"),
        (Design(length=-0.1), "silicone.length would be -0.1 m"),
        (Design(shear_modulus=0.0), "shear modulus of 0 Pa"),
        (Design(tendons=40), "makes no rig: rig key tendons.count"),
    ],
)
def test_a_design_that_cannot_be_meant_is_refused(design: Design, sentence: str) -> None:
    with pytest.raises(SpecError, match=sentence):
        design_rig(PAPER, design)


def column(load: float, tilt_stiffness: float, elements: int = 12) -> float:
    """Return the smallest eigenvalue of a clamped column, E I = L = 1, that tendons press together.

    Hermite beams. The tendons' pull is shared over a circle and always points from the head's guides to the base's:
    ΣTℓ adds P δ²/(2 L) for a head that moves aside by δ; tilt_stiffness: of tendons that hold their length.
    """
    h = 1 / elements
    bend = (
        np.array(
            [
                [12, 6 * h, -12, 6 * h],
                [6 * h, 4 * h**2, -6 * h, 2 * h**2],
                [-12, -6 * h, 12, -6 * h],
                [6 * h, 2 * h**2, -6 * h, 4 * h**2],
            ]
        )
        / h**3
    )
    shorten = np.array(
        [
            [36, 3 * h, -36, 3 * h],
            [3 * h, 4 * h**2, -3 * h, -(h**2)],
            [-36, -3 * h, 36, -3 * h],
            [3 * h, -(h**2), -3 * h, 4 * h**2],
        ]
    ) / (30 * h)
    matrix = np.zeros((2 * elements + 2, 2 * elements + 2))
    for i in range(elements):
        matrix[2 * i : 2 * i + 4, 2 * i : 2 * i + 4] += bend - load * shorten
    matrix[-2, -2] += load
    matrix[-1, -1] += tilt_stiffness
    return float(np.linalg.eigvalsh(matrix[2:, 2:])[0])


def test_tendons_that_hold_their_force_buckle_a_column_as_euler_says() -> None:
    found = brentq(lambda load: column(load, 0.0), 1.0, 20.0)
    assert found == pytest.approx(euler_load(1.0, 1.0, tilt_held=False), rel=1e-4)


def test_tendons_that_hold_their_length_buckle_it_at_four_times_that() -> None:
    found = brentq(lambda load: column(load, 1e7), 20.0, 60.0)
    assert found == pytest.approx(euler_load(1.0, 1.0, tilt_held=True), rel=1e-3)


def twist_share(torsion_constant: float, polar_moment: float, stretch: float) -> float:
    """Return the twin's torsional stiffness at a stretch, over that at rest, of a section with these moments."""
    warping = jnp.asarray(polar_moment - torsion_constant)
    p = from_rig(PAPER)._replace(torsional_rigidity=jnp.asarray(torsion_constant), warping_rigidity=warping)
    return float(twist_rigidity(jnp.asarray(stretch), p)) / torsion_constant


def test_compression_stiffens_a_circle_in_torsion_as_rivlin_says() -> None:
    assert twist_share(2.0, 2.0, 0.8) == pytest.approx(1 / 0.8)
    assert twisting_stretch(2.0, 2.0) == 0.0


def test_slight_compression_softens_a_thin_section_as_wagner_says() -> None:
    # G J + σ I_p with σ = 3 G ε, for a section whose polar moment is a thousand times its torsion constant.
    strain, polar = -1e-5, 1000.0
    assert twist_share(1.0, polar, 1 + strain) - 1 == pytest.approx(3 * strain * polar, rel=5e-3)


def test_a_thin_section_twists_by_itself_at_wagners_load() -> None:
    # P = G J A/I_p
    assert compressive_load(1.0, twisting_stretch(1e-4, 1.0)) == pytest.approx(1e-4, rel=1e-3)


def warping_energy(stretch: float, warp: float) -> float:
    """Return the energy of a slightly twisted square bar with the warping `warp` times twist, over twist².

    The isochoric neo-Hookean energy (G = 1), with the pressure of the plain stretch on what the volume still changes.
    """
    x, weight = np.polynomial.legendre.leggauss(12)
    twist, across = 1e-3, 1 / np.sqrt(stretch)
    total = 0.0
    for xi, wi in zip(x, weight, strict=True):
        for yj, wj in zip(x, weight, strict=True):
            # ψ of a 2:1 ellipse: -(a² - b²)/(a² + b²) x y; integrated over its area by polar coordinates below.
            r, angle = 0.5 * (xi + 1), np.pi * (yj + 1)
            px, py = 2 * r * np.cos(angle), r * np.sin(angle)
            gradient = np.array(
                [
                    [across, 0, -across * twist * py],
                    [0, across, across * twist * px],
                    [warp * twist * py, warp * twist * px, stretch],
                ]
            )
            density = 0.5 * (np.sum(gradient**2) - 2 * across**2 - stretch**2)
            density -= (np.linalg.det(gradient) - 1) / stretch
            total += wi * wj * density * 2 * r * 0.5 * np.pi
    return total / twist**2


@pytest.mark.parametrize("stretch", [1.0, 0.9, 0.8])
def test_the_torsion_of_a_compressed_ellipse_is_the_least_of_its_energies(stretch: float) -> None:
    # Half axes 2 and 1: I_p = π a b (a² + b²)/4, J = π a³ b³/(a² + b²).
    polar, torsion = np.pi * 2 * 5 / 4, np.pi * 8 / 5
    slants = np.array([-2.0, 0.0, 2.0])
    least = np.polyfit(slants, [warping_energy(stretch, float(s)) for s in slants], 2)
    minimum = least[2] - least[1] ** 2 / (4 * least[0])
    assert 2 * minimum == pytest.approx(torsion * twist_share(torsion, polar, stretch), rel=1e-6)


def test_ends_that_hold_the_warping_stiffen_as_vlasovs_equation_says() -> None:
    torsion, warping, length = 2.0, 0.05, 1.5
    ratio = torsion / (3 * warping)  # G J/(E I_w)

    def rates(_: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.array([y[1], y[2], y[3], ratio * y[2]])

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array([a[0], a[1], b[0] - 1, b[1]])

    solved = solve_bvp(rates, ends, np.linspace(0, length, 50), np.zeros((4, 50)), tol=1e-8)
    torque = torsion * solved.y[1] - 3 * warping * solved.y[3]  # over G
    assert torque[25] / (torsion / length) == pytest.approx(bonded_torsion_factor(torsion, warping, length), rel=1e-6)


def test_a_squat_block_between_plates_follows_the_shape_factor_of_gent_and_lindley() -> None:
    # A cylinder: S = d/(4 L).
    assert bonded_axial_factor(np.pi * 0.05**2 / 4, np.pi * 0.05, 0.02) == pytest.approx(1 + 2 * (0.05 / 0.08) ** 2)


def test_the_largest_strain_is_the_largest_singular_value_of_the_deformation() -> None:
    shear, stretch = 0.5, 0.75
    across = stretch**-0.5
    gradient = np.array([[across, 0.0, 0.0], [0.0, across, shear * across], [0.0, 0.0, stretch]])
    assert largest_strain(shear, stretch) == pytest.approx(np.linalg.svd(gradient, compute_uv=False)[0] - 1)


def test_loads_at_rest_are_those_of_the_twin_and_grow_with_torsion() -> None:
    pretension = [0.0, 6.0, 12.0]
    problem = joint_problem(PAPER, pretension, 20.0, (1.0, 6.0))
    found = loads_of(problem, np.array([0.0, 0.5, 0.5]))
    assert found.rest_tension == pytest.approx(rest_tension(pretension, PAPER), rel=1e-6)
    assert found.tension[0] == pytest.approx(found.rest_tension[0], rel=1e-6)
    assert (found.tension[1:] > found.rest_tension[1:]).all()
    assert (found.stretch[1:] < found.rest_stretch[1:]).all()


def checks(rig: RigSpec, mode: str = "position", torsion_deg: float = 30.0) -> dict[str, tuple[bool, float | None]]:
    pretension = [0.0, 12.0]
    problem = joint_problem(rig, pretension, 20.0, (1.0, 6.0), mode=mode)  # type: ignore[arg-type]
    loads = loads_of(problem, np.radians([torsion_deg, torsion_deg]))
    return {c.check: (c.holds, c.value) for c in check_joint(rig, pretension, loads, tilt_held=mode != "current")}


def test_every_assumption_holds_for_the_papers_calibrated_joint() -> None:
    assert {name for name, (holds, _) in checks(PAPER).items() if not holds} == set()


# Of finite elements, incompressible neo-Hookean and axisymmetric, 8 by 24 elements: decision 15.
@pytest.mark.parametrize(("slenderness", "solid"), [(1.0, 0.1975), (1.7, 0.1065), (3.0, 0.0578)])
def test_the_factor_of_bonded_ends_is_that_of_finite_elements(slenderness: float, solid: float) -> None:
    assert bonded_axial_factor(np.pi, 2 * np.pi, 2 * slenderness) - 1 == pytest.approx(solid, rel=0.02)


def test_a_slender_soft_joint_buckles_sideways_under_its_tendons() -> None:
    rig = design_rig(PAPER, Design(section=circle_section(0.02), length=0.3))
    found = checks(rig)
    assert found["buckling_sideways"][0] is False
    assert checks(rig, "current")["buckling_sideways"][1] > found["buckling_sideways"][1]  # type: ignore[operator]


@pytest.mark.parametrize(
    ("design", "broken"),
    [
        (Design(section=circle_section(PAPER.silicone.diameter.value)), {"bonded_ends_axial"}),  # nobody calibrated it
        (Design(section=ellipse_section(0.09, 0.02)), {"bonded_ends_torsion", "buckling_by_twisting"}),
        (Design(length=0.04), {"slenderness", "bonded_ends_axial"}),
    ],
    ids=["not calibrated", "flat", "stubby"],
)
def test_what_beam_theory_does_not_know_of_a_joint_is_told(design: Design, broken: set[str]) -> None:
    assert broken <= {name for name, (holds, _) in checks(design_rig(PAPER, design)).items() if not holds}


def test_a_wide_swing_is_told_of() -> None:
    assert checks(PAPER, torsion_deg=100.0)["torsion_deg"] == (False, pytest.approx(100.0))


def test_a_material_brings_the_interval_of_its_modulus_into_the_rig_and_its_file() -> None:
    known = load_material("dragon-skin-30")
    rig = parse_rig(dump_rig(design_rig(PAPER, Design(material=known))))
    rigidity = rig.silicone.torsional_rigidity
    assert rigidity.interval90 is not None
    half = (rigidity.interval90[1] - rigidity.interval90[0]) / 2
    assert half / rigidity.value == pytest.approx(
        1.645 * known.shear_modulus_pa.std / known.shear_modulus_pa.value, rel=1e-3
    )
    assert spread_of(rig)[0] == ("silicone.torsional_rigidity",)
