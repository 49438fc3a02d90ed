"""Cross-sections: area, moments, torsion and warping against closed forms, and what must not change them."""

from pathlib import Path

import numpy as np
import pytest

from sinew.measure.errors import FileError, SpecError
from sinew.predict import section
from sinew.predict.section import (
    Outline,
    moments,
    outline,
    read_polygon,
    rectangle,
    solve_torsion,
    star,
)


def ellipse(width: float, height: float, corners: int = 360) -> Outline:
    """Return an ellipse with two axes [m] as a polygon with its corners on the ellipse."""
    angle = 2 * np.pi * np.arange(corners) / corners
    return Outline(np.column_stack([0.5 * width * np.cos(angle), 0.5 * height * np.sin(angle)]))


def circle(diameter: float, corners: int = 360) -> Outline:
    return ellipse(diameter, diameter, corners)


def annulus(outer: float, inner: float) -> Outline:
    """Return a ring between two diameters [m] as polygons."""
    return Outline(circle(outer).outer, (circle(inner).outer[::-1],))


TRIANGLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, np.sqrt(0.75)]])
ANGLE = [[0, 0], [3, 0], [3, 1], [1, 1], [1, 3], [0, 3]]


def rectangle_torsion(a: float, b: float) -> float:
    """St Venant's series, sides a and b."""
    n = np.arange(1, 400, 2)
    return float(a * b**3 * (1 / 3 - 64 * b / (np.pi**5 * a) * np.sum(np.tanh(n * np.pi * a / (2 * b)) / n**5)))


TORSION = {
    "circle": (circle(0.06), np.pi * 0.06**4 / 32),
    "annulus": (annulus(0.06, 0.03), np.pi * (0.06**4 - 0.03**4) / 32),
    "thin ring": (annulus(0.06, 0.056), np.pi * (0.06**4 - 0.056**4) / 32),
    "ellipse": (ellipse(0.08, 0.03), np.pi * (0.04 * 0.015) ** 3 / (0.04**2 + 0.015**2)),
    "square": (rectangle(0.05, 0.05), rectangle_torsion(0.05, 0.05)),
    "rectangle": (rectangle(0.06, 0.03), rectangle_torsion(0.06, 0.03)),
    "strip": (rectangle(0.2, 0.01), rectangle_torsion(0.2, 0.01)),
    "triangle": (outline(TRIANGLE), np.sqrt(3) / 80),
}


@pytest.mark.parametrize(("drawn", "expected"), TORSION.values(), ids=TORSION.keys())
def test_the_torsion_constant_is_the_closed_one(drawn: Outline, expected: float) -> None:
    assert solve_torsion(drawn).constant == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("name", ["square", "rectangle", "strip", "triangle"])
def test_the_torsion_constant_of_a_polygon_lies_between_its_bounds(name: str) -> None:
    drawn, expected = TORSION[name]
    low, high = solve_torsion(drawn).bounds
    assert low <= expected * (1 + 1e-9)
    assert expected <= high * (1 + 1e-9)


MOMENTS = {
    "circle": (circle(0.06), np.pi * 0.03**2, np.pi * 0.06**4 / 64, np.pi * 0.06**4 / 64),
    "annulus": (annulus(0.06, 0.03), np.pi * (0.03**2 - 0.015**2), *[np.pi * (0.06**4 - 0.03**4) / 64] * 2),
    "ellipse": (
        ellipse(0.08, 0.03),
        np.pi * 0.04 * 0.015,
        np.pi * 0.04 * 0.015**3 / 4,
        np.pi * 0.04**3 * 0.015 / 4,
    ),
    "rectangle": (rectangle(0.06, 0.03), 0.06 * 0.03, 0.06 * 0.03**3 / 12, 0.06**3 * 0.03 / 12),
    "triangle": (outline(TRIANGLE), np.sqrt(3) / 4, np.sqrt(3) / 96, np.sqrt(3) / 96),
}


@pytest.mark.parametrize(("drawn", "area", "least", "greatest"), MOMENTS.values(), ids=MOMENTS.keys())
def test_area_and_second_moments_are_the_closed_ones(
    drawn: Outline, area: float, least: float, greatest: float
) -> None:
    found = moments(drawn)
    assert (found.area, found.least, found.greatest) == pytest.approx((area, least, greatest), rel=1e-3)


def test_the_moments_of_an_angle_are_those_of_its_two_rectangles() -> None:
    found = moments(outline(ANGLE))
    parts = [(3.0, np.array([1.5, 0.5]), 3.0, 1.0), (2.0, np.array([0.5, 2.0]), 1.0, 2.0)]
    centre = sum(area * at for area, at, _, _ in parts) / 5.0
    tensor = np.zeros((2, 2))
    for area, at, width, height in parts:
        tensor += np.diag([area * width**2 / 12, area * height**2 / 12]) + area * np.outer(at - centre, at - centre)
    assert found.centroid == pytest.approx(tuple(centre))
    assert (found.least, found.greatest) == pytest.approx(tuple(np.linalg.eigvalsh(tensor)))


def test_the_warping_constant_of_an_ellipse_is_the_closed_one() -> None:
    a, b = 0.04, 0.015
    warp = ((a**2 - b**2) / (a**2 + b**2)) ** 2 * np.pi * (a * b) ** 3 / 24
    assert solve_torsion(ellipse(2 * a, 2 * b)).warping == pytest.approx(warp, rel=1e-3)


