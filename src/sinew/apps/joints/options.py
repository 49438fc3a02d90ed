"""The options that several commands on joints share: a joint to be built, what is asked of a rig."""

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from sinew.apps.console import LARGEST_DEG, check_choice, checked_band, checked_number, number_list, option
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.plan.rig import RigSpec
    from sinew.predict.design import Design
    from sinew.predict.predicted import PredictionRequest
    from sinew.predict.section import Section

BASE_RIG = "paper"
"""The rig that a joint is derived from where none is named."""

_SHAPES = {
    "circle": ("outer_mm",),
    "annulus": ("outer_mm", "inner_mm"),
    "ellipse": ("width_mm", "height_mm"),
    "rectangle": ("width_mm", "height_mm"),
    "star": ("outer_mm", "inner_mm", "star_points"),
    "polygon": ("polygon",),
}


def _joint(metavar: str, help_: str) -> Any:
    return typer.Option(metavar=metavar, help=f"Joint: {help_}")


class JointOptions(NamedTuple):
    """What was asked for, in the units of the options; None where nothing was. Each is called as its field."""

    section: Annotated[str | None, _joint("|".join(_SHAPES), "cross-section of the silicone.")] = None
    outer_mm: Annotated[float | None, _joint("MM", "outer diameter (circle, annulus, star).")] = None
    inner_mm: Annotated[float | None, _joint("MM", "inner diameter (annulus, star).")] = None
    width_mm: Annotated[float | None, _joint("MM", "width (ellipse, rectangle).")] = None
    height_mm: Annotated[float | None, _joint("MM", "height (ellipse, rectangle).")] = None
    star_points: Annotated[int | None, _joint("N", "points of a star.")] = None
    polygon: Annotated[Path | None, _joint("FILE", "x,y in mm a line; an empty line begins a hole.")] = None
    length_mm: Annotated[float | None, _joint("MM", "length of the silicone.")] = None
    material: Annotated[str | None, _joint("NAME", "silicone by name, e.g. dragon-skin-30.")] = None
    tensile: Annotated[Path | None, _joint("FILE", "silicone by its measured tensile curve.")] = None
    tensile_columns: Annotated[str | None, _joint("COL:unit,COL:unit", "strain and stress in that file.")] = None
    shear_modulus_kpa: Annotated[float | None, _joint("KPA", "of the silicone, E/3.")] = None
    loss_factor: Annotated[float | None, _joint("1", "tan δ of the silicone.")] = None
    tendons: Annotated[int | None, _joint("N", "number of tendons.")] = None
    tendon_circle_mm: Annotated[float | None, _joint("MM", "radius of the circle of guides.")] = None
    first_contact_n: Annotated[float | None, _joint("N", "tension of a tendon at 0 mm.")] = None
    head_inertia_kg_m2: Annotated[float | None, _joint("I", "of the head without the lever.")] = None
    lever_inertia_kg_m2: Annotated[float | None, _joint("I", "of the lever with its weights.")] = None
    head_mass_kg: Annotated[float | None, _joint("KG", "head, lever, drive.")] = None
    head_height_mm: Annotated[float | None, _joint("MM", "centre of the head above its plate.")] = None
    head_across_kg_m2: Annotated[
        float | None, _joint("I", "of the head across its axis, about its centre; else a cylinder's.")
    ] = None
    name: Annotated[str | None, _joint("NAME", "name of its rig.")] = None

    @property
    def given(self) -> list[str]:
        """Return the options that were given."""
        return [_flag(name) for name, value in self._asdict().items() if value is not None]


