"""Pictures of README and docs, taken from the figures of `make reproduce`.

`python tools/copy_pictures.py out/reproduce/figures docs/pictures` copies each figure that a page shows, as PNG, under
the name by which the pages know it; a film beside them, `figures/sweep.webp`, is made small enough for a front page.
`make pictures` runs all of it.
"""

import shutil
import sys
from pathlib import Path

from PIL import Image, ImageSequence

# name in docs/pictures -> name in the figures folder
PICTURES = {"resonance.png": "figure06_response.png"}


def copy_pictures(figures: Path, pictures: Path) -> list[Path]:
    """Copy every picture that the pages show and return the new paths.

    figures: folder that `sinew reproduce` wrote; pictures: folder to copy to, made where absent.
    Raises FileNotFoundError where a figure is missing.
    """
    pictures.mkdir(parents=True, exist_ok=True)
    return [Path(shutil.copyfile(figures / source, pictures / name)) for name, source in PICTURES.items()]


def shrink_film(film: Path, out: Path) -> Path:
    """Write every second picture of a film (WebP) at 600 pixels of width and a low quality, and return its path."""
    with Image.open(film) as moving:
        wait = 2 * (moving.info.get("duration") or 50)
        size = (600, round(600 * moving.height / moving.width))
        first, *others = (frame.convert("RGB").resize(size) for frame in ImageSequence.Iterator(moving))
        others = others[1::2]
    first.save(out, save_all=True, append_images=others, duration=wait, loop=0, quality=30, method=4)
    return out


def main(arguments: list[str]) -> int:
    """Copy from the first folder to the second; return the exit status."""
    if len(arguments) != 2:
        print("usage: copy_pictures.py FIGURES PICTURES", file=sys.stderr)
        return 2
    try:
        for path in copy_pictures(Path(arguments[0]), Path(arguments[1])):
            print(path)
        if (film := Path(arguments[0]) / "sweep.webp").is_file():
            print(shrink_film(film, Path(arguments[1]) / film.name))
    except FileNotFoundError as error:
        print(f"copy_pictures: no figure {error.filename}; run `make reproduce` first", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
