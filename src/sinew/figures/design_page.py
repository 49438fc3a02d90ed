"""This is where designed joints become one HTML page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sinew.figures.captions import Caption
from sinew.figures.page import picture, write_page
from sinew.figures.tables import Table

__all__ = ["write_design_page"]

_SIZES = [
    "proposal",
    "silicone",
    "length in mm",
    "circle in mm",
    "lever in kg m²",
    "envelope in mm",
    "energy in mJ",
    "tension in N",
]
_ENDS = [
    "proposal",
    "stride in Hz",
    "p in mm",
    "command in °",
    "yaw in °",
    "D",
    "tension in N",
    "drive in A",
    "twin in Hz",
    "off by",
]

_CAPTIONS = {
    "design_front": Caption(
        "What is traded",
        "Every joint that was computed exactly. Full marks are not dominated in energy, size and tension; numbers are "
        "the proposals.",
        "",
        "Drive energy over volume and over tension for the computed joints, proposals numbered.",
    ),
    "design_curves": Caption(
        "Proposals at both ends of the band",
        "Predicted torsion at the command of the proposal's plan; rings are where the full twin lags by 90°, at its "
        "peak's height.",
        "",
        "Torsion over frequency of each proposal at two pretensions.",
    ),
}


def write_design_page(
    path: Path,
    document: Mapping[str, Any],
    *,
    figures: Sequence[Path] = (),
    rebuild: str = "",
    origins: Sequence[tuple[str, str]] = (),
) -> Path:
    """Write the page of a document of `sinew design`, atomically, and return its path.

    figures: the PNGs among them are put into the page. rebuild: the command that makes all of this again.
    Raises FileError where the folder cannot be written.
    """
    target, proposals = document["target"], document["proposals"]
    low, high = target["stride_band_hz"]
    asked = f"±{target['yaw_deg']:g}° and {target['inertia_kg_m2']:g} kg m²"
    return write_page(
        path,
        "prediction.html",
        title="Joints for a gait",
        about=f"Resonant from {low:g} to {high:g} Hz with {asked}.",
        lead=" ".join(f"{sentence[:1].upper()}{sentence[1:]}." for sentence in document["sentences"]),
        tables=[
            Table(
                "Sizes",
                _SIZES,
                [_size_row(i, one) for i, one in enumerate(proposals, 1)],
                "Energy: electrical, a cycle.",
            ),
            Table(
                "Both ends of the band",
                _ENDS,
                [row for i, one in enumerate(proposals, 1) for row in _end_rows(i, one)],
                "",
            ),
        ],
        pictures=[picture(one, _CAPTIONS) for one in figures if one.suffix == ".png"],
        validity=[{"title": one["name"], "checks": one["validity"]} for one in proposals],
        rebuild=rebuild,
        origins=list(origins),
    )


def _size_row(number: int, one: Mapping[str, Any]) -> list[str]:
    return [
        f"{number}: {one['section']}",
        str(one["material"]),
        f"{one['length_mm']:g}",
        f"{one['tendon_circle_mm']:g}",
        f"{one['lever_inertia_kg_m2']:.4f}",
        f"{one['diameter_mm']:.0f} × {one['envelope_length_mm']:.0f}",
        f"{1e3 * one['energy_j']:.0f}",
        f"{one['tension_n']:.0f}",
    ]


def _end_rows(number: int, one: Mapping[str, Any]) -> list[list[str]]:
    rows = []
    for end, found in zip(one["ends"], one["confirmed"], strict=True):
        measured, error = found["measured_hz"]["value"], found["error"]
        rows.append(
            [
                str(number),
                f"{end['wanted_hz']:g}",
                f"{end['pretension_mm']:.2f}",
                f"{end['command_deg']:.1f}",
                f"{end['torsion_deg']:.2f}",
                f"{end['damping_ratio']:.4f}",
                f"{end['tension_n']:.0f}",
                f"{end['current_a']:.2f}",
                "-" if measured is None else f"{measured:.4f}",
                "-" if error is None else f"{error:+.1%}",
            ]
        )
    return rows