_REACH = {
    "outer_mm": (1, 2000),
    "inner_mm": (0.1, 2000),
    "width_mm": (1, 2000),
    "height_mm": (1, 2000),
    "length_mm": (1, 5000),
    "shear_modulus_kpa": (1, 100_000),
    "loss_factor": (0, 2),
    "tendon_circle_mm": (1, 2000),
    "first_contact_n": (0.01, 10_000),
    "head_inertia_kg_m2": (1e-7, 100),
    "lever_inertia_kg_m2": (1e-7, 100),
    "head_mass_kg": (1e-4, 1000),
    "head_height_mm": (0, 3000),
    "head_across_kg_m2": (1e-7, 100),
}
"""What a size of a joint may be, in the unit of its option; beyond it, it was meant in another unit."""


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def with_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command with each parameter that is a named tuple replaced by its fields, options that may be None."""
    given = inspect.signature(command)
    keyword = inspect.Parameter.KEYWORD_ONLY
    groups = {name: one.annotation for name, one in given.parameters.items() if hasattr(one.annotation, "_fields")}
    own = [one.replace(kind=keyword) for name, one in given.parameters.items() if name not in groups]
    added = {name: one for group in groups.values() for name, one in group.__annotations__.items()}
    options = [inspect.Parameter(name, keyword, default=None, annotation=one) for name, one in added.items()]

    @functools.wraps(command)
    def spread(*args: Any, **kwargs: Any) -> Any:
        made = {one: group(*(kwargs.pop(name, None) for name in group._fields)) for one, group in groups.items()}
        return command(*args, **made, **kwargs)

    spread.__signature__ = given.replace(parameters=[*own[:-1], *options, own[-1]])  # type: ignore[attr-defined]
    spread.__annotations__ = {name: one for name, one in command.__annotations__.items() if name not in groups} | added
    return spread


def designed_rig(base: str | None, joint: JointOptions) -> "tuple[RigSpec, Design | None]":
    """Return the rig that is meant, and the design where it differs from the base.

    base: file or name of the rig that the joint is derived from; the paper's where None.
    Raises SpecError where options do not go together.
    """
    from sinew.plan.toml import load_rig
    from sinew.predict.design import design_rig

    rig = load_rig(base or BASE_RIG)
    if not joint.given:
        return rig, None
    design = design_of(joint)
    return design_rig(rig, design), design


def design_of(joint: JointOptions) -> "Design":
    """Return the design that options describe, in SI. Raises SpecError where they do not go together."""
    from sinew.predict.design import Design, load_material, material_of_curve

    named = [name for name in ("material", "tensile", "shear_modulus_kpa") if getattr(joint, name) is not None]
    if len(named) > 1:
        raise SpecError(f"found {_flag(named[0])} and {_flag(named[1])}; expected one way to say what the silicone is")
    if joint.tensile_columns is not None and joint.tensile is None:
        raise SpecError("found --tensile-columns without --tensile; name the file that they are in")
    for name, (low, high) in _REACH.items():
        value = getattr(joint, name)
        if value is not None:
            checked_number(_flag(name), value, f"{low:g} to {high:g}; look at its unit", low=low, high=high)
    section = _section(joint)
    what = [section.shape] if section else []
    material = None if joint.material is None else load_material(joint.material)
    if joint.tensile is not None:
        material = material_of_curve(joint.tensile, joint.tensile_columns)
    what += [material.title] if material else []
    what += [f"{joint.length_mm:g} mm long"] if joint.length_mm is not None else []
    return Design(
        section=section,
        length=_scaled(joint.length_mm, 1e-3),
        material=material,
        shear_modulus=_scaled(joint.shear_modulus_kpa, 1e3),
        loss_factor=joint.loss_factor,
        tendons=joint.tendons,
        tendon_circle=_scaled(joint.tendon_circle_mm, 1e-3),
        first_contact_tension=joint.first_contact_n,
        head_inertia=joint.head_inertia_kg_m2,
        lever_inertia=joint.lever_inertia_kg_m2,
        head_mass=joint.head_mass_kg,
        head_across=joint.head_across_kg_m2,
        head_height=_scaled(joint.head_height_mm, 1e-3),
        name=joint.name or ", ".join(what) or None,
    )


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def _section(joint: JointOptions) -> "Section | None":
    from sinew.predict import section as shapes
    from sinew.predict.section import read_polygon

    sizes = {name for names in _SHAPES.values() for name in names}
    given = {name for name in sizes if getattr(joint, name) is not None}
    if joint.section is None:
        if given:
            raise SpecError(f"found {_flag(min(given))} without --section; expected one of {', '.join(_SHAPES)}")
        return None
    check_choice("--section", joint.section, _SHAPES)
    needed = _SHAPES[joint.section]
    for name in needed:
        if name not in given:
            raise SpecError(f"--section {joint.section} needs {_flags(needed)}; {_flag(name)} is missing")
    for name in sorted(given - set(needed)):
        raise SpecError(f"{_flag(name)} does not belong to --section {joint.section}, which takes {_flags(needed)}")
    if joint.polygon is not None:
        return shapes.section_of_outline(read_polygon(joint.polygon), f"polygon of {joint.polygon.stem}")
    values = [getattr(joint, name) * (1 if name == "star_points" else 1e-3) for name in needed]
    makers: dict[str, Callable[..., Section]] = {
        "circle": shapes.circle_section,
        "annulus": shapes.annulus_section,
        "ellipse": shapes.ellipse_section,
        "rectangle": shapes.rectangle_section,
        "star": shapes.star_section,
    }
    return makers[joint.section](*values)


def _flags(names: tuple[str, ...]) -> str:
    return ", ".join(map(_flag, names))


# What `sinew predict` and `tune` ask of a rig.

MODES = ("position", "position-with-current-limit", "current")
"""Modes of the tendon motors."""

_BAND_HZ = (1.0, 6.0)

Pretension = Annotated[str, option("MM,...", "Rig: pretensions, one curve for each.", "--pretension-mm")]
Amplitude = Annotated[float, option("DEG", "Rig: amplitude of the drive's command.", "--amplitude-deg")]
Mode = Annotated[str, option("|".join(MODES), "Rig: mode of the motors.", "--mode")]
Without = Annotated[
    list[str] | None, option("EFFECT", "Rig: switch an effect of the twin off; may be repeated.", "--without")
]


def prediction_request(
    pretension: str, amplitude: float, mode: str, without: list[str] | None, start: float | None, stop: float | None
) -> "PredictionRequest":
    """Return what the options ask of a rig. Raises SpecError where one of them cannot be meant."""
    check_choice("--mode", mode, MODES)
    pretensions = number_list("--pretension-mm", pretension, "zero or more: cables cannot push", low=0)
    check_angle("--amplitude-deg", amplitude)
    band_hz = checked_band((_BAND_HZ[0] if start is None else start, _BAND_HZ[1] if stop is None else stop))
    from sinew.predict.predicted import PredictionRequest

    return PredictionRequest(pretensions, amplitude, mode, tuple(without or ()), band_hz)


def check_angle(option: str, angle_deg: float) -> None:
    """Do nothing where an angle can be an amplitude; else raise SpecError."""
    checked_number(option, angle_deg, f"a positive angle up to {LARGEST_DEG:g}°", low=0, high=LARGEST_DEG, above=True)
