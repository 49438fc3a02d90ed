"""A record of hammer blows: the hits found and judged, their frequency response under windows, and the modes in it.

Force and response of a hit are multiplied by exp(-σt) from one moment on, which turns H(jω) into H(σ + jω) exactly: the
modes are fitted on that line of the s plane, so that the damping which the window adds is not in them. On the lines of
its own length a block that ends before the response has died changes residues and leaves poles; so does what is left of
the hit before.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
import xarray as xr
from numpy.typing import NDArray

from sinew.analysis.broadband import (
    FrequencyResponse,
    Segmentation,
    Spectra,
    band_of_modes,
    check_options,
    choose_modes,
    even_pieces,
    lines_in,
    refuse_empty,
    spectrum_result,
)
from sinew.analysis.decay.free_decay import noise_level
from sinew.analysis.poles import LineErrors, PoleFit, fit_poles
from sinew.analysis.results import HitResult, ImpactResult, Window
from sinew.analysis.signal.signals import overloads
from sinew.measure.arrays import Array, Complexes, Mask, robust_std
from sinew.measure.errors import RecordingError
from sinew.measure.estimate import finite, number
from sinew.measure.result import Rows

# Blows in a force: where it leaves its rest in one direction, and comes back.

_NOISE = 6.0  # times its noise: a force that leaves its rest
_SMALL = 0.02  # of the largest force: less is no blow
_EDGE = 0.02  # of a blow's top: where it begins and ends
_SINGLE = 0.5  # of a peak's height, by which it stands above its valleys: less is a ripple on a blow
_BOUNCE = 0.1  # of the largest pulse of a hit: a pulse as large as that makes it a double hit
_TOGETHER = 0.2  # of the mean time between strong pulses: pulses closer than that are one hit
_STRONG = 0.25  # of the largest force
_MOST_STRUCK = 0.3  # of the samples: a force that is on for longer is no row of blows


@dataclass(frozen=True)
class Blow:
    """A hit in a force: samples begin to end (not included), that of its largest force, and those of its pulses.

    width: samples of its largest pulse alone.
    """

    begin: int
    end: int
    top: int
    width: int
    pulses: tuple[int, ...]


def struck_force(drive: Array) -> tuple[Array, float]:
    """Return the force about its rest, positive in the direction in which it is largest, (n,), and its noise."""
    about = drive - np.median(drive)
    force = about if about.max() >= -about.min() else -about
    return np.asarray(force, dtype=float), max(robust_std(about), noise_level(drive))


def find_blows(drive: Array) -> list[Blow]:
    """Return the hits in a force, (n,), in order; pulses that follow each other closely are one hit."""
    force, noise = struck_force(drive)
    level = max(_NOISE * noise, _SMALL * float(force.max()))
    if not level > 0:
        return []
    tops, seen = scipy.signal.find_peaks(np.concatenate([[0.0], force, [0.0]]), height=level, prominence=level)
    tops = tops[seen["prominences"] >= _SINGLE * seen["peak_heights"]] - 1
    if not tops.size:
        return []
    strong = np.count_nonzero(force[tops] >= _STRONG * force[tops].max())
    apart = np.flatnonzero(np.diff(tops) > _TOGETHER * force.size / strong) + 1
    blows = []
    for pulses in np.split(tops, apart):
        top = int(pulses[np.argmax(force[pulses])])
        quiet = force < max(0.5 * _NOISE * noise, _EDGE * force[top])
        begin, end = _reach(quiet, int(pulses[0]), int(pulses[-1]))
        first, stop = _reach(quiet, top, top)
        real = tuple(int(k) for k in pulses if force[k] >= _BOUNCE * force[top])
        blows.append(Blow(begin, end, top, stop - first, real))
    return blows


def _reach(quiet: Mask, first: int, last: int) -> tuple[int, int]:
    """Return the samples [begin, end) around first and last up to where the force is quiet."""
    before, after = np.flatnonzero(quiet[:first]), np.flatnonzero(quiet[last:])
    return int(before[-1]) + 1 if before.size else 0, last + int(after[0]) if after.size else quiet.size


# Hits become blocks of one length under windows.

_LEFT = 0.05  # of a signal at the end of its block under the exponential window
_LENGTHS = 12.0  # time constants of the slowest mode: a longer block holds noise
_LONG_ENOUGH = 0.5  # of the median block: a hit with less behind it is left out
_FEWEST = 64  # samples of a block
_STILL_SWINGS = 0.1  # of the largest swing: more is left when the next hit comes
_SMOOTHED = 12  # lines to both sides over which the scatter between hits is averaged
_FLOOR = 0.1  # of the scatter: the response's own noise is at least that
_HEARD = 0.2  # relative standard deviation of a line that stands out of its noise
_SHOWN = 2.0  # times the end of the band: up to there lines are told


@dataclass(frozen=True)
class _Strike:
    """A hit with the samples from shortly before it up to the next one, its block.

    force, response: (n,), about their rest. window: of the force, (n,). force_noise: of one sample.
    is_cut: whether the response is overloaded in it; is_followed: whether another hit comes.
    """

    hit: HitResult
    force: Array
    response: Array
    window: Array
    force_noise: float
    is_cut: bool
    is_followed: bool


def analyse_impacts(
    recording: xr.Dataset,
    *,
    band_hz: tuple[float, float] | None = None,
    modes: int | None = None,
    segment_s: float | None = None,
) -> ImpactResult:
    """Return frequency response and modes of a recording of one hammer blow or several, drive and response beside.

    band_hz, modes: as of `sinew.analysis.broadband.analyse_broadband`. segment_s: length of the block behind
    each hit [s]; None for as much as all hits have, at most twelve time constants of the slowest mode in the band.

    The force outside its hit is taken for zero; an exponential window that falls to 5 % within the block is put on both
    signals, and its damping is not in the modes. Double hits, hits that a sensor could not follow, and those that begin
    or end with the record are left out as long as others remain. H1 and H2 are of sums over the hits. What a line's
    errors are comes from the scatter between hits, of one hit from the noise of the signals.
    Raises RecordingError where there is no drive, no hit or no response to it; SpecError for a band, a block or a
    number of modes that cannot be.
    """
    check_options(band_hz, modes, segment_s)
    pieces, sample_hz, units, notes = even_pieces(recording)
    strikes = _strikes(recording, pieces, sample_hz)
    used, hits, said = _judged(strikes)
    notes += said
    length = min(strike.force.size for strike in used)
    if segment_s is not None:
        length = min(length, round(segment_s * sample_hz))
    if length < _FEWEST:
        raise RecordingError(
            f"{length} samples behind a hit are too few, expected at least {_FEWEST}; record longer or faster, or wait "
            "longer between the hits"
        )
    notes += _of_rest(used, length)
    measured = _measure(used, length, sample_hz)
    band, fit, warned = _modes_of(measured, band_hz, modes)
    if fit is not None and segment_s is None:
        slowest = 2.0 * math.pi * min(m.natural_frequency_hz.value * m.damping_ratio.value for m in fit.modes)
        shorter = max(_FEWEST, round(_LENGTHS / slowest * sample_hz))
        if shorter < length:
            length = shorter
            measured = _measure(used, length, sample_hz)
            band, fit, warned = _modes_of(measured, band_hz, modes)
    if len(used) == 1:
        notes.append("one hit: there is no coherence, which compares hits, and H1 and H2 are one; hit several times")
    block, decay = length / sample_hz, measured.decay_per_s
    notes.append(
        f"the exponential window falls to {100 * _LEFT:.0f} % in {number(block, unit='s')}; the {number(decay)} 1/s "
        "that it adds to each decay are in the gains and not in the modes"
    )
    last_hz = _SHOWN * band[1]
    found = spectrum_result(recording, (*notes, *warned), measured.response, band, fit, units, last_hz)
    widest = max(int(np.count_nonzero(strike.window)) for strike in used)
    window = Window(min(widest, length) / sample_hz, decay)
    return ImpactResult(**{**vars(found), "segment_s": block}, window=window, hits=Rows(hits))


def _strikes(recording: xr.Dataset, pieces: Sequence[tuple[Array, Array]], sample_hz: float) -> list[_Strike]:
    """Return all hits with what is wrong with each."""
    sizes = recording["row_size"].values
    begins_s = recording["time_s"].values[np.cumsum(sizes) - sizes]
    whole, moved = (np.concatenate([piece[k] for piece in pieces]) for k in (0, 1))
    about = whole - np.median(whole)
    struck_side = about > 0 if about.max() >= -about.min() else about < 0
    edges = np.cumsum([drive.size for drive, _ in pieces])[:-1]
    cut = np.split(overloads(whole) & struck_side, edges), np.split(overloads(moved), edges)
    strikes: list[_Strike] = []
    for begin_s, (drive, response), of_force, of_response in zip(begins_s, pieces, *cut, strict=True):
        blows = find_blows(drive)
        struck = sum(blow.end - blow.begin for blow in blows)
        if struck > _MOST_STRUCK * drive.size:
            raise RecordingError(
                f"the drive is away from its rest for {100 * struck / drive.size:.0f} % of the time, expected short "
                "hits; a drive that goes on is of kind broadband or sweep"
            )
        guards = [max(4, blow.end - blow.begin) for blow in blows]
        begins = [max(0, blow.begin - guard) for blow, guard in zip(blows, guards, strict=True)]
        for blow, guard, block in zip(blows, guards, map(slice, begins, [*begins[1:], drive.size]), strict=True):
            faults = []
            if len(blow.pulses) > 1:
                apart_ms = 1000 * (blow.pulses[1] - blow.pulses[0]) / sample_hz
                faults.append(f"a double hit, {number(apart_ms, 2)} ms apart")
            if of_force[block].any():
                faults.append("overload, the force is cut off")
            if blow.begin == 0 and struck_force(drive)[0][0] > _BOUNCE * abs(drive[blow.top] - np.median(drive)):
                faults.append("the record begins within it")
            hit = HitResult(
                float(begin_s) + blow.top / sample_hz,
                finite(float(drive[blow.top] - np.median(drive))),
                blow.width / sample_hz,
                True,
                "; ".join(faults),
            )
            strikes.append(_strike(hit, blow.end, guard, block, drive, response, bool(of_response[block].any())))
    if not strikes:
        raise RecordingError(
            "found no hit in the drive: it does not leave its rest and come back; is it the right column? A drive that "
            "goes on is of kind broadband or sweep"
        )
    return strikes


def _strike(hit: HitResult, end: int, guard: int, block: slice, drive: Array, response: Array, is_cut: bool) -> _Strike:
    """Return a hit with its block: rests taken off, and its force window, a flat top and half a cosine."""
    over = np.arange(block.start, block.stop) - (end + guard)
    window = np.where(over <= 0, 1.0, np.where(over < guard, 0.5 + 0.5 * np.cos(np.pi * over / guard), 0.0))
    force, moved = drive[block], response[block]
    at_rest = force[window == 0]
    known = at_rest.size >= _FEWEST
    rest = float(np.median(at_rest if known else drive))
    noise = robust_std(at_rest - rest) if known else 0.0
    return _Strike(
        hit,
        force - rest,
        np.asarray(moved - moved[-max(1, moved.size // 4) :].mean()),
        np.asarray(window),
        noise or noise_level(drive),
        is_cut,
        block.stop < drive.size,
    )


def _judged(strikes: Sequence[_Strike]) -> tuple[list[_Strike], tuple[HitResult, ...], list[str]]:
    """Return the hits to use, all hits with what became of them, and what to say."""
    usual = float(np.median([strike.force.size for strike in strikes]))
    short = [strike.force.size < max(_FEWEST, _LONG_ENOUGH * usual) for strike in strikes]
    remarks = []
    for strike, is_short in zip(strikes, short, strict=True):
        words = ["overload, the response is cut off"] * strike.is_cut + ["too little is behind it"] * is_short
        remarks.append("; ".join([*filter(None, [strike.hit.remark]), *words]))
    clean = [not remark for remark in remarks]
    usable = [not (strike.is_cut or is_short) for strike, is_short in zip(strikes, short, strict=True)]
    used = clean if any(clean) else usable
    if not any(used):
        found = "; ".join(
            f"{hit.time_s:.4g} s: {r}" for hit, r in zip((s.hit for s in strikes[:3]), remarks, strict=False)
        )
        raise RecordingError(
            f"no hit can be used ({found}); record longer behind each, and where a sensor was overloaded hit softer or "
            "take a larger range"
        )
    hits = tuple(
        replace(strike.hit, used=use, remark=remark) for strike, use, remark in zip(strikes, used, remarks, strict=True)
    )
    said = [
        f"hit at {hit.time_s:.4g} s: {hit.remark}; {'used, for there is no better' if hit.used else 'left out'}"
        for hit in hits
        if hit.remark
    ]
    return [strike for strike, use in zip(strikes, used, strict=True) if use], hits, said


def _of_rest(used: Sequence[_Strike], length: int) -> list[str]:
    """Return what to say where the response still swings when the next hit comes."""
    left = []
    for strike in used:
        if strike.is_followed and length > 0.9 * strike.force.size:
            power = [float(part.var()) for part in np.array_split(strike.response[:length], 8)]
            noise = noise_level(strike.response) ** 2
            left.append(math.sqrt(max(0.0, power[-1] - noise) / max(*power, 1e-300)))
    if not left or max(left) <= _STILL_SWINGS:
        return []
    return [
        f"{100 * max(left):.0f} % of the swing is left when the next hit comes: it scatters between the hits and "
        "widens the intervals; wait longer"
    ]


# The response of the hits, and how its errors belong together.


@dataclass(frozen=True)
class _Measured:
    """Response of the hits with what its errors are made of.

    decay_per_s: of the exponential window. spectra: of each hit's force, (k, f). power: of H1's divisor, (f,).
    response_noise: power of the response's noise in a line of one hit, (f,). windows: of response noise (n,) and of the
    force's noise of each hit, (k, n), all with the exponential. force_noise: of one sample, (k,).
    """

    response: FrequencyResponse
    decay_per_s: float
    force: Complexes
    power: Array
    response_noise: Array
    window: Array
    force_windows: Array
    force_noise: Array


def _measure(strikes: Sequence[_Strike], length: int, sample_hz: float) -> _Measured:
    """Return H1, H2 and coherence over the hits under the windows, with their errors."""
    decay = -math.log(_LEFT) * sample_hz / length
    window = np.exp(-decay / sample_hz * np.arange(length))
    force_windows = np.stack([strike.window[:length] for strike in strikes]) * window
    force: Complexes = scipy.fft.rfft(np.stack([strike.force[:length] for strike in strikes]) * force_windows, axis=1)
    moved: Complexes = scipy.fft.rfft(np.stack([strike.response[:length] for strike in strikes]) * window, axis=1)
    sxx, syy = (np.asarray((np.abs(one) ** 2).sum(axis=0), dtype=float) for one in (force, moved))
    sxy = (np.conj(force) * moved).sum(axis=0)
    count = len(strikes)
    force_noise = np.array([strike.force_noise for strike in strikes])
    of_force = float(np.mean(force_noise**2 * (force_windows**2).sum(axis=1)))
    with np.errstate(divide="ignore", invalid="ignore"):
        h1, h2 = sxy / sxx, syy / np.conj(sxy)
        coherence = np.abs(sxy) ** 2 / (sxx * syy) if count > 1 else np.full(sxx.size, np.nan)
        if count > 1:
            scatter = (np.abs(moved - h1 * force) ** 2).sum(axis=0) / (count - 1)
            own = np.maximum(_smooth(scatter - np.abs(h1) ** 2 * of_force), _FLOOR * _smooth(scatter))
        else:
            own = np.full(sxx.size, noise_level(strikes[0].response[:length]) ** 2 * float((window**2).sum()))
        relative = np.sqrt(0.5 * (own / np.abs(h1) ** 2 + of_force) / sxx)
        doubt = np.sqrt(2.0 * coherence / count) * (1.0 - coherence)
    cut = Segmentation(length, length, "boxcar")
    scale = 2.0 / (sample_hz * length * count)
    frequency = np.asarray(np.fft.rfftfreq(length, 1.0 / sample_hz))
    spectra = Spectra(frequency, scale * sxx, scale * syy, scale * sxy, count, cut)
    ones = np.eye(5)[0]
    response = FrequencyResponse(frequency, h1, h2, coherence, relative, doubt, float(count), np.ones(1), ones, spectra)
    return _Measured(response, decay, force, sxx, own, window, force_windows, force_noise)


def _smooth(values: Array) -> Array:
    """Return means over neighbouring lines, over fewer of them at the ends."""
    ones = np.ones(2 * _SMOOTHED + 1)
    known = np.where(np.isfinite(values), values, 0.0)
    return np.asarray(np.convolve(known, ones, "same") / np.convolve(np.ones(values.size), ones, "same"))


def _modes_of(
    measured: _Measured, band_hz: tuple[float, float] | None, modes: int | None
) -> tuple[tuple[float, float], PoleFit | None, tuple[str, ...]]:
    """Return the band, the modes in it and what to beware of."""
    response = measured.response
    heard = np.asarray(response.relative_std < _HEARD)
    # between two modes the response of a few hits may fall below its noise for many lines
    band = band_of_modes(response, heard, hole=heard.size) if band_hz is None else band_hz
    refuse_empty(response, band)
    lines = np.flatnonzero(lines_in(response, band) & (np.abs(response.h1) > 0))
    errors = _line_errors(measured, lines)

    def fit_of(count: int) -> PoleFit:
        return fit_poles(
            response.frequency_hz[lines],
            response.h1[lines],
            response.relative_std[lines],
            modes=count,
            decay_per_s=measured.decay_per_s,
            errors=errors,
        )

    is_sure = measured.force.shape[0] > 1  # the noise of one hit is known by what is fast in it, hence if it is white
    return band, *choose_modes(fit_of, band, modes, lines.size, errors.alike, is_sure=is_sure)


def _line_errors(measured: _Measured, lines: NDArray[np.intp]) -> LineErrors:
    """Return how errors of the lines belong together: noise of every sample goes into all of them through its window.

    H1 - H = Σ_k conj(X_k) (N_k - H M_k)/Σ|X_k|², N_k and M_k the transforms of the windowed noise of response and force
    of hit k. A score Σ_f Re(conj(B_f) N_f) is Σ_t n_t w_t Re b_t with b the inverse transform of B.
    """
    h1, power = measured.response.h1[lines], measured.power[lines]
    window, size = measured.window, measured.window.size
    energy = float((window**2).sum())
    own = np.sqrt(measured.response_noise[lines] / energy)
    alike = size * float((window**4).sum()) / energy**2

    def scores(columns: Complexes, weight: Array) -> Array:
        total = np.zeros((columns.shape[1], columns.shape[1]))
        weighted = columns * (weight / power)[:, None]
        for x, of_force, noise in zip(
            measured.force[:, lines], measured.force_windows, measured.force_noise, strict=True
        ):
            for spread, through in ((own * x / np.conj(h1), window), (noise * x, of_force)):
                spectrum = np.zeros((size // 2 + 1, columns.shape[1]), dtype=complex)
                spectrum[lines] = weighted * spread[:, None]
                # half of the two-sided sum: irfft adds the conjugates, which doubles the real part
                history = 0.5 * size * scipy.fft.irfft(spectrum, size, axis=0) * through[:, None]
                total += history.T @ history
        return total

    return LineErrors(scores, alike)
