"""What an analysis answers, as types: a ring-down, a record of many frequencies, or a whole recording.

Numbers of rows are means over the repeats; an estimate has the standard deviation and the interval of that mean.

>>> import sinew as sn
>>> pose = sn.results.BentPose(bend_deg=20.0, azimuth_deg=90.0)
>>> pose.to_dict()
{'bend_deg': 20.0, 'azimuth_deg': 90.0}
"""

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated

import numpy as np
import xarray as xr

from sinew.analysis.decay.modes import DecayMode as DecayMode
from sinew.analysis.decay.ring_down import AmplitudeDependence as AmplitudeDependence
from sinew.analysis.decay.ring_down import IntervalParts as IntervalParts
from sinew.analysis.doubts import Doubt as Doubt
from sinew.analysis.poles import PoleFit
from sinew.analysis.poles import SpectrumMode as SpectrumMode
from sinew.analysis.tracked import Tracking as Tracking
from sinew.measure.estimate import Estimate, number
from sinew.measure.result import Column, Detail, Field, Result, Rows


@dataclass(frozen=True, repr=False)
class Analysed(Result):
    """What a recording says of its oscillation: a `RingDownResult`, a `SpectrumResult` or a `RecordingResult`.

    kind_reason: why a table was taken for what it is, where that was found out. recording: as it was analysed, its
    groups cut. dataset: by the result schema; None where all is in the fields. notes: what was done with the recording,
    or could not be, a sentence each.
    """

    _: KW_ONLY
    recording: xr.Dataset
    dataset: xr.Dataset | None = None
    notes: tuple[str, ...] = ()
    kind_reason: Annotated[str | None, Field("", "detail")] = None


# One ring-down of a table.


@dataclass(frozen=True, repr=False)
class PaperMethod(Result, title="paper's method (Eq. 7)"):
    """The paper's numbers of a decay, Eq. 7 with the damped frequency. withheld: why there are none, or empty."""

    decay_rate_per_s: Annotated[float | None, Field("decay rate")]
    omega_rad_s: Annotated[float | None, Field("angular frequency")]
    lehr_damping: Annotated[float | None, Field("Lehr's damping")]
    withheld: Annotated[str, Field("the paper's method (Eq. 7) is withheld", "sentence")]


@dataclass(frozen=True, repr=False)
class RingDownResult(Analysed, kind="ring-down", title="ring-down, direct fit"):
    """A free decay, see `sinew.analysis.decay.ring_down.RingDown`. unit: of the response."""

    frequency_hz: Annotated[Estimate, Field("frequency")]
    damping_ratio: Annotated[Estimate, Field("damping ratio")]
    decay_rate_per_s: Annotated[Estimate, Field("decay rate")]
    interval_parts: Annotated[Mapping[str, IntervalParts], Field("", "detail")]
    misfit: Annotated[str, Field("of these intervals", "sentence")]
    paper_method: Annotated[PaperMethod, Field("")]
    exponential: Annotated[bool, Field("exponential", "sentence")]
    reason: Annotated[str, Field("", "sentence")]
    rest_drift: Annotated[Estimate, Field("drift of the rest position", "sentence", "[unit]")]
    amplitude_dependence: Annotated[AmplitudeDependence, Field("", "detail")]
    start_s: Detail
    stop_s: Detail
    remarks: Annotated[tuple[str, ...], Field("", "detail")]
    modes: Annotated[Rows[DecayMode] | None, Field("modes of the decay, fitted together, the strongest first")] = None
    unit: str = "1"


# A record of many frequencies, or of hammer blows.


@dataclass(frozen=True, repr=False)
class Line(Result):
    """One line of a frequency response. gain, phase_lag_deg: by H1; fitted: of the modes, None outside their band."""

    frequency_hz: Annotated[float, Field("frequency")]
    gain: Annotated[Estimate, Field("gain")]
    phase_lag_deg: Annotated[Estimate, Field("phase lag")]
    gain_h2: Annotated[float | None, Field("gain by H2")]
    coherence: Annotated[float | None, Field("coherence")]
    fitted_gain: Annotated[float | None, Field("gain of the modes")]
    fitted_phase_lag_deg: Annotated[float | None, Field("lag of the modes")]


@dataclass(frozen=True, repr=False)
class HitResult(Result):
    """One hammer blow. force: its peak; width_s: of its pulse; remark: why it is not used."""

    time_s: Annotated[float, Field("hit at")]
    force: Annotated[float | None, Field("force", unit="[drive_unit]")]
    width_s: Annotated[float, Field("width")]
    used: Annotated[bool, Field("used")]
    remark: Annotated[str, Field("", "detail")]


@dataclass(frozen=True, repr=False)
class Window(Result):
    """Windows behind a hit: of the force [s], and the decay that the exponential one adds [1/s]."""

    force_s: Detail
    decay_per_s: Detail