def test_a_long_thin_strip_has_vlasovs_warping_constant() -> None:
    # Its warping is x y, so that the constant is a³ b³/144, less a share of b/a that the ends take.
    assert solve_torsion(rectangle(2.0, 0.02)).warping == pytest.approx((2.0 * 0.02) ** 3 / 144, rel=5e-3)


def test_the_largest_shear_strain_of_a_square_is_in_the_middle_of_its_sides() -> None:
    # Timoshenko and Goodier, table in article 109: 0.675 times the side.
    assert solve_torsion(rectangle(2.0, 2.0)).shear_arm == pytest.approx(0.675 * 2.0, rel=2e-3)


def test_a_re_entrant_corner_has_no_largest_shear_strain() -> None:
    assert solve_torsion(outline(ANGLE)).shear_arm is None


CLOSED = {
    "circle": (section.circle_section(0.06), circle(0.06)),
    "annulus": (section.annulus_section(0.06, 0.03), annulus(0.06, 0.03)),
    "ellipse": (section.ellipse_section(0.03, 0.08), ellipse(0.03, 0.08)),
}


@pytest.mark.parametrize(("closed", "drawn"), CLOSED.values(), ids=CLOSED.keys())
def test_a_closed_form_agrees_with_the_polygon_in_everything(closed, drawn) -> None:  # type: ignore[no-untyped-def]
    meshed = section.section_of_outline(drawn, closed.shape)
    for name in ("diameter", "area", "perimeter", "least", "greatest", "torsion_constant"):
        assert getattr(meshed, name) == pytest.approx(getattr(closed, name), rel=1e-3), name
    assert meshed.warping_constant == pytest.approx(closed.warping_constant, rel=1e-3, abs=1e-12 * 0.06**6)
    assert meshed.shear_arm == pytest.approx(closed.shear_arm, rel=1e-2)


SHAPES = {
    "rectangle": rectangle(0.06, 0.02),
    "star": star(0.07, 0.035, 5),
    "angle": outline(np.array(ANGLE) * 0.01),
    "tube with a square hole": outline(np.array(rectangle(0.06, 0.04).outer), [rectangle(0.02, 0.02).outer + 0.004]),
}


@pytest.mark.parametrize("drawn", SHAPES.values(), ids=SHAPES.keys())
def test_shifting_turning_and_mirroring_change_nothing(drawn: Outline) -> None:
    turn, shift = 0.7, np.array([0.11, -0.05])
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ np.diag([1.0, -1.0])
    moved = outline(drawn.outer @ matrix.T + shift, [hole @ matrix.T + shift for hole in drawn.holes])
    here, there = solve_torsion(drawn), solve_torsion(moved)
    assert there.constant == pytest.approx(here.constant, rel=6e-4)
    assert there.warping == pytest.approx(here.warping, rel=5e-3)
    assert moments(moved).least == pytest.approx(moments(drawn).least, rel=1e-9)
    assert moments(moved).greatest == pytest.approx(moments(drawn).greatest, rel=1e-9)


def test_a_slit_makes_a_ring_weak() -> None:
    # A closed ring of middle radius r and wall t has 2 π r³ t, an open one 2 π r t³/3: (t/r)²/3 of it.
    angle = np.linspace(0.02, 2 * np.pi - 0.02, 120)
    ring = [r * np.column_stack([np.cos(angle), np.sin(angle)]) for r in (0.031, 0.029)]
    open_ring = solve_torsion(outline(np.concatenate([ring[0], ring[1][::-1]]))).constant
    arc = angle[-1] - angle[0]
    assert open_ring == pytest.approx(arc * 0.03 * 0.002**3 / 3, rel=0.03)


REFUSED = {
    "two corners": ([[0, 0], [1, 0]], [], "2 corners"),
    "a bow tie": ([[0, 0], [1, 1], [1, 0], [0, 1]], [], "no area"),
    "crossing edges": ([[0, 0], [3, 0], [3, 1], [1, 1], [1, -1], [0, -1]], [], "cross or touch"),
    "a hole outside": ([[0, 0], [1, 0], [1, 1], [0, 1]], [[[2, 2], [3, 2], [3, 3]]], "inside the outline"),
    "a hole across": ([[0, 0], [1, 0], [1, 1], [0, 1]], [[[0.5, 0.5], [2, 0.5], [0.5, 0.8]]], "cross or touch"),
    "not a number": ([[0, 0], [1, 0], [np.nan, 1]], [], "finite"),
}


@pytest.mark.parametrize(("outer", "holes", "sentence"), REFUSED.values(), ids=REFUSED.keys())
def test_what_is_no_section_is_refused(outer: list[list[float]], holes: list[list[list[float]]], sentence: str) -> None:
    with pytest.raises(SpecError, match=sentence):
        outline(outer, holes)


def test_a_polygon_is_read_with_its_hole_in_millimetres(tmp_path: Path) -> None:
    file = tmp_path / "tube.csv"
    file.write_text("# a square tube\n0,0\n40,0\n40,40\n0,40\n\n10;10\n30;10\n30;30\n10;30\n", encoding="utf-8")
    assert moments(read_polygon(file)).area == pytest.approx(1200e-6)


def test_a_hull_has_the_wide_side_first() -> None:
    hull = section.section_of_outline(rectangle(0.03, 0.06), "upright").hull
    assert hull is not None
    assert np.abs(np.array(hull)).max(axis=0) == pytest.approx([0.03, 0.015])


def test_a_line_that_is_no_corner_is_told(tmp_path: Path) -> None:
    file = tmp_path / "tube.csv"
    file.write_text("0,0\n40,zero\n", encoding="utf-8")
    with pytest.raises(FileError, match="line 2"):
        read_polygon(file)
