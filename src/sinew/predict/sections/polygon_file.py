"""This is where the corners of a polygon are read from a text file."""

from pathlib import Path

import numpy as np

from sinew.measure.errors import FileError
from sinew.predict.sections.outline import Outline, outline

__all__ = ["read_polygon"]


def read_polygon(path: Path) -> Outline:
    """Return the outline in a file of one corner a line, x and y in mm with a comma, semicolon or blank between them.

    The first ring is the outer one; after an empty line each further ring is a hole. `#` begins a comment.
    Raises FileError where a line is no pair of numbers, SpecError where the rings make no section.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"cannot read {path}: {error}; expected a text file with x,y of one corner a line") from error
    rings: list[list[tuple[float, float]]] = [[]]
    for number, line in enumerate(lines, start=1):
        if line.lstrip().startswith("#"):
            continue
        words = line.split("#")[0].replace(",", " ").replace(";", " ").split()
        if not words:
            rings.append([])
            continue
        try:
            x, y = map(float, words)
        except ValueError as error:
            raise FileError(f"{path}, line {number}: found {line.strip()!r}, expected x and y in mm") from error
        rings[-1].append((1e-3 * x, 1e-3 * y))
    filled = [np.array(ring) for ring in rings if ring]
    if not filled:
        raise FileError(f"{path} holds no corners; expected x,y in mm of one corner a line")
    return outline(filled[0], filled[1:])
