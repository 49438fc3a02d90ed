"""The price of following a gait: `python -m campaigns.following`.

The emulated bench follows a commanded stride frequency across the band in 30 s, once up and once down. The energy of
the drive and of the tendon motors is taken from the recording's duty, current and voltage, turn by turn. Beside it: the
same motion of the head, frequency and swing, would take with one fixed pretension, and with the pretension at which a
swing of that frequency is cheapest, by the map of the paper's campaign on the twin. Whether the drive could swing the
head so far there is another question: counted is in how many turns the campaign's drive, told 20°, did.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.interpolate import RegularGridInterpolator

from campaigns.energy import paper_sweep
from campaigns.motion_energy import MotionEnergy, energy_between, energy_per_cycle
from campaigns.tracked import track_plan, tracked
from campaigns.tracking import expected_at
from sinew.analysis.analysed import analyse_recording
from sinew.analysis.signal.power import read_power
from sinew.analysis.signal.signals import read_signals
from sinew.analysis.tracked import tracked_turns
from sinew.measure.arrays import Array
from sinew.measure.recording import segment_slices
from sinew.plan.rig import RigSpec
from sinew.plan.toml import load_rig
from sinew.tune.track import ExpectedBackbone
from sinew.twin.simulate import simulate

FIXED_MM = (0.0, 3.0, 6.0, 9.0, 12.0)
BAND_HZ, LASTS_S = (3.1, 4.15), 30.0
_LEAD_S, _NEARLY = 7.0, 0.97


@dataclass(frozen=True)
class Followed:
    """One way across the band. turns: of `tracked_turns`, with drive_j and holding_j, what each turn took [J].

    By the map, with the share of the turns that the drive can make: tuned, with the pretensions as they were; cheapest,
    with those at which each frequency is cheapest; fixed, with one, by pretension [mm].
    """

    name: str
    turns: xr.Dataset
    tuned: tuple[MotionEnergy, float]
    cheapest: tuple[MotionEnergy, float]
    fixed: dict[float, tuple[MotionEnergy, float]]

    @property
    def measured_j(self) -> tuple[float, float]:
        """Return what a turn took in the recording, in the mean [J]: the drive, the tendon motors."""
        return float(self.turns["drive_j"].mean()), float(self.turns["holding_j"].mean())


def campaign_map(rig: RigSpec, seed: int = 0) -> xr.Dataset:
    """Return the results of the paper's sweep on the twin."""
    return analyse_recording(simulate(paper_sweep(), rig, seed=seed), rig)


def _turns(recording: xr.Dataset, rig: RigSpec) -> xr.Dataset:
    """Return the turns of the moving part with what each took."""
    (segment,) = np.flatnonzero(recording["kind"].values == "tracking").tolist()
    turns = tracked_turns(recording, segment, rig)
    where = segment_slices(recording)[segment]
    time = recording["time_s"].values[where] - recording["time_s"].values[where.start]
    half = 0.5 / turns["frequency_hz"].values
    edges = np.stack([turns["time_s"].values - half, turns["time_s"].values + half], axis=1)
    power = read_power(read_signals(recording, rig))
    assert power is not None
    assert power.holding is not None
    for name, watts in (("drive_j", power.drive), ("holding_j", power.holding)):
        turns[name] = ("turn", [float(energy_between(time, watts[where], edge)[0]) for edge in edges])
    moving = (turns["time_s"] >= _LEAD_S) & (turns["time_s"] <= _LEAD_S + LASTS_S)
    return turns.isel(turn=np.flatnonzero(moving.values))


def follow(
    expected: Sequence[ExpectedBackbone], campaign: xr.Dataset, rig: RigSpec, *, up: bool, seed: int = 0
) -> Followed:
    """Return one way across the band, of the paper's command.

    expected: of pretensions from one end of the range to the other. campaign: see `campaign_map`.
    """
    band, ends = BAND_HZ, (expected[0].pretension_mm, expected[-1].pretension_mm)
    if not up:
        band, ends = band[::-1], ends[::-1]
    plan = track_plan(ends[0], None, LASTS_S, pretension_to_mm=ends[1], wanted_hz=band, lead_s=_LEAD_S)
    recording = tracked(plan, expected, seed=seed).recording
    assert recording is not None
    turns = _turns(recording, rig)
    frequency, swing = turns["frequency_hz"].values, turns["torsion_rad"].values
    known = np.isfinite(campaign["cheapest_hz"].values)
    best = np.interp(frequency, campaign["cheapest_hz"].values[known], campaign["pretension_mm"].values[known])

    def at(pretension_mm: Array | float) -> tuple[MotionEnergy, float]:
        found = energy_per_cycle(campaign, frequency, pretension_mm, swing)
        return found, _reached(campaign, frequency, pretension_mm, swing)

    name = f"{band[0]:g} to {band[1]:g} Hz in {LASTS_S:g} s"
    return Followed(name, turns, at(turns["pretension_mm"].values), at(best), {mm: at(mm) for mm in FIXED_MM})


def _reached(campaign: xr.Dataset, frequency_hz: Array, pretension_mm: Array | float, swing: Array) -> float:
    """Return the share of turns in which the campaign's drive swings the head as far, within 3 %."""
    axes = (campaign["pretension_mm"].values, campaign["frequency_hz"].values)
    largest = RegularGridInterpolator(axes, campaign["amplitude_rad"].mean("repeat").values)
    points = np.stack([np.broadcast_to(pretension_mm, frequency_hz.shape), frequency_hz], axis=1)
    return float(np.mean(largest(points) >= _NEARLY * swing))


def table(ways: Sequence[Followed]) -> str:
    """Return energy per cycle as a Markdown table."""

    def cells(at: tuple[MotionEnergy, float]) -> str:
        found, reached = at
        numbers = (
            f"{found.drive.value:.2f} | {found.holding.value:.2f} | {found.total.value:.2f} ± {found.total.std:.2f}"
        )
        return f"{numbers} | {100 * reached:.0f} %"

    lines = [
        "| motion | pretension | drive/J | tendon motors/J | both/J | within the drive |",
        "|---|---|---|---|---|---|",
    ]
    for way in ways:
        drive, holding = way.measured_j
        lines.append(
            f"| {way.name} | follows, as recorded | {drive:.2f} | {holding:.2f} | {drive + holding:.2f} | 100 % |"
        )
        lines.append(f"| | follows, by the map | {cells(way.tuned)} |")
        lines.append(f"| | cheapest at each frequency | {cells(way.cheapest)} |")
        lines += [f"| | fixed at {mm:g} mm | {cells(found)} |" for mm, found in way.fixed.items()]
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> None:
    """Follow the band up and down and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="of the bench and the campaign")
    arguments = parser.parse_args(argv)
    rig = load_rig("paper")
    campaign = campaign_map(rig, arguments.seed)
    expected = expected_at((0.0, 3.0, 6.0, 9.0, 12.0))
    ways = [follow(expected, campaign, rig, up=up, seed=arguments.seed) for up in (True, False)]
    for way in ways:
        swing = np.degrees(way.turns["torsion_rad"].values)
        moved = way.turns["pretension_mm"].values
        print(f"{way.name}: {way.turns.sizes['turn']} turns, swing {swing.min():.1f} to {swing.max():.1f}°, ", end="")
        print(f"pretension {moved.min():.2f} to {moved.max():.2f} mm")
    print(table(ways))


if __name__ == "__main__":
    main()
