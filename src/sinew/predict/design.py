"""A rig for a joint that is not built yet, from one that is: its section, its silicone, its tendons."""

import difflib
import functools
import tomllib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import ValidationError
from scipy.optimize import least_squares

from sinew.measure.arrays import Array
from sinew.measure.errors import FileError, RecordingError, SpecError, UnitError
from sinew.measure.estimate import Estimate
from sinew.measure.files.names import find_columns, unit_in_name
from sinew.measure.read import numbers, read_table
from sinew.measure.result import Field, Result
from sinew.measure.units import convert
from sinew.plan.rig import RigSpec
from sinew.plan.toml import complaint
from sinew.predict.band import carried_over
from sinew.predict.section import Section, circle_section

# ---- silicones: the shear modulus of one by its name, or by a measured tensile curve


@dataclass(frozen=True, repr=False)
class Material(Result):
    """A silicone. shear_modulus_pa: at small strain; its standard deviation says how far fits of one curve lie from one
    another, not how far specimens differ. secant_pa: σ/(λ - 1/λ²) at 100 % strain. slack: strain ε₀ at which the curve
    begins to carry; None in the table."""

    name: Annotated[str, Field("", "detail")]
    title: str
    shear_modulus_pa: Annotated[Estimate, Field("G by fits of its curve")]
    secant_pa: Annotated[float, Field("G at 100 % strain")]
    slack: Annotated[float | None, Field("slack", unit="%")]

    def heading(self) -> str:
        """Return its title."""
        return self.title


@functools.cache
def _table() -> dict[str, Material]:
    text = files("sinew.predict").joinpath("materials.toml").read_text(encoding="utf-8")
    return {
        name: Material(
            name,
            row["title"],
            Estimate.normal(1e3 * row["shear_modulus_kpa"], 1e3 * row["shear_modulus_std_kpa"]),
            1e3 * row["secant_kpa"],
            None,
        )
        for name, row in tomllib.loads(text).items()
    }


def list_materials() -> list[str]:
    """Return the names of the silicones that are known."""
    return list(_table())


def load_material(name: str) -> Material:
    """Return the silicone of a name, such as `dragon-skin-30`. Raises SpecError where it is not known."""
    plain = name.strip().lower().replace(" ", "-").replace("_", "-")
    table = _table()
    if plain in table:
        return table[plain]
    close = difflib.get_close_matches(plain, table, n=1)
    advice = f"; did you mean {close[0]}?" if close else ""
    raise SpecError(f"unknown material {name!r}, known are {', '.join(table)}{advice}")


# A measured tensile curve becomes a shear modulus with what is known of its scatter.
#
# An incompressible neo-Hookean bar has the engineering stress σ = G (λ - 1/λ²), so that E = 3 G at small strain. A
# gripped specimen begins to carry only after some slack ε₀, hence λ = (1 + ε)/(1 + ε₀).


FIT_STRAIN = 0.3
"""Engineering strain up to which the small-strain modulus is fitted."""

SECANT_STRAIN = 1.0
"""Engineering strain at which the secant modulus is taken."""

_WIDER = 0.5
_FEWEST = 6


def material_of_curve(path: Path, columns: str | None = None) -> Material:
    """Return the silicone whose tensile curve is in a file, named after it; for `sinew joint --tensile`.

    columns: "STRAIN:unit,STRESS:unit" of a table (engineering strain and stress; without a unit the one in the name
    counts, and strain is a plain number); None for a file of the Soft Robotics Materials Database. What follows the
    largest strain is left out. Raises FileError, RecordingError or UnitError with a sentence.
    """
    strain, stress = read_tensile(path) if columns is None else _read_columns(path, columns)
    if not (strain.size and strain.min() > -1 and np.isfinite(strain * stress).all() and np.ptp(stress) > 0):
        raise RecordingError(
            f"{path.name} holds no tensile curve; expected numbers, strains above -100 % and a stress that changes"
        )
    loading = np.arange(strain.size) <= int(np.argmax(strain))
    order = np.argsort(strain[loading], kind="stable")
    found = fit_tensile(strain[loading][order], stress[loading][order], path.stem)
    if not found.shear_modulus_pa.value > 0:
        raise RecordingError(
            f"the curve in {path.name} gives a shear modulus of {found.shear_modulus_pa.value:.3g} Pa, expected a "
            "positive one; are strain and stress the right way round, and is the pull positive?"
        )
    return found


def _read_columns(path: Path, columns: str) -> tuple[Array, Array]:
    specs = columns.split(",")
    if len(specs) != 2:
        raise RecordingError(
            f"found {columns!r}, expected two columns, of strain and of stress: STRAIN:unit,STRESS:unit"
        )
    table, found = read_table(path), []
    for spec, default, unit in zip(specs, ("1", ""), ("1", "Pa"), strict=True):
        (name,), stated = find_columns(table, spec)
        if not (stated := stated or unit_in_name(name) or default):
            raise UnitError(f"the unit of the stress in column {name!r} is not known; write it as {name}:kPa")
        found.append(numbers(table, name) * convert(stated, unit))
    return found[0], found[1]


