"""This is where a template becomes one HTML page that needs nothing beside itself."""

import base64
import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from sinew.figures.captions import Caption
from sinew.figures.tables import fixed, number
from sinew.measure.netcdf import write_atomically

__all__ = ["picture", "write_page"]


@functools.cache
def _environment() -> Environment:
    loader = FileSystemLoader(Path(__file__).parent / "templates")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"number": number, "fixed": fixed}
    return environment


def write_page(path: Path, template: str, **context: Any) -> Path:
    """Write a template with what it is given, atomically, and return the path.

    Raises FileError where the folder cannot be written.
    """
    content = _environment().get_template(template).render(**context).encode("utf-8")

    def write(temporary: Path) -> None:
        temporary.write_bytes(content)

    write_atomically(path, write)
    return path


def picture(path: Path, captions: Mapping[str, Caption]) -> dict[str, Any]:
    """Return name, caption and base64 text of a PNG file, as the templates take them."""
    name = path.stem
    caption = captions.get(name, Caption(name.replace("_", " "), "", "", name.replace("_", " ")))
    return {"name": name, "caption": caption, "data": base64.b64encode(path.read_bytes()).decode("ascii")}
