"""Properties of a cross-section: by closed form where there is one, else from its outline."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ellipe

from sinew.measure.errors import SpecError
from sinew.predict.sections.outline import Outline, moments, rectangle, star


@dataclass(frozen=True)
class Section:
    """What bending, torsion and compression need to know of a section, in SI.

    shape: in words. diameter: of the circle about the centroid that holds it [m]. area [m²], perimeter of all edges
    [m]. least, greatest: principal second moments [m⁴]. torsion_constant: St Venant's J [m⁴]; torsion_error: how far
    it may be off, as a share; zero for a closed form. warping_constant: Vlasov's, about the shear centre [m⁶].
    shear_arm: the largest shear strain per twist (rad/m) [m]; None where a re-entrant corner makes it unbounded.
    """

    shape: str
    diameter: float
    area: float
    perimeter: float
    least: float
    greatest: float
    torsion_constant: float
    torsion_error: float
    warping_constant: float
    shear_arm: float | None

    @property
    def polar_moment(self) -> float:
        """Return the polar moment about the centroid [m⁴]; the torsion constant of a circle, and larger else."""
        return self.least + self.greatest

    @property
    def is_solid_circle(self) -> bool:
        """Return whether its diameter says everything of it."""
        return bool(abs(self.area / (np.pi * self.diameter**2 / 4) - 1) < 1e-12)


def circle_section(diameter: float) -> Section:
    """Return a solid circle [m]."""
    return _with_shape(ellipse_section(diameter, diameter), f"circle of {diameter * 1e3:g} mm")


def annulus_section(outer: float, inner: float) -> Section:
    """Return a ring between two diameters [m]: J = π (D⁴ - d⁴)/32; it does not warp.

    Raises SpecError unless 0 < inner < outer."""
    if not 0 < inner < outer:
        raise SpecError(
            f"an annulus of {outer * 1e3:g} mm outside and {inner * 1e3:g} mm inside; expected 0 < inner < outer"
        )
    polar = np.pi * (outer**4 - inner**4) / 32
    return Section(
        shape=f"annulus of {outer * 1e3:g} and {inner * 1e3:g} mm",
        diameter=outer,
        area=np.pi * (outer**2 - inner**2) / 4,
        perimeter=np.pi * (outer + inner),
        least=polar / 2,
        greatest=polar / 2,
        torsion_constant=polar,
        torsion_error=0.0,
        warping_constant=0.0,
        shear_arm=outer / 2,
    )


def ellipse_section(width: float, height: float) -> Section:
    """Return an ellipse with two axes [m] (Timoshenko and Goodier): with half axes a ≥ b, J = π a³ b³/(a² + b²), the
    warping is -(a² - b²)/(a² + b²) x y, the largest shear strain 2 a² b/(a² + b²) per twist.

    Raises SpecError where a size is not positive."""
    if not (np.isfinite(width) and np.isfinite(height) and min(width, height) > 0):
        raise SpecError(f"an ellipse of {width * 1e3:g} mm by {height * 1e3:g} mm; expected positive sizes")
    a, b = max(width, height) / 2, min(width, height) / 2
    squares = a**2 + b**2
    slant = (a**2 - b**2) / squares
    return Section(
        shape=f"ellipse of {width * 1e3:g} by {height * 1e3:g} mm",
        diameter=2 * a,
        area=np.pi * a * b,
        perimeter=float(4 * a * ellipe(1 - (b / a) ** 2)),
        least=np.pi * a * b**3 / 4,
        greatest=np.pi * a**3 * b / 4,
        torsion_constant=np.pi * (a * b) ** 3 / squares,
        torsion_error=0.0,
        warping_constant=slant**2 * np.pi * (a * b) ** 3 / 24,
        shear_arm=2 * a**2 * b / squares,
    )


def rectangle_section(width: float, height: float) -> Section:
    """Return a rectangle [m]; torsion by finite elements. Raises SpecError where a size is not positive."""
    return section_of_outline(rectangle(width, height), f"rectangle of {width * 1e3:g} by {height * 1e3:g} mm")


def star_section(outer: float, inner: float, points: int) -> Section:
    """Return a star between two diameters [m]; torsion by finite elements. Raises SpecError as `outline.star` does."""
    shape = f"star of {points} points, {outer * 1e3:g} and {inner * 1e3:g} mm"
    return section_of_outline(star(outer, inner, points), shape)


def section_of_outline(drawn: Outline, shape: str) -> Section:
    """Return any polygon: moments are exact, torsion and warping come from finite elements.

    Raises SpecError where the outline cannot be cut into triangles."""
    from sinew.predict.sections.torsion import solve_torsion  # a closed form needs no finite elements

    about, torsion = moments(drawn), solve_torsion(drawn)
    return Section(
        shape=shape,
        diameter=2 * about.outer_radius,
        area=about.area,
        perimeter=about.perimeter,
        least=about.least,
        greatest=about.greatest,
        torsion_constant=torsion.constant,
        torsion_error=0.5 * (torsion.bounds[1] - torsion.bounds[0]) / torsion.constant,
        warping_constant=torsion.warping,
        shear_arm=torsion.shear_arm,
    )


def _with_shape(section: Section, shape: str) -> Section:
    return Section(**{**section.__dict__, "shape": shape})