def read_tensile(path: Path) -> tuple[Array, Array]:
    """Return engineering strain [1] and stress [Pa] of a file of the Soft Robotics Materials Database.

    The file has semicolons, a header block, and columns of time, true strain and stress, engineering strain and
    stress, in MPa. Raises FileError where it cannot be read or holds no such rows.
    """
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}") from error
    begin = next((i for i, line in enumerate(lines) if line.startswith("Time (s)")), None)
    if begin is None:
        raise FileError(
            f"{path} has no row that begins with 'Time (s)'; expected a curve of the Soft Robotics "
            "Materials Database, or the columns of another table: STRAIN:unit,STRESS:unit"
        )
    rows = [line.split(";") for line in lines[begin + 1 :] if line.strip(" ;")]
    try:
        table = np.array([[float(row[k]) for k in (3, 4)] for row in rows]).reshape(-1, 2)
    except (ValueError, IndexError) as error:
        raise FileError(f"{path} holds a row that is not of its five columns ({error}); mend or remove it") from error
    return table[:, 0], 1e6 * table[:, 1]


def fit_tensile(strain: Array, stress: Array, name: str = "") -> Material:
    """Return the silicone of a curve of engineering strain [1] and stress [Pa], with a name.

    G is fitted with slack up to `FIT_STRAIN`. Its standard deviation is the root mean square by which three other
    readings of the curve differ from it: without slack; with slack up to 50 %; a third of the straight slope.
    Raises RecordingError where fewer than six samples lie below that strain, or none beyond `SECANT_STRAIN`.
    """
    low = strain <= FIT_STRAIN
    if np.sum(low) < _FEWEST or strain.max() < SECANT_STRAIN:
        raise RecordingError(
            f"a tensile curve with {np.sum(low)} samples up to {FIT_STRAIN:.0%} strain and none beyond "
            f"{strain.max():.0%}; expected {_FEWEST} and {SECANT_STRAIN:.0%}"
        )
    modulus, slack = _with_slack(strain[low], stress[low])
    wide = strain <= _WIDER
    law = _law(1 + strain[low])
    others = [
        float(law @ stress[low] / (law @ law)),
        _with_slack(strain[wide], stress[wide])[0],
        float(np.polyfit(strain[low], stress[low], 1)[0]) / 3,
    ]
    std = float(np.sqrt(np.mean((np.array(others) - modulus) ** 2)))
    stretch = 1 + SECANT_STRAIN
    secant = float(np.interp(SECANT_STRAIN, strain, stress) / _law(np.array(stretch)))
    return Material(name, name, Estimate.normal(modulus, std), secant, slack)


def _law(stretch: Array) -> Array:
    return np.asarray(stretch - stretch**-2)


def _with_slack(strain: Array, stress: Array) -> tuple[float, float]:
    scale = float(np.max(np.abs(stress)))

    def residual(x: Array) -> Array:
        return np.asarray(x[0] * _law((1 + strain) / (1 + x[1])) - stress / scale)

    found = least_squares(residual, [1.0, 0.0], xtol=1e-12, ftol=1e-12, gtol=1e-12).x
    return float(found[0] * scale), float(found[1])


_ROOM = 2.0


@dataclass(frozen=True)
class Design:
    """What is to differ from the base rig, in SI; None leaves a part as it is.

    section: of the silicone. length: of it [m]; the free span of the tendons changes by as much. material, or
    shear_modulus [Pa]. loss_factor [1]. tendons: their number; tendon_circle: radius of the guides' circle on base and
    head [m]; first_contact_tension: of each [N]. head_inertia, lever_inertia [kg m²], head_mass [kg]. head_across: the
    head's moment across its axis about its centre [kg m²]; head_height: of that centre above the plate [m].
    """

    section: Section | None = None
    length: float | None = None
    material: Material | None = None
    shear_modulus: float | None = None
    loss_factor: float | None = None
    tendons: int | None = None
    tendon_circle: float | None = None
    first_contact_tension: float | None = None
    head_inertia: float | None = None
    lever_inertia: float | None = None
    head_mass: float | None = None
    head_across: float | None = None
    head_height: float | None = None
    name: str | None = None


