"""One HTML page, from a template, that needs nothing beside itself."""

import base64
import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from sinew.figures.tables import fixed, number
from sinew.measure.files.netcdf import write_text

# Each figure gets its words: title, what to see, what the paper shows there, and what it looks like.


@dataclass(frozen=True)
class Caption:
    """The words of one figure.

    title: for a heading. see: what is drawn. alt: what somebody hears who cannot see it.
    paper: what the paper shows there, or why the figure is added.
    """

    title: str
    see: str
    alt: str
    paper: str = ""


CAPTIONS = {
    "figure05_drive_groups": Caption(
        "Figure 5: driving oscillation",
        "(a) The first sweep as it was driven, at the pretension in its title: each group settles (grey) and is then "
        "recorded (colour). The numbers are frequencies, the dotted lines the nominal amplitude. (b) to (d) Three "
        "groups close up: commanded (dashed), settling (grey) and recorded (blue).",
        "Drive angle over time for one whole sweep, and close-ups of three frequency groups, commanded and measured.",
        "The paper drives groups of five periods at constant nominal amplitude, each after 3 s of settling.",
    ),
    "figure06_response": Caption(
        "Figure 6: amplitude response and phase difference",
        "(a) Mean of the torsion's peaks over the nominal drive amplitude (Eq. 6). (b) Lag of the torsion behind the "
        "drive. Lines are means over the repeats, tubes ±1 standard deviation, often thinner than the line; colour is "
        "pretension; rings mark the resonance at each pretension, dashed lines a gain of one and a lag of 90°.",
        "Two panels over drive frequency, a line with a tube for each pretension: gain on the left, lag on the right.",
        "The paper finds the resonance rising from 3 to 4.3 Hz while the gain falls from 2.8 to 1.4, and a lag of 90° "
        "at resonance.",
    ),
    "figure07_lissajous": Caption(
        "Figure 7: Lissajous curves",
        "Middle: measured torsion over measured drive, a colour for each frequency; dotted lines mark the nominal "
        "drive amplitude, the dashed line is the ellipse fitted to the curve whose lag is closest to 90°. "
        "Left and right: the ideal shapes for lags of 0 to 180°, at equal amplitudes.",
        "Closed curves of torsion over drive angle at several frequencies, between schematic ellipses for five lags.",
        "The paper shows p = 4 mm: a rising line opens to an ellipse and closes again to a falling one, and the curves "
        "become narrower at high frequency, where the drive does not reach its amplitude.",
    ),
    "figure08_map": Caption(
        "Figure 8: response map",
        "(a) Gain as a surface over frequency and pretension. (b) The same from above, with lines of equal gain. The "
        "red line is the ridge, the resonance at each pretension. Between measured points the surface follows the "
        "ridge and does not overshoot.",
        "A surface of gain over frequency and pretension, and its view from above with a red line along the ridge.",
        "In the paper the ridge moves to higher frequency and lower gain as pretension rises.",
    ),
    "figure09_decay": Caption(
        "Figure 9: free decay",
        "(a) The drive stops at its zero crossing and the joint swings freely. (b) The free decay, its positive and "
        "negative peaks, the fitted envelope, and the quantities that follow (Eq. 7 to 10).",
        "Drive and torsion over time around the stop of the drive, and the decaying torsion inside its envelope.",
        "The paper shows the same without pretension and derives λ, ⟨ω⟩ and D from the envelope.",
    ),
    "figure10_damping": Caption(
        "Figure 10: damping over pretension",
        "(a) to (c) Decay coefficient, angular frequency and Lehr's damping, mean ± standard deviation over the "
        "repeats: by the paper's peak method (dots) and by a direct fit in the time domain (squares). Below: measured "
        "decays (grey) under the linear second-order model with the same λ and ⟨ω⟩ (green).",
        "Three panels of damping quantities over pretension, above small panels of decays with the linear model.",
        "In the paper λ and ⟨ω⟩ rise with pretension while D stays about constant.",
    ),
    "drive_amplitude": Caption(
        "Drive amplitude",
        "Measured drive amplitude over frequency at each pretension. The dotted line is the nominal amplitude, rings "
        "mark the resonance. Red, where the rig is known: along the dashed line a sine has the motor's no-load speed "
        "ω₀ as its peak speed, amplitude ω₀/(2πf). A saturated drive runs nearly a triangle, at ω₀ all the time: its "
        "peak ω₀/(4f) is π/2 times higher, its fundamental, which is what is measured here, 4/π times (dash-dotted).",
        "Measured drive amplitude over frequency, a line for each pretension, with the nominal amplitude dotted.",
        "The paper reports that the amplitude falls as frequency rises and leaves open whether the drive or the joint "
        "limits the gain; this figure is added for that question.",
    ),
    "energy": Caption(
        "Energy",
        "(a) Electrical power of the drive (duty, current and voltage of its servo) as it was driven; rings mark the "
        "resonance. (b) The same per cycle and per squared torsion amplitude: what a swing of the head costs. Dashed: "
        "the trend, which spring and inertia would need if neither helped the other; the arrow is the reduction at "
        "resonance, the triangle the frequency of the cheapest swing. (c) Where the power at resonance goes, with "
        "the tendon motors and the electronics of all servos.",
        "Power of the drive over frequency, energy per swing over frequency with a trend line, and stacked bars of the "
        "power at resonance over pretension.",
        "The paper proposes the reduction of the motor's current at resonance, against its rise with frequency, as a "
        "measure of the energy saved, and leaves it to future work (section 5.3).",
    ),
    "phase_portraits": Caption(
        "Phase portraits at resonance",
        "Torsion rate over torsion during the recorded periods at resonance. The dashed ellipse is a harmonic "
        "oscillation of the same frequency and amplitude. Above: the torsion's harmonics as a share of its "
        "fundamental; even ones bend the portrait to one side, the third squeezes it evenly.",
        "Closed curves of torsion rate over torsion at resonance, each with a dashed ellipse, for some pretensions.",
        "The paper expects anharmonicity to show as an asymmetry here (section 5.2.3) and leaves it to its video.",
    ),
}
"""By the name of the figure's files, in the order of the paper."""


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
    write_text(path, _environment().get_template(template).render(**context))
    return path


def picture(path: Path, captions: Mapping[str, Caption]) -> dict[str, Any]:
    """Return name, caption and base64 text of a PNG file, as the templates take them."""
    name = path.stem
    caption = captions.get(
        name,
        Caption(
            name.replace("_", " "),
            "",
            name.replace("_", " "),
        ),
    )
    return {"name": name, "caption": caption, "data": base64.b64encode(path.read_bytes()).decode("ascii")}
