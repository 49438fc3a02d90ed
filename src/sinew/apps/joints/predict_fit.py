"""Options of `sinew predict` on a fit: levels of a drive and one measured point, in the units that they are said in."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from sinew.apps import console
from sinew.apps.console import option
from sinew.measure.errors import SpecError

if TYPE_CHECKING:
    from sinew.identify.forced import Forced, Kind, Mechanics

Torque = Annotated[
    str | None,
    option(
        "LEVEL,...[:UNIT]", "Oscillator, fit: amplitude of what pushes; of a fit several.", "--torque", "--torque-n-m"
    ),
]
Base = Annotated[
    str | None,
    option(
        "LEVEL,...[:UNIT]",
        "Oscillator, fit: amplitude by which its base moves; of an angle in deg.",
        "--base",
        "--base-deg",
    ),
]
Point = Annotated[
    str | None,
    option(
        "HZ:AMPLITUDE[+-STD][:UNIT][@LEVEL]",
        "Fit: a measured steady motion, which gives the drive's gain; at the first level unless said.",
        "--through",
    ),
]
DRAWS = 100
"""Draws of the bands of a fit where nobody said."""

_POINT = re.compile(
    r"(?P<hertz>[^:@]+):(?P<size>[^:@]+?)(?:(?:\+-|±)(?P<std>[^:@]+))?(?::(?P<unit>[^@]+))?(?:@(?P<level>.+))?"
)


def is_fit(name: str | None) -> bool:
    """Return whether what is to be predicted is a fit's document, by its ending."""
    return name is not None and Path(name).suffix.lower() == ".json"


class AskedOfFit(NamedTuple):
    """What is asked of a fit, as it stands on the command line. start, stop: of the band [Hz]; bands: number of draws,
    seed: of them."""

    file: str
    torque: str | None
    base: str | None
    through: str | None
    start: float | None
    stop: float | None
    bands: int | None
    seed: int

    def words(self) -> list[str]:
        """Return the command's words that ask for the same again."""
        numbers = {"--from-hz": self.start, "--to-hz": self.stop}
        given = {"--torque": self.torque, "--base": self.base, "--through": self.through}
        given |= {name: f"{value:g}" for name, value in numbers.items() if value is not None}
        given |= {"--bands": str(self.bands or DRAWS), "--seed": str(self.seed)}
        return ["sinew", "predict", self.file, *(w for name, value in given.items() if value for w in (name, value))]


def predicted_fit(asked: AskedOfFit) -> "Forced":
    """Return the forced response. Raises SinewError where something cannot be meant."""
    from sinew.identify.forced import Through, drive_shown, predict_fit, read_mechanics, shown_in

    known = read_mechanics(asked.file)
    if (asked.torque is None) == (asked.base is None):
        raise SpecError("say what drives it: --torque, the levels of what pushes, or --base, by how much that moves")
    name, text = ("--torque", asked.torque) if asked.torque is not None else ("--base", asked.base)
    assert text is not None
    words, _, unit = text.partition(":")
    levels = console.number_list(name, words, "positive amplitudes, as 0.1,0.2", low=0, above=True)
    kind: Kind = "torque" if asked.base is None else "base"
    drive = drive_shown(known, kind, unit.strip(), through=asked.through is not None)
    levels = [one / drive.factor for one in levels]
    point, motion = None, None
    if asked.through is not None:
        found = _point(asked.through)
        motion = shown_in(known.unit, (found["unit"] or "").strip() or known.unit_said)
        hertz, size = (_number(found[part]) for part in ("hertz", "size"))
        std = _number(found["std"]) if found["std"] else 0.0
        level = _number(found["level"]) / drive.factor if found["level"] else None
        point = Through(hertz, size / motion.factor, std / motion.factor, level)
    band = _band(known, asked.start, asked.stop)
    with console.progress_bar("draw") as progress:
        return predict_fit(
            known,
            torque=levels if asked.torque is not None else None,
            base=levels if asked.base is not None else None,
            through=point,
            band_hz=band,
            draws=asked.bands or DRAWS,
            seed=asked.seed,
            motion=motion,
            drive=drive,
            progress=progress,
        )


def _point(text: str) -> "re.Match[str]":
    found = _POINT.fullmatch(text.strip())
    if found is None:
        raise SpecError(f"--through is {text!r}, expected HZ:AMPLITUDE, as 3.1:12+-0.2:deg@0.5")
    return found


def _number(text: str) -> float:
    return console.number_list("--through", text.strip(), "a positive number", between="\n", low=0)[0]


def _band(known: "Mechanics", start: float | None, stop: float | None) -> tuple[float, float] | None:
    from math import pi, sqrt

    if start is None and stop is None:
        return None
    natural = sqrt(max(known.value("stiffness"), 0.0)) / (2 * pi)
    return console.checked_band((natural / 3 if start is None else start, 2 * natural if stop is None else stop))


def write_forced(found: "Forced", document: dict[str, Any], folder: Path, rebuild: str) -> Path:
    """Write prediction.json, figures and prediction.html into a folder; return the page."""
    from sinew.figures.predicted import draw_forced, write_forced_page
    from sinew.figures.style import save_figure
    from sinew.measure.files.netcdf import provenance

    paths = list(save_figure(draw_forced(found), folder / "figures", "forced_response", ("png", "pdf")))
    console.write_json(document, folder / "prediction.json")
    origins = [("versions", str(provenance("import")["versions"]))]
    return write_forced_page(folder / "prediction.html", document, figures=paths, rebuild=rebuild, origins=origins)