def section_of(rig: RigSpec) -> Section:
    """Return the section of a rig: its own, or the solid circle that its diameter stands for."""
    own = rig.section
    if own is None:
        return circle_section(rig.silicone.diameter.value)
    return Section(
        shape=own.shape,
        diameter=rig.silicone.diameter.value,
        area=own.area.value,
        perimeter=own.perimeter.value,
        least=own.least_moment.value,
        greatest=own.greatest_moment.value,
        torsion_constant=own.torsion_constant.value,
        torsion_error=0.0,
        warping_constant=own.warping_constant.value,
        shear_arm=None if own.shear_arm is None else own.shear_arm.value,
        hull=None if own.hull_mm is None else tuple((1e-3 * y, 1e-3 * z) for y, z in own.hull_mm),
    )


def shear_modulus_of(rig: RigSpec) -> float:
    """Return G of a rig's silicone [Pa]: its torsional rigidity over the torsion constant."""
    return rig.silicone.torsional_rigidity.value / section_of(rig).torsion_constant


@dataclass(frozen=True, repr=False)
class SectionResult(Result, title="section"):
    """A cross-section, see `Section`. torsion_error: how far the torsion constant may be off, as a share."""

    shape: Annotated[str, Field("shape")]
    diameter_mm: Annotated[float, Field("diameter")]
    area_mm2: Annotated[float, Field("area")]
    perimeter_mm: Annotated[float, Field("perimeter")]
    least_moment_mm4: Annotated[float, Field("least moment")]
    greatest_moment_mm4: Annotated[float, Field("greatest moment")]
    torsion_constant_mm4: Annotated[float, Field("torsion constant")]
    torsion_error: Annotated[float, Field("its error", unit="%")]
    warping_constant_mm6: Annotated[float, Field("warping constant")]
    shear_arm_mm: Annotated[float | None, Field("shear arm")]


@dataclass(frozen=True, repr=False)
class DesignedJoint(Result, title="silicone"):
    """Section, material and stiffness of a rig's silicone; the material where a design names one."""

    section: Annotated[SectionResult, Field("")]
    material: Annotated[Material | None, Field("")]
    shear_modulus_kpa: Annotated[float, Field("G", unit="kPa")]
    torsional_rigidity_n_m2: Annotated[float, Field("torsional rigidity G·J", unit="N m²")]
    length_mm: Annotated[float, Field("length")]
    stiffness_n_m_rad: Annotated[float, Field("G·J/L", unit="N m/rad")]


def designed_joint(rig: RigSpec, design: Design | None) -> DesignedJoint:
    """Return section, material and stiffness of a rig's silicone."""
    section = (design and design.section) or section_of(rig)
    return DesignedJoint(
        SectionResult(
            section.shape,
            1e3 * section.diameter,
            1e6 * section.area,
            1e3 * section.perimeter,
            1e12 * section.least,
            1e12 * section.greatest,
            1e12 * section.torsion_constant,
            section.torsion_error,
            1e18 * section.warping_constant,
            None if section.shear_arm is None else 1e3 * section.shear_arm,
        ),
        design.material if design is not None else None,
        1e-3 * shear_modulus_of(rig),
        rig.silicone.torsional_rigidity.value,
        1e3 * rig.silicone.length.value,
        rig.silicone.stiffness(0.0),
    )


def design_rig(base: RigSpec, design: Design) -> RigSpec:
    """Return the rig of a design: the base, with every changed parameter marked as assumed and its bounds made wide.

    Everything else stays the base's: guides, motors, drive, sensors, and without a loss factor that too. A parameter
    that keeps its value keeps what is known of its uncertainty; a material brings that of its modulus.
    Raises SpecError where a number cannot be meant.

    >>> import sinew as sn
    >>> sn.design_rig(sn.load_rig("paper"), sn.Design(length=0.09)).silicone.length.value
    0.09
    """
    if design.material is not None and design.shear_modulus is not None:
        raise SpecError("found a material and a shear modulus; expected one of them")
    data = base.model_dump()
    data["name"] = design.name or f"{base.name}, changed"
    _put_silicone(data, base, design)
    origin = f"designed; the rig {base.name} was the base"
    values = {
        "silicone.length": design.length,
        "silicone.loss_factor": design.loss_factor,
        "tendons.base_radius": design.tendon_circle,
        "tendons.head_radius": design.tendon_circle,
        "tendons.first_contact_tension": design.first_contact_tension,
        "inertia.head": design.head_inertia,
        "inertia.lever": design.lever_inertia,
        "inertia.head_mass": design.head_mass,
    }
    for name, value in values.items():
        if value is not None:
            _put(data, name, value, origin)
    _put_head(data, design, origin)
    if design.length is not None:
        span = base.tendons.free_span.value + design.length - base.silicone.length.value
        _put(data, "tendons.free_span", span, f"{origin}; it follows the silicone's length")
        if design.section is None:
            # A calibrated diameter holds what the bonded ends do at its own length.
            _put(data, "silicone.diameter", base.silicone.diameter.value, f"{origin}; found at another length")
    if design.tendons is not None:
        data["tendons"]["count"] = design.tendons
        if design.tendons != base.tendons.count:
            data.pop("wiring")  # the usual one of that number
    try:
        rig = RigSpec.model_validate(data)
    except ValidationError as error:
        raise SpecError(f"this design makes no rig: {complaint(error, RigSpec, 'rig')}") from error
    return carried_over(base, rig)[0]