@dataclass(frozen=True, repr=False)
class SpectrumResult(Analysed, title="frequency response H1"):
    """A frequency response by segments, periods or hits, with the modes in a band.

    segment_s: length of what was averaged; period_s: of a drive that repeats itself. covariance: of (natural frequency,
    damping ratio) of each mode in turn. misfit: of the modes, in standard deviations of the lines.
    """

    response_unit: Annotated[str, Field("", "detail")]
    drive_unit: Annotated[str, Field("", "detail")]
    segment_s: Annotated[float, Field("segment")]
    averages: Annotated[float, Field("averages")]
    band_hz: Annotated[tuple[float, float], Field("band of the modes")]
    modes: Annotated[Rows[SpectrumMode], Field("modes, by the poles of H1")]
    covariance: Column
    misfit: Detail
    frequency_response: Annotated[Rows[Line], Field("", "detail")]
    fit: PoleFit | None = field(default=None, kw_only=True)

    @property
    def median_coherence(self) -> float | None:
        """Return the median coherence of the lines in the band; None of a single hit."""
        low, high = self.band_hz
        inside = [line.coherence for line in self.frequency_response if low <= line.frequency_hz <= high]
        known = [one for one in inside if one is not None]
        return float(np.median(known)) if known else None

    def closing(self) -> list[str]:
        """Return how well drive and response cohere."""
        if self.median_coherence is None:
            return ["no coherence of a single hit"]
        return [f"median coherence in the band: {number(self.median_coherence)}"]


@dataclass(frozen=True, repr=False)
class BroadbandResult(SpectrumResult, kind="broadband"):
    """A record whose drive holds many frequencies: chirp, noise, multisine."""

    period_s: Detail


@dataclass(frozen=True, repr=False)
class ImpactResult(SpectrumResult, kind="impact"):
    """A record of hammer blows."""

    window: Annotated[Window, Field("", "detail")]
    hits: Annotated[Rows[HitResult], Field("hits")]


# A whole recording: sweep, resonance, energy, ring-downs, and what a head that bends has to tell.


@dataclass(frozen=True, repr=False)
class ResponseRow(Result):
    """One steady state. gain_std: of its mean; settled: whether every repeat was."""

    pretension_mm: Annotated[float, Field("pretension")]
    frequency_hz: Annotated[float, Field("frequency")]
    repeats: Annotated[int, Field("", "detail")]
    gain: Annotated[float | None, Field("gain")]
    gain_harmonic: Detail
    amplitude_rad: Detail
    amplitude_peaks_rad: Detail
    drive_amplitude_rad: Detail
    distortion: Detail
    drive_distortion: Detail
    drift_per_period: Detail
    saturated_share: Detail
    drive_current_rms_a: Detail
    gain_std: Detail
    gain_measured_drive: Annotated[Estimate, Field("gain, measured drive")]
    phase_lag_deg: Annotated[Estimate, Field("phase lag")]
    settled: Annotated[bool, Field("settled")]


_Quantity = Annotated[Estimate, Field("", "detail")]


@dataclass(frozen=True, repr=False)
class ResonanceRow(Result):
    """The resonance at a pretension in its several meanings, see `sinew.analysis.sweep.resonance.MEANINGS`."""

    pretension_mm: Annotated[float, Field("pretension")]
    paper_resonance_hz: _Quantity
    paper_gain_peak: _Quantity
    resonance_hz: Annotated[Estimate, Field("resonance (90 %)", "interval")]
    gain_peak: Annotated[Estimate, Field("peak gain")]
    resonance_measured_drive_hz: _Quantity
    gain_peak_measured_drive: _Quantity
    phase_90_hz: Annotated[Estimate, Field("lag of 90°")]
    half_power_width_hz: Annotated[Estimate, Field("half-power")]
    drive_amplitude_at_resonance_rad: _Quantity


@dataclass(frozen=True, repr=False)
class EnergyRow(Result):
    """What a swing costs at a pretension, see `sinew.analysis.sweep.energy`."""

    pretension_mm: Annotated[float, Field("p")]
    drive_power_at_resonance_w: Annotated[Estimate, Field("drive")]
    copper_at_resonance_w: _Quantity
    gear_at_resonance_w: _Quantity
    mechanical_at_resonance_w: _Quantity
    holding_at_resonance_w: Annotated[Estimate, Field("tendons")]
    rest_power_w: _Quantity
    energy_per_cycle_at_resonance_j: _Quantity
    swing_cost_at_resonance_j_rad2: Annotated[Estimate, Field("cost")]
    trend_cost_at_resonance_j_rad2: _Quantity
    energy_reduction: Annotated[Estimate, Field("reduction", unit="%")]
    energy_reduction_with_holding: Annotated[Estimate, Field("with tendons", unit="%")]
    current_reduction: _Quantity
    break_even_rad: _Quantity
    cheapest_hz: Annotated[Estimate, Field("cheapest")]
    swing_cost_at_cheapest_j_rad2: _Quantity
    cheapest_reduction: _Quantity
    line_current_a: _Quantity
    line_reduction: _Quantity


