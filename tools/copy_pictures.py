"""Pictures of README and docs, taken from the figures of `make reproduce`.

`python tools/copy_pictures.py out/reproduce/figures docs/pictures` copies each figure that a page shows, as PNG, under
the name by which the pages know it. `make pictures` runs both commands.
"""

import shutil
import sys
from pathlib import Path

# name in docs/pictures -> name in the figures folder
PICTURES = {"resonance.png": "figure06_response.png"}


def copy_pictures(figures: Path, pictures: Path) -> list[Path]:
    """Copy every picture that the pages show and return the new paths.

    figures: folder that `sinew reproduce` wrote; pictures: folder to copy to, made where absent.
    Raises FileNotFoundError where a figure is missing.
    """
    pictures.mkdir(parents=True, exist_ok=True)
    return [Path(shutil.copyfile(figures / source, pictures / name)) for name, source in PICTURES.items()]


def main(arguments: list[str]) -> int:
    """Copy from the first folder to the second; return the exit status."""
    if len(arguments) != 2:
        print("usage: copy_pictures.py FIGURES PICTURES", file=sys.stderr)
        return 2
    try:
        for path in copy_pictures(Path(arguments[0]), Path(arguments[1])):
            print(path)
    except FileNotFoundError as error:
        print(f"copy_pictures: no figure {error.filename}; run `make reproduce` first", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