def _put_head(data: dict[str, Any], design: Design, sentence: str) -> None:
    """Write the head's centre and its moment across into a rig's data; a new head without one gets a cylinder's."""
    given = {"head_height": design.head_height, "head_across": design.head_across}
    if data["space"] is None:
        if any(value is not None for value in given.values()):
            raise SpecError("found a height or a moment across of a head in a rig without [space]; take another base")
        return
    for name, value in given.items():
        if value is not None:
            _put(data, f"space.{name}", value, sentence)
    if design.head_across is None and not (design.head_inertia is None and design.head_height is None):
        space, inertia = data["space"], data["inertia"]
        mass = inertia["head_mass"]["value"] - space["lever_mass"]["value"]
        across = moment_across(inertia["head"]["value"], max(mass, 0.0), space["head_height"]["value"])
        _put(
            data,
            "space.head_across",
            across,
            f"{sentence}; as of a cylinder on the plate with its centre at head_height",
        )


def moment_across(along: float, mass: float, height: float) -> float:
    """Return the moment across the axis, about its centre [kg m²], of a solid cylinder that stands on the plate.

    along: its moment about the axis, m r²/2 [kg m²]; mass [kg]; height: of its centre, half its length H [m].
    m (3 r² + H²)/12 is half of the one and m h²/3.
    """
    return along / 2 + mass * height**2 / 3


def _put_silicone(data: dict[str, Any], base: RigSpec, design: Design) -> None:
    """Write section and torsional rigidity into a rig's data."""
    section = design.section or section_of(base)
    modulus, source = shear_modulus_of(base), f"G as in the rig {base.name}"
    if design.shear_modulus is not None:
        modulus, source = design.shear_modulus, "G as given"
    elif design.material is not None:
        known = design.material.shear_modulus_pa
        modulus = known.value
        source = f"G of {design.material.title}, within {known.std / known.value:.0%}, from its tensile curve"
    if design.section is None and design.material is None and design.shear_modulus is None:
        return
    if not modulus > 0:
        raise SpecError(f"a shear modulus of {modulus:g} Pa, expected a positive one")
    rigidity = modulus * section.torsion_constant
    _put(data, "silicone.torsional_rigidity", rigidity, f"designed: {section.shape}; {source}")
    if design.material is not None:
        known = design.material.shear_modulus_pa
        interval = (known.low * section.torsion_constant, known.high * section.torsion_constant)
        data["silicone"]["torsional_rigidity"]["interval90"] = interval
    if design.section is None:
        return
    _put(data, "silicone.diameter", section.diameter, f"designed: circle around the {section.shape}")
    # A solid circle needs no section of its own.
    data["section"] = None if section.is_solid_circle else _section_data(section)


def _section_data(section: Section) -> dict[str, Any]:
    torsion = "closed form"
    if section.torsion_error > 0:
        torsion = f"finite elements, within {section.torsion_error:.1e} of it"
    rows: dict[str, tuple[float | None, str, str]] = {
        "area": (section.area, "m^2", ""),
        "torsion_constant": (section.torsion_constant, "m^4", torsion),
        "least_moment": (section.least, "m^4", ""),
        "greatest_moment": (section.greatest, "m^4", ""),
        "warping_constant": (section.warping_constant, "m^6", "about the shear centre"),
        "perimeter": (section.perimeter, "m", "of all edges"),
        "shear_arm": (section.shear_arm, "m", "largest shear strain per twist"),
    }
    found: dict[str, Any] = {"shape": section.shape}
    if section.hull is not None:
        found["hull_mm"] = tuple((round(1e3 * y, 4), round(1e3 * z, 4)) for y, z in section.hull)
    for name, (value, unit, note) in rows.items():
        if value is not None:
            found[name] = {
                "value": value,
                "unit": unit,
                "origin": "assumed",
                "bounds": (value / _ROOM, value * _ROOM),
                "note": note,
            }
    return found


def _put(data: dict[str, Any], dotted: str, value: float, note: str) -> None:
    part, name = dotted.split(".")
    row = data[part][name]
    if not value >= 0:
        raise SpecError(f"{dotted} would be {value:g} {row['unit']}, expected a positive number")
    low, high = row["bounds"]
    row |= {
        "value": _plain(value),
        "origin": "assumed",
        "bounds": (_plain(min(low, value / _ROOM)), _plain(max(high, value * _ROOM))),
        "note": note,
    }


def _plain(value: float) -> float:
    """Return a value as somebody would write it: 0.08, where a sum of lengths says 0.07999999999999999."""
    return float(f"{value:.12g}")
