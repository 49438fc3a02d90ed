"""This is where a silicone's name becomes its shear modulus."""

import difflib
import functools
import tomllib
from dataclasses import dataclass
from importlib.resources import files

from sinew.measure.errors import SpecError
from sinew.measure.estimate import Estimate

__all__ = ["Material", "list_materials", "load_material"]


@dataclass(frozen=True)
class Material:
    """A silicone. shear_modulus: at small strain [Pa]; its interval says how far fits of one curve differ.
    secant: at 100 % strain [Pa]."""

    name: str
    title: str
    shear_modulus: Estimate
    secant: float


@functools.cache
def _table() -> dict[str, Material]:
    text = files("sinew.predict.joints").joinpath("materials.toml").read_text(encoding="utf-8")
    return {
        name: Material(
            name,
            row["title"],
            Estimate.normal(1e3 * row["shear_modulus_kpa"], 1e3 * row["shear_modulus_std_kpa"]),
            1e3 * row["secant_kpa"],
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
