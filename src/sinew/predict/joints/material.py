"""Silicones: the shear modulus of one by its name, or by a measured tensile curve."""

import difflib
import functools
import tomllib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import numpy as np
from scipy.optimize import least_squares

from sinew.measure.arrays import Array
from sinew.measure.errors import FileError, RecordingError, SpecError, UnitError
from sinew.measure.estimate import Estimate
from sinew.measure.files.names import find_columns, unit_in_name
from sinew.measure.read import numbers, read_table
from sinew.measure.result import Field, Result
from sinew.measure.units import convert


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
    text = files("sinew.predict.joints").joinpath("materials.toml").read_text(encoding="utf-8")
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
