"""This is where the answer of an analysis becomes the tables that a person reads, at most 100 columns wide."""

from typing import TYPE_CHECKING, Any

from sinew.apps.console import print_table
from sinew.measure.estimate import number, pair, shown, shown_interval, span

if TYPE_CHECKING:
    import xarray as xr


def print_analysis(document: dict[str, Any], recording: "xr.Dataset", results: "xr.Dataset | None") -> None:
    """Print the document of `sinew analyse` as tables on stdout.

    results: of the recording, for what the table of a sweep shows beside the document; None for a single ring-down.
    """
    for one in document.get("doubts", []):
        print(f"DOUBT: {one['sentence']}")
    if document["kind"] == "ring-down":
        _print_ring_down(document, recording)
        return
    if document.get("response") and results is not None:
        _print_response(document["response"], results)
    if document.get("resonance"):
        _print_resonance(document["resonance"])
    if document.get("energy"):
        _print_energy(document["energy"])
    if document.get("ring_down"):
        rows = [
            [number(row["pretension_mm"]), *(shown(row.get(key)) for key in _DECAY)] for row in document["ring_down"]
        ]
        print_table(("pretension/mm", *_DECAY.values()), rows, "ring-downs: mean ± standard deviation of it")


_DECAY = {
    "decay_frequency_hz": "frequency/Hz",
    "decay_rate_per_s": "decay rate/(1/s)",
    "damping_ratio": "damping ratio",
    "paper_decay_rate_per_s": "paper's rate/(1/s)",
}


def _print_response(rows: list[dict[str, Any]], results: "xr.Dataset") -> None:
    """Print the essential columns of a sweep; all others are in the JSON document."""
    import numpy as np

    from sinew.analysis.signal.repeats import combine_repeats

    gain = results["gain"].values
    scatter = combine_repeats(gain, np.full(gain.shape, np.nan)).std_of_value
    where = {
        (float(p), float(f)): scatter[i, j]
        for i, p in enumerate(results["pretension_mm"].values)
        for j, f in enumerate(results["frequency_hz"].values)
    }
    cells = [
        (
            number(row["pretension_mm"]),
            number(row["frequency_hz"]),
            pair(row["gain"], where[row["pretension_mm"], row["frequency_hz"]]),
            shown(row["gain_measured_drive"]),
            shown(row["phase_lag_deg"]),
            "yes" if row["settled"] else "no",
        )
        for row in rows
    ]
    names = ("pretension/mm", "frequency/Hz", "gain", "gain, measured drive", "phase lag/°", "settled")
    print_table(names, cells, "sweep: mean over repeats ± standard deviation of it (everything: --json)")


def _print_resonance(rows: list[dict[str, Any]]) -> None:
    cells = []
    for row in rows:
        cells.append(
            (
                number(row["pretension_mm"]),
                shown_interval(row["resonance_hz"]),
                shown(row["gain_peak"]),
                shown(row["phase_90_hz"]),
                shown(row["half_power_width_hz"]),
            )
        )
    names = ("pretension/mm", "resonance/Hz (90 %)", "peak gain", "lag of 90°/Hz", "half-power/Hz")
    print_table(names, cells, "resonance: frequency of the largest fundamental, lag of 90°, half-power width")


def _print_energy(energy: dict[str, Any]) -> None:
    def percent(estimate: dict[str, Any]) -> str:
        value, std = (None if estimate[key] is None else 100 * estimate[key] for key in ("value", "std"))
        return pair(value, std)

    names = ("p/mm", "drive/W", "tendons/W", "J/rad²", "reduction/%", "with tendons/%", "cheapest/Hz")
    cells = [
        [
            number(row["pretension_mm"]),
            shown(row["drive_power_at_resonance_w"]),
            shown(row["holding_at_resonance_w"]),
            shown(row["swing_cost_at_resonance_j_rad2"]),
            percent(row["energy_reduction"]),
            percent(row["energy_reduction_with_holding"]),
            shown(row["cheapest_hz"]),
        ]
        for row in energy["pretensions"]
    ]
    print_table(names, cells, "energy at resonance, per cycle and squared swing; its reduction against the trend")
    if energy["idle_power_w"] is not None:
        idle = number(energy["idle_power_w"], unit="W")
        print(f"servos with their torque off: {idle} by data sheet, in none of these numbers")


def _print_ring_down(document: dict[str, Any], recording: "xr.Dataset") -> None:
    print_table(
        ("ring-down, direct fit", "value ± std", "90 % interval"),
        [
            (label, shown(document[key]), span(*document[key]["interval90"]))
            for label, key in (
                ("frequency/Hz", "frequency_hz"),
                ("damping ratio", "damping_ratio"),
                ("decay rate/(1/s)", "decay_rate_per_s"),
            )
        ],
    )
    paper = document["paper_method"]
    print_table(("paper's method (Eq. 7)", "value"), [(key, number(value)) for key, value in paper.items()])
    name = "torsion_rad" if "torsion_rad" in recording else "response"
    print(f"exponential: {'yes' if document['exponential'] else 'no'}. {document['reason']}")
    print(f"drift of the rest position: {number(document['rest_drift'])} {recording[name].attrs['units']}")
