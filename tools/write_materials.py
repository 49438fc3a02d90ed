"""The table of silicones, made again from measured tensile curves.

`python tools/write_materials.py FOLDER` prints src/sinew/predict/materials.toml from a folder with the curves of
the Soft Robotics Materials Database; a test compares.
"""

import sys
from pathlib import Path

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from sinew.predict.design import fit_tensile, read_tensile

TITLES = ("Dragon Skin 10 Medium", "Dragon Skin 20", "Dragon Skin 30", "Ecoflex 00-30", "Ecoflex 00-50")

_HEAD = """\
# Silicones by name. Written by tools/write_materials.py from measured tensile curves; edit that, not this.
#
# Our numbers from the curves of: Marechal, Balland, Lindenroth, Petrou, Kontovounisios, Bello, "Towards a Common
# Framework and Database of Materials for Soft Robotics", Soft Robotics 2020, doi 10.1089/soro.2019.0115 (database:
# ODbL 1.0). ASTM D412, one specimen each, 450 mm/min (0.23 per second), crosshead strain, loading only.
#
# shear_modulus_kpa: neo-Hookean with slack, up to 30 % strain; E is three times it. shear_modulus_std_kpa: how far
# other fits of the same curve lie; how far specimens and batches differ is not in it. secant_kpa: the same law's
# modulus at 100 % strain. A curve of loading alone tells no loss factor.
"""


def materials_text(folder: Path) -> str:
    """Return the table as TOML, from the folder with the curves."""
    parts = [_HEAD]
    for title in TITLES:
        file = title.replace("Medium", "MEDIUM").replace(" ", "_") + ".csv"
        name = title.lower().removesuffix(" medium").replace(" ", "-")
        found = fit_tensile(*read_tensile(folder / file))
        modulus = found.shear_modulus_pa
        parts.append(
            f'\n[{name}]\ntitle = "{title}"\nshear_modulus_kpa = {modulus.value / 1e3:.1f}\n'
            f"shear_modulus_std_kpa = {modulus.std / 1e3:.1f}\nsecant_kpa = {found.secant_pa / 1e3:.1f}\n"
        )
    return "".join(parts)


def main() -> int:
    """Print the table."""
    if len(sys.argv) != 2:
        print("usage: python tools/write_materials.py FOLDER", file=sys.stderr)
        return 2
    sys.stdout.write(materials_text(Path(sys.argv[1])))
    return 0


if __name__ == "__main__":
    sys.exit(main())