@dataclass(frozen=True, repr=False)
class EnergyResult(Result):
    """Energy over pretension. idle_power_w: of the servos with their torque off, by data sheet; None without a rig."""

    pretensions: Annotated[
        Rows[EnergyRow],
        Field("energy at resonance, per cycle and squared swing; its reduction against the trend"),
    ]
    idle_power_w: Annotated[
        float | None,
        Field("servos with their torque off, by data sheet, in none of these numbers", "sentence"),
    ]


@dataclass(frozen=True, repr=False)
class DecayRow(Result):
    """The ring-downs at a pretension, None where none could be read. excitation: of a decay in bending.

    misfit: how far one number describes each decay, the root mean square over the repeats.
    """

    excitation: Annotated[str | None, Field("excitation")] = None
    pretension_mm: Annotated[float, Field("pretension")] = np.nan
    decay_frequency_hz: Annotated[Estimate | None, Field("frequency")] = None
    decay_rate_per_s: Annotated[Estimate | None, Field("decay rate")] = None
    damping_ratio: Annotated[Estimate | None, Field("damping ratio")] = None
    paper_decay_rate_per_s: Annotated[Estimate | None, Field("paper's rate")] = None
    decay_frequency_misfit_hz: Detail = None
    decay_rate_misfit_per_s: Detail = None
    damping_ratio_misfit: Detail = None


@dataclass(frozen=True, repr=False)
class CouplingRow(Result):
    """One channel of a bent head at a steady state: torsion, out-of-plane or in-plane."""

    pretension_mm: Annotated[float, Field("p")]
    frequency_hz: Annotated[float, Field("f")]
    channel: Annotated[str, Field("channel")]
    repeats: Annotated[int, Field("", "detail")]
    amplitude_deg: Annotated[Estimate, Field("amplitude")]
    phase_lag_deg: _Quantity
    second_harmonic_deg: Annotated[Estimate, Field("at 2f")]
    mean_deg: Detail
    gain: Annotated[Estimate | None, Field("", "detail")] = None
    gain_rad_mm: Annotated[Estimate | None, Field("", "detail")] = None
    coupling_ratio: Annotated[Estimate | None, Field("to torsion")] = None
    lag_behind_torsion_deg: Annotated[Estimate | None, Field("lag behind torsion")] = None


@dataclass(frozen=True, repr=False)
class BentPose(Result, title="pose"):
    """The pose of a head that bends: angle, and its direction."""

    bend_deg: Annotated[float, Field("bend")]
    azimuth_deg: Annotated[float, Field("azimuth")]


@dataclass(frozen=True, repr=False)
class RecordingResult(Analysed, kind="recording"):
    """What a recording of Sinew holds; of a table with steady stretches `SweepResult`."""

    doubts: Annotated[Rows[Doubt], Field("", "doubt")] = field(default_factory=Rows)
    pose: Annotated[BentPose | None, Field("")] = None
    coupling_drive: Annotated[str | None, Field("coupling, driven by", "sentence")] = None
    coupling: Annotated[Rows[CouplingRow] | None, Field("coupling: torsion, tilt across the bend, in its plane")] = None
    sway_ring_down: Annotated[Rows[DecayRow] | None, Field("decays in bending: mean ± standard deviation of it")] = None
    response: Annotated[
        Rows[ResponseRow] | None,
        Field("sweep: mean over repeats ± standard deviation of it (everything: --json)"),
    ] = None
    resonance: Annotated[
        Rows[ResonanceRow] | None,
        Field("resonance: frequency of the largest fundamental, lag of 90°, half-power width"),
    ] = None
    energy: Annotated[EnergyResult | None, Field("")] = None
    tracking: Annotated[Tracking | None, Field("")] = None
    ring_down: Annotated[Rows[DecayRow] | None, Field("ring-downs: mean ± standard deviation of it")] = None

    def closing(self) -> list[str]:
        """Return how far one frequency and one damping ratio describe the decays, where they do not."""
        return [said] if (said := misfit_of_decays(self.ring_down or ())) else []


@dataclass(frozen=True, repr=False)
class SweepResult(RecordingResult, kind="sweep"):
    """A table of steady stretches."""


def misfit_of_decays(rows: Sequence[DecayRow]) -> str:
    """Return a sentence on how far one frequency and one damping ratio describe decays; empty where they do."""
    parts = []
    for words, unit, misfits in (
        ("damping ratio", "", [row.damping_ratio_misfit for row in rows]),
        ("frequency", " Hz", [row.decay_frequency_misfit_hz for row in rows]),
    ):
        if (largest := max([one or 0.0 for one in misfits], default=0.0)) > 0:
            parts.append(f"{words} by up to ±{number(largest, 2)}{unit}")
    if not parts:
        return ""
    return (
        f"within a decay it is not one number: {' and '.join(parts)} (standard deviation); these means are over "
        "windows that begin alike, and compare with one another"
    )
